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
    let wrong = |problem: String| TrainerError::Array {
        path: path.to_path_buf(),
        problem,
        expected: format!("float64, C order, shape {shape:?}, finite"),
    };
    let bytes = std::fs::read(path).map_err(file_error("read", path))?;
    let file = NpyFile::new(&bytes[..]).map_err(|e| wrong(format!("not an npy file ({e})")))?;
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
