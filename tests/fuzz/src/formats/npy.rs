//! npy files with headers of all kinds.

use rand::Rng;
use rand::seq::IndexedRandom;
use rand_chacha::ChaCha8Rng;

use crate::damage::NUMBERS;

/// Rows and columns of the array that the reader is asked for.
pub const SHAPE: [usize; 2] = [4, 6];

const TYPES: [&str; 14] = [
    "'<f8'",
    "'>f8'",
    "'<i8'",
    "'|O'",
    "'<f4'",
    "'|S9'",
    "'<U3'",
    "'<M8[ns]'",
    "'<f8",
    "[('a', '<f8')]",
    "[('a', '<f8', (2, 3))]",
    "''",
    "'<f99999999999999999999'",
    "None",
];

/// The file as it should be.
pub fn seed() -> Vec<u8> {
    let values: Vec<f64> = (0..24).map(f64::from).collect();
    file(
        1,
        None,
        "{'descr': '<f8', 'fortran_order': False, 'shape': (4, 6), }",
        &values,
    )
}

fn file(version: u8, length: Option<u32>, header: &str, values: &[f64]) -> Vec<u8> {
    let mut bytes = b"\x93NUMPY".to_vec();
    bytes.extend([version, 0]);
    let length = length.unwrap_or(header.len() as u32 + 1);
    match version {
        1 => bytes.extend((length as u16).to_le_bytes()),
        _ => bytes.extend(length.to_le_bytes()),
    }
    bytes.extend(header.as_bytes());
    bytes.push(b'\n');
    bytes.extend(values.iter().flat_map(|x| x.to_le_bytes()));
    bytes
}

/// A file with some of its header wrong, or its data short.
pub fn generate(rng: &mut ChaCha8Rng) -> Vec<u8> {
    let often = |rng: &mut ChaCha8Rng| rng.random_range(0..3_u32) > 0;
    let descr = if often(rng) {
        TYPES[0]
    } else {
        TYPES.choose(rng).expect("there are types")
    };
    let order = *["False", "True", "false", "0"][..if often(rng) { 1 } else { 4 }]
        .choose(rng)
        .expect("there are orders");
    let shape = match rng.random_range(0..6_u32) {
        0..=2 => "(4, 6)".to_string(),
        3 => {
            let sizes = (0..rng.random_range(0..5_u32))
                .map(|_| *NUMBERS.choose(rng).expect("there are numbers"));
            format!("({},)", sizes.collect::<Vec<_>>().join(", "))
        }
        4 => {
            let depth = 1 << rng.random_range(0..13_u32);
            let open = ["(", "[", "{1: "].choose(rng).expect("there are brackets");
            open.repeat(depth)
        }
        _ => "[4, 6]".into(),
    };
    let header = format!("{{'descr': {descr}, 'fortran_order': {order}, 'shape': {shape}, }}");
    let length = (!often(rng)).then(|| {
        *[0, 1, 60, 65_535, 65_536, u32::MAX]
            .choose(rng)
            .expect("there are lengths")
    });
    let count = if often(rng) {
        24
    } else {
        rng.random_range(0..30)
    };
    let values = (0..count).map(|i| {
        if often(rng) {
            f64::from(i)
        } else {
            f64::from_bits(rng.random())
        }
    });
    let values: Vec<f64> = values.collect();
    file(
        *[1, 1, 1, 2, 3, 4].choose(rng).expect("there are versions"),
        length,
        &header,
        &values,
    )
}
