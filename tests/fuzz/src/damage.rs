//! Damage to the bytes of a file, of whatever format.

use rand::Rng;
use rand::seq::IndexedRandom;
use rand_chacha::ChaCha8Rng;

/// Sizes that damaged inputs do not exceed by much.
pub const LARGEST: usize = 1 << 14;

/// Numbers at which readers go wrong.
pub const NUMBERS: [&str; 30] = [
    "0",
    "-0",
    "1",
    "-1",
    "2",
    "3",
    "7",
    "8",
    "27",
    "64",
    "127",
    "128",
    "255",
    "256",
    "65535",
    "65536",
    "2147483647",
    "2147483648",
    "4294967295",
    "4294967296",
    "9007199254740993",
    "9223372036854775807",
    "-9223372036854775808",
    "18446744073709551615",
    "18446744073709551616",
    "1e308",
    "-1e308",
    "1e999",
    "5e-324",
    "0.5",
];

/// Words that mean something to some format.
const WORDS: [&str; 34] = [
    "nan",
    "inf",
    "-inf",
    "NaN",
    "null",
    "true",
    "\"",
    "\\",
    "\n",
    "\r\n",
    "\0",
    "\t",
    " ",
    ",",
    ";",
    "#",
    "=",
    "[",
    "]",
    "{",
    "}",
    "(",
    ")",
    "[[",
    "]]",
    "/",
    "//",
    "\u{feff}",
    "\u{1b}[31m",
    "\u{202e}",
    "\\u0000",
    "../",
    "data:,",
    "'''",
];

/// Damages bytes in one to eight places. `other` is a file of the same format, to take pieces from.
pub fn damage(bytes: &mut Vec<u8>, other: &[u8], rng: &mut ChaCha8Rng) {
    // Mostly little, as much damage is refused at once.
    let times = 1 + rng.random_range(0..8_u32).min(rng.random_range(0..8));
    for _ in 0..times {
        once(bytes, other, rng);
    }
}

fn once(bytes: &mut Vec<u8>, other: &[u8], rng: &mut ChaCha8Rng) {
    if bytes.is_empty() {
        bytes.extend(piece(other, rng));
        return;
    }
    let at = rng.random_range(0..bytes.len());
    match rng.random_range(0..12_u32) {
        0 => bytes[at] ^= 1 << rng.random_range(0..8_u32),
        1 => bytes[at] = rng.random(),
        2 => bytes.truncate(at),
        3 => {
            let end = at + span(bytes.len() - at, rng);
            bytes.drain(at..end);
        }
        4 => {
            let end = at + span(bytes.len() - at, rng);
            let copy = bytes[at..end].to_vec();
            repeat(bytes, end, &copy, rng);
        }
        5 => {
            let piece = piece(other, rng).to_vec();
            insert(bytes, at, &piece);
        }
        6 => {
            let piece = piece(other, rng);
            let length = piece.len().min(bytes.len() - at);
            bytes[at..at + length].copy_from_slice(&piece[..length]);
        }
        7 => {
            let word = WORDS.choose(rng).expect("there are words").as_bytes();
            insert(bytes, at, word);
        }
        8 => {
            let word = WORDS.choose(rng).expect("there are words").as_bytes();
            repeat(bytes, at, word, rng);
        }
        9 => binary_number(bytes, at, rng),
        _ => text_number(bytes, at, rng),
    }
}

/// A length from 1 to `most`, mostly short.
fn span(most: usize, rng: &mut ChaCha8Rng) -> usize {
    let largest = 1 << rng.random_range(0..12_u32).min(rng.random_range(0..12));
    rng.random_range(1..=most.min(largest))
}

fn piece<'a>(bytes: &'a [u8], rng: &mut ChaCha8Rng) -> &'a [u8] {
    if bytes.is_empty() {
        return b"0";
    }
    let start = rng.random_range(0..bytes.len());
    &bytes[start..start + span(bytes.len() - start, rng)]
}

fn insert(bytes: &mut Vec<u8>, at: usize, piece: &[u8]) {
    if bytes.len() < LARGEST {
        bytes.splice(at..at, piece.iter().copied());
    }
}

/// Puts a piece in many times over.
fn repeat(bytes: &mut Vec<u8>, at: usize, piece: &[u8], rng: &mut ChaCha8Rng) {
    let room = LARGEST.saturating_sub(bytes.len()) / piece.len().max(1);
    // Mostly few, as large inputs take long.
    let exponent = rng.random_range(0..11_u32).min(rng.random_range(0..11));
    let times = (1 << exponent).min(room);
    insert(bytes, at, &piece.repeat(times));
}

/// Writes an integer of 1, 2, 4 or 8 bytes over what is there.
fn binary_number(bytes: &mut [u8], at: usize, rng: &mut ChaCha8Rng) {
    let number: u64 = match rng.random_range(0..4_u32) {
        0 => rng.random_range(0..64),
        1 => u64::MAX - rng.random_range(0..64),
        2 => 1 << rng.random_range(0..64_u32),
        _ => (1 << rng.random_range(1..64_u32)) - 1,
    };
    let number = number.to_le_bytes();
    let width = *[1, 2, 4, 8].choose(rng).expect("there are widths");
    // Where numbers stand: at even places.
    let at = at / width * width;
    for (byte, new) in bytes[at..].iter_mut().zip(&number[..width]) {
        *byte = *new;
    }
}

/// Replaces the next number in the text.
fn text_number(bytes: &mut Vec<u8>, from: usize, rng: &mut ChaCha8Rng) {
    let Some(start) = bytes[from..].iter().position(u8::is_ascii_digit) else {
        return;
    };
    let start = from + start;
    let digits = bytes[start..].iter().take_while(|b| b.is_ascii_digit());
    let end = start + digits.count();
    let new = NUMBERS.choose(rng).expect("there are numbers");
    bytes.splice(start..end, new.bytes());
}
