//! Arrays in and out of `.npy` files: float64 and int64, C order.

use crate::error::{Result, TrainerError, file_error};
use crate::files::write_whole;
use npyz::{DType, NpyFile, Order, WriterBuilder};
use std::path::Path;

/// Reads a float64 array of exactly the given shape with finite entries.
///
/// # Errors
/// When the file cannot be read, is no npy file, has another type, order or shape, is truncated, or has an entry that is not
/// finite (its place is named).
pub fn read_f64(path: &Path, shape: &[usize]) -> Result<Vec<f64>> {
    let bytes = std::fs::read(path).map_err(file_error("read", path))?;
    parse_f64(&bytes, path, shape)
}

/// As [`read_f64`], from the content of a file that is at hand already; `path` is what errors call it.
///
/// # Errors
/// As [`read_f64`].
pub fn parse_f64(bytes: &[u8], path: &Path, shape: &[usize]) -> Result<Vec<f64>> {
    let wrong = |problem: String| TrainerError::Array {
        path: path.to_path_buf(),
        problem,
        expected: format!("float64, C order, shape {shape:?}, finite"),
    };
    check_header(bytes).map_err(wrong)?;
    let file = NpyFile::new(bytes).map_err(|e| wrong(format!("not an npy file ({e})")))?;
    let found: Vec<u64> = file.shape().to_vec();
    if found != shape.iter().map(|&n| n as u64).collect::<Vec<_>>() {
        return Err(wrong(format!("its shape is {found:?}")));
    }
    if file.order() != Order::C {
        return Err(wrong("it is in Fortran order".into()));
    }
    match file.dtype() {
        DType::Plain(t) if t.to_string().ends_with("f8") => {}
        other => return Err(wrong(format!("its type is {}", other.descr()))),
    }
    let values: std::io::Result<Vec<f64>> = file
        .data::<f64>()
        .map_err(|e| wrong(e.to_string()))?
        .collect();
    let values = values.map_err(|e| wrong(format!("it is truncated ({e})")))?;
    match values.iter().position(|v| !v.is_finite()) {
        Some(i) => Err(wrong(format!(
            "entry {:?} is {}",
            place(i, shape),
            values[i]
        ))),
        None => Ok(values),
    }
}

/// Longer headers than any that numpy writes for numbers, in bytes.
const LONGEST_HEADER: usize = 4096;
/// Deeper brackets than any in such a header.
const DEEPEST: usize = 8;

/// Refuses a header that the library would choke on: it makes room for as many bytes as are claimed, up to 4 GiB, and follows brackets as
/// deep as they go, until the stack is used up.
fn check_header(bytes: &[u8]) -> std::result::Result<(), String> {
    let length = match bytes {
        [b'\x93', b'N', b'U', b'M', b'P', b'Y', 1, _, a, b, ..] => {
            u16::from_le_bytes([*a, *b]).into()
        }
        [b'\x93', b'N', b'U', b'M', b'P', b'Y', _, _, a, b, c, d, ..] => {
            u32::from_le_bytes([*a, *b, *c, *d])
        }
        _ => return Err("not an npy file (it does not begin with \\x93NUMPY)".into()),
    };
    let start = if bytes[6] == 1 { 10 } else { 12 };
    let header = &bytes[start..];
    if length as usize > header.len().min(LONGEST_HEADER) {
        return Err(format!(
            "its header claims {length} bytes: it is truncated, or no array of numbers"
        ));
    }
    let mut depth = 0_usize;
    for byte in &header[..length as usize] {
        match byte {
            b'(' | b'[' | b'{' => depth += 1,
            b')' | b']' | b'}' => depth = depth.saturating_sub(1),
            _ => {}
        }
        if depth > DEEPEST {
            return Err("the brackets of its header are nested too deep".into());
        }
    }
    // The library multiplies sizes without looking: an array of 2^64 entries passed for an empty one.
    let numbers = header[..length as usize].split(|byte| !byte.is_ascii_digit());
    let numbers = numbers.filter(|digits| !digits.is_empty());
    let mut sizes = numbers.map(|digits| std::str::from_utf8(digits).ok()?.parse().ok());
    let all = sizes.try_fold(1_u64, |all, size: Option<u64>| {
        all.checked_mul(size?.max(1))
    });
    match all {
        Some(_) => Ok(()),
        None => Err("its header tells of more entries than there can be".into()),
    }
}

fn place(mut flat: usize, shape: &[usize]) -> Vec<usize> {
    let mut index: Vec<usize> = (shape.iter().rev())
        .map(|&n| {
            let i = flat % n;
            flat /= n;
            i
        })
        .collect();
    index.reverse();
    index
}

/// Writes an array whole or not at all.
///
/// # Errors
/// When the file cannot be written.
///
/// # Panics
/// When `values` does not fill `shape`.
pub fn write<T: npyz::AutoSerialize + Copy>(
    path: &Path,
    shape: &[usize],
    values: &[T],
) -> Result<()> {
    assert_eq!(
        values.len(),
        shape.iter().product::<usize>(),
        "values fill the shape"
    );
    let shape: Vec<u64> = shape.iter().map(|&n| n as u64).collect();
    let mut bytes = Vec::new();
    let mut encode = || -> std::io::Result<()> {
        let mut writer = npyz::WriteOptions::new()
            .default_dtype()
            .shape(&shape)
            .writer(&mut bytes)
            .begin_nd()?;
        writer.extend(values.iter().copied())?;
        writer.finish()
    };
    encode().map_err(file_error("encode", path))?;
    write_whole(path, &bytes)
}

/// Writes vectors as an array `[n, 3]`.
///
/// # Errors
/// When the file cannot be written.
pub fn write_vectors(path: &Path, values: &[nalgebra::Vector3<f64>]) -> Result<()> {
    let flat: Vec<f64> = values.iter().flat_map(|v| [v.x, v.y, v.z]).collect();
    write(path, &[values.len(), 3], &flat)
}
