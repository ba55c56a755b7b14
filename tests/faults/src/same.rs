//! What two runs of the same scene have to have in common: every file, to the byte, but for what a clock said.

use crate::state::split;
use myofield_tests::tree;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Held by the process that works on a run, and empty.
const LOCK: &str = ".lock";

/// All files of a run by their path in it.
///
/// # Panics
/// When one cannot be read.
pub fn recorded(run: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let inside = |path: &Path| path.strip_prefix(run).expect("a path below").to_path_buf();
    tree(run)
        .into_iter()
        .map(|(path, bytes)| (inside(&path), bytes))
        .filter(|(path, _)| path != Path::new(LOCK))
        .collect()
}

/// What two runs differ in, a line for each file: nothing where they are the same.
///
/// Times are left out: `*_seconds` of the lines of `metrics.jsonl`, `seconds` of the shapes of `evaluation/metrics.json`, and in the header of
/// the checkpoint `seconds` and the length of `metrics.jsonl`, which has as many digits as its times. Everything else is compared to the
/// byte: weights, moments, positions, pictures, meshes, and which files there are.
///
/// # Panics
/// When a file cannot be read.
pub fn differences(run: &Path, expected: &Path) -> Vec<String> {
    let (found, expected) = (recorded(run), recorded(expected));
    let mut all = Vec::new();
    for path in expected.keys().filter(|path| !found.contains_key(*path)) {
        all.push(format!("{} is missing", path.display()));
    }
    for (path, bytes) in &found {
        match expected.get(path) {
            None => all.push(format!("{} should not be there", path.display())),
            Some(wanted) if timeless(path, bytes) == timeless(path, wanted) => {}
            Some(_) => all.push(format!("{} differs", path.display())),
        }
    }
    all
}

/// What of a file does not depend on a clock: its values, and its bytes.
fn timeless(path: &Path, bytes: &[u8]) -> (Vec<Value>, Vec<u8>) {
    let text = || String::from_utf8_lossy(bytes);
    // What cannot be read differs from everything that can.
    match path.to_str() {
        Some("metrics.jsonl") => {
            let lines = text().lines().map(timeless_line).collect();
            (lines, Vec::new())
        }
        Some("evaluation/metrics.json") => {
            let mut value: Value = serde_json::from_str(&text()).unwrap_or_default();
            for shape in value["shapes"].as_array_mut().into_iter().flatten() {
                remove(shape, |key| key == "seconds");
            }
            (vec![value], Vec::new())
        }
        Some("checkpoint.safetensors") => match split(bytes) {
            Ok((mut header, mut training, data)) => {
                remove(&mut header["__metadata__"], |key| key == "training");
                remove(&mut training, |key| {
                    ["seconds", "metrics_length"].contains(&key)
                });
                (vec![header, training], data.to_vec())
            }
            Err(_) => (Vec::new(), bytes.to_vec()),
        },
        _ => (Vec::new(), bytes.to_vec()),
    }
}

fn timeless_line(line: &str) -> Value {
    let mut value: Value = serde_json::from_str(line).unwrap_or_default();
    remove(&mut value, |key| key.ends_with("_seconds"));
    value
}

fn remove(value: &mut Value, is_time: impl Fn(&str) -> bool) {
    if let Some(entries) = value.as_object_mut() {
        entries.retain(|key, _| !is_time(key));
    }
}
