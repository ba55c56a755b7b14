//! What two runs of the same scene have to have in common: every file, to the byte, but for what a clock said.

use crate::Result;
use crate::state::{is_unfinished, split};
use myofield_tests::tree;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Held by the process that works on a run, and empty.
const LOCK: &str = ".lock";
/// What a clock said in the numbers of evaluations, performances, fits and comparisons.
const TIMES: [&str; 3] = ["seconds", "training_seconds", "seconds_per_frame"];
/// Columns of the same in the table of a comparison.
const TIME_COLUMNS: [&str; 2] = ["training s", "s per frame"];

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
/// Times are left out: `*_seconds` of the lines of `metrics.jsonl`, `seconds`, `training_seconds` and `seconds_per_frame` of the numbers of
/// evaluations and comparisons, `seconds` in the headers of checkpoint and decoder, the columns of times of a comparison's table with the
/// width that they need, and the length of `metrics.jsonl` that the checkpoint knows, which has as many digits as its times. Everything else
/// is compared to the byte: weights, moments, positions, pictures, meshes, and which files there are.
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
            Some(wanted) if is_same(path, bytes, wanted) => {}
            Some(_) => all.push(format!("{} differs", path.display())),
        }
    }
    all
}

/// Fails where two runs differ.
///
/// # Errors
/// Names the differences.
pub fn same(run: &Path, expected: &Path) -> Result<()> {
    let found = differences(run, expected);
    match found.is_empty() {
        true => Ok(()),
        false => Err(format!("other bytes:\n{}", found.join("\n"))),
    }
}

/// How many files of a run that was killed on its way are already new, of how many that differ before and after.
///
/// # Errors
/// Names a file that is neither as before nor as after, and one of both that is gone. Files that say by their names that they are not
/// finished do not count.
///
/// # Panics
/// When a file cannot be read.
pub fn is_between(run: &Path, before: &Path, after: &Path) -> Result<(usize, usize)> {
    let [run, before, after] = [run, before, after].map(recorded);
    let (mut new, mut all) = (0, 0);
    for (path, wanted) in &after {
        let old = before.get(path);
        if old.is_some_and(|old| is_same(path, old, wanted)) {
            continue;
        }
        all += 1;
        match (run.get(path), old) {
            (Some(found), _) if is_same(path, found, wanted) => new += 1,
            (Some(found), Some(old)) if is_same(path, found, old) => {}
            (None, None) => {}
            _ => return Err(format!("{} is neither old nor new", path.display())),
        }
    }
    let kept = |path: &PathBuf, old: &Vec<u8>| match (run.get(path), after.get(path)) {
        (Some(found), None) => is_same(path, found, old),
        (Some(found), Some(wanted)) => is_same(path, found, old) || is_same(path, found, wanted),
        (None, wanted) => wanted.is_none(),
    };
    if let Some((path, _)) = before.iter().find(|(path, old)| !kept(path, old)) {
        return Err(format!("{} is not what it was", path.display()));
    }
    let known = |path: &PathBuf| before.contains_key(path) || after.contains_key(path);
    match run.keys().find(|path| !known(path) && !is_unfinished(path)) {
        Some(path) => Err(format!("{} should not be there", path.display())),
        None => Ok((new, all)),
    }
}

/// Whether two files of this name are the same, but for what a clock said.
fn is_same(path: &Path, one: &[u8], other: &[u8]) -> bool {
    one == other || timeless(path, one) == timeless(path, other)
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
        Some("comparison/comparison.md") => (Vec::new(), timeless_table(&text()).into_bytes()),
        Some("checkpoint.safetensors" | "comparison/decoder.safetensors") => match split(bytes) {
            Ok((mut header, mut training, data)) => {
                remove(&mut header["__metadata__"], |key| key == "training");
                remove(&mut training, |key| key == "metrics_length");
                forget_times(&mut training);
                (vec![header, training], data.to_vec())
            }
            Err(_) => (Vec::new(), bytes.to_vec()),
        },
        Some(name)
            if name.ends_with(".json")
                && (name.starts_with("evaluation/") || name.starts_with("comparison/")) =>
        {
            let mut value: Value = serde_json::from_str(&text()).unwrap_or_default();
            forget_times(&mut value);
            (vec![value], Vec::new())
        }
        _ => (Vec::new(), bytes.to_vec()),
    }
}

/// Takes out what a clock said, at any depth.
fn forget_times(value: &mut Value) {
    remove(value, |key| TIMES.contains(&key));
    match value {
        Value::Array(all) => all.iter_mut().for_each(forget_times),
        Value::Object(all) => all.values_mut().for_each(forget_times),
        _ => {}
    }
}

/// A text whose tables have lost their columns of times, and the spaces and dashes that fill cells.
fn timeless_table(text: &str) -> String {
    let mut is_time: Vec<bool> = Vec::new();
    let mut out = String::new();
    for line in text.lines() {
        match line.strip_prefix('|').and_then(|l| l.strip_suffix('|')) {
            None => {
                is_time.clear();
                out += line;
            }
            Some(row) => {
                let cells: Vec<&str> = row.split('|').map(str::trim).collect();
                if is_time.is_empty() {
                    is_time = cells.iter().map(|c| TIME_COLUMNS.contains(c)).collect();
                }
                let kept = cells.iter().zip(&is_time).filter(|(_, is_time)| !**is_time);
                for (cell, _) in kept {
                    let is_rule = cell.len() > 1 && cell.trim_matches(['-', ':']).is_empty();
                    out += if is_rule { "|-" } else { "|" };
                    out += if is_rule { "" } else { cell };
                }
            }
        }
        out.push('\n');
    }
    out
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Two tables that differ in times and so in widths are the same; any other number tells them apart.
    #[test]
    fn a_table_without_times_is_what_is_compared() {
        let table = |seconds: &str, error: &str| {
            let rule = "-".repeat(seconds.len());
            format!(
                "# ball\n\n| method | training s | error |\n|-----|{rule}:|---:|\n| field | {seconds} | {error} |\n\n- a note\n"
            )
        };
        let path = Path::new("comparison/comparison.md");
        let same = |a: &str, b: &str| is_same(path, a.as_bytes(), b.as_bytes());
        assert!(same(&table("1.5", "0.25"), &table("1234", "0.25")));
        assert!(!same(&table("1.5", "0.25"), &table("1.5", "0.26")));
        assert!(!same(&table("1.5", "-"), &table("1.5", "")));
        assert!(!same(&table("1.5", "0.25"), &table("1.5", "0.25")[..40]));
    }

    #[test]
    fn numbers_without_times_are_what_is_compared() {
        let path = Path::new("evaluation/fit.json");
        let same = |a: &str, b: &str| is_same(path, a.as_bytes(), b.as_bytes());
        let numbers = |seconds: f64, error: f64| {
            format!(r#"{{"a": [{{"seconds": {seconds}, "x": {{"error": {error}}}}}]}}"#)
        };
        assert!(same(&numbers(1.0, 0.5), &numbers(2.0, 0.5)));
        assert!(!same(&numbers(1.0, 0.5), &numbers(1.0, 0.6)));
        assert!(!same(&numbers(1.0, 0.5), &numbers(1.0, 0.5)[..20]));
    }

    /// Files are old or new, and nothing else: not half, not gone, and none that nobody knows.
    #[test]
    fn what_a_kill_leaves_is_old_or_new() {
        let place = tempfile::tempdir().unwrap();
        let folder = |name: &str, files: &[(&str, &str)]| {
            let folder = place.path().join(name);
            std::fs::create_dir(&folder).unwrap();
            for (name, text) in files {
                std::fs::write(folder.join(name), text).unwrap();
            }
            folder
        };
        let before = folder("before", &[("kept", "1"), ("a", "old"), ("stale", "s")]);
        let after = folder("after", &[("kept", "1"), ("a", "new"), ("b", "new")]);
        let between =
            |name: &str, files: &[(&str, &str)]| is_between(&folder(name, files), &before, &after);
        let unfinished = (".part-abcdef", "n");
        let (old, new) = (("a", "old"), ("a", "new"));
        let (kept, stale) = (("kept", "1"), ("stale", "s"));
        assert_eq!(between("1", &[kept, old, stale, unfinished]), Ok((0, 2)));
        assert_eq!(between("2", &[kept, new, stale]), Ok((1, 2)));
        assert_eq!(between("3", &[kept, new, ("b", "new")]), Ok((2, 2)));
        for (name, wrong) in [
            ("half", [kept, ("a", "ne"), stale].as_slice()),
            ("gone", &[kept, stale]),
            ("damaged", &[("kept", "2"), old, stale]),
            ("lost", &[old, stale]),
            ("strange", &[kept, old, stale, ("c", "?")]),
        ] {
            assert!(between(name, wrong).is_err(), "{name}");
        }
    }
}
