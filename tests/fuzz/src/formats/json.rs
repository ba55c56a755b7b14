//! JSON documents with values replaced one by one.

use rand::Rng;
use rand::seq::IndexedRandom;
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};

use crate::damage::NUMBERS;

/// Deeper than any reader follows.
const DEEP: usize = 512;

/// Replaces, removes, repeats or renames values in a document, `times` times.
pub fn change(document: &mut Value, times: u32, rng: &mut ChaCha8Rng) {
    for _ in 0..times {
        let donor = anywhere(document, rng).clone();
        let place = somewhere(document, rng);
        *place = match rng.random_range(0..8_u32) {
            0 => donor,
            1 => changed_members(place.take(), donor, rng),
            2..=4 if place.is_number() => number(rng),
            _ => any(rng),
        };
    }
}

/// A value anywhere in a document, itself included; deep ones as often as those above them.
fn somewhere<'a>(value: &'a mut Value, rng: &mut ChaCha8Rng) -> &'a mut Value {
    let children = match value {
        Value::Array(items) => items.len(),
        Value::Object(members) => members.len(),
        _ => 0,
    };
    if children == 0 || rng.random_range(0..6_u32) == 0 {
        return value;
    }
    let child = rng.random_range(0..children);
    let child = match value {
        Value::Array(items) => &mut items[child],
        Value::Object(members) => members.values_mut().nth(child).expect("it was counted"),
        _ => unreachable!("others have no children"),
    };
    somewhere(child, rng)
}

/// As [`somewhere`], to be copied.
fn anywhere<'a>(value: &'a Value, rng: &mut ChaCha8Rng) -> &'a Value {
    let children = match value {
        Value::Array(items) => items.len(),
        Value::Object(members) => members.len(),
        _ => 0,
    };
    if children == 0 || rng.random_range(0..6_u32) == 0 {
        return value;
    }
    let child = rng.random_range(0..children);
    let child = match value {
        Value::Array(items) => &items[child],
        Value::Object(members) => members.values().nth(child).expect("it was counted"),
        _ => unreachable!("others have no children"),
    };
    anywhere(child, rng)
}

fn changed_members(value: Value, donor: Value, rng: &mut ChaCha8Rng) -> Value {
    match value {
        Value::Array(mut items) => {
            let at = rng.random_range(0..=items.len());
            match rng.random_range(0..3_u32) {
                0 => items.insert(at, donor),
                1 => items.truncate(at),
                _ if at < items.len() => {
                    let times = 1 << rng.random_range(0..7_u32);
                    let copies = vec![items[at].clone(); times];
                    items.splice(at..at, copies);
                }
                _ => items.clear(),
            }
            Value::Array(items)
        }
        Value::Object(mut members) => {
            let keys: Vec<String> = members.keys().cloned().collect();
            let key = keys.choose(rng).cloned().unwrap_or_default();
            match rng.random_range(0..3_u32) {
                0 => drop(members.remove(&key)),
                1 => drop(members.insert(text(rng), donor)),
                _ => drop(members.insert(key, donor)),
            }
            Value::Object(members)
        }
        _ => any(rng),
    }
}

/// A number that is likely to be refused, or should be.
pub fn number(rng: &mut ChaCha8Rng) -> Value {
    let text = NUMBERS.choose(rng).expect("there are numbers");
    serde_json::from_str(text).unwrap_or_else(|_| rng.random_range(0..10_u32).into())
}

/// A text that is likely to do harm.
pub fn text(rng: &mut ChaCha8Rng) -> String {
    match rng.random_range(0..8_u32) {
        0 => String::new(),
        1 => "a".repeat(1 << rng.random_range(0..12_u32).min(rng.random_range(0..12))),
        2 => "\u{1b}[2J\r\n\0\u{202e}`\"<b>|$".into(),
        3 => "../../etc/passwd".into(),
        4 => "data:application/octet-stream;base64,AAAA".into(),
        5 => NUMBERS.choose(rng).expect("there are numbers").to_string(),
        6 => "\u{e9}\u{1f9b4}".repeat(3),
        _ => "target_0".into(),
    }
}

fn any(rng: &mut ChaCha8Rng) -> Value {
    match rng.random_range(0..8_u32) {
        0 => Value::Null,
        1 => rng.random::<bool>().into(),
        2 => json!([]),
        3 => json!({}),
        4 => text(rng).into(),
        5 => {
            let depth = 1 << rng.random_range(0..DEEP.ilog2());
            (0..depth).fold(json!(0), |inner, _| json!([inner]))
        }
        _ => number(rng),
    }
}
