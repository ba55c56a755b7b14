//! Files that appear whole or not at all.

use crate::error::{Result, TrainerError, file_error};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Writes a file beside its final place, flushes it to disk, and renames it.
///
/// # Errors
/// When the folder cannot be written; an older file of that name then stays as it was.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    whole_file::write(path, |file| file.write_all(bytes)).map_err(file_error("write", path))
}

/// Writes a value as indented JSON.
///
/// # Errors
/// As [`write_whole`].
pub fn write_json(path: &Path, value: &impl serde::Serialize) -> Result<()> {
    let mut text = serde_json::to_string_pretty(value).expect("plain data serialises");
    text.push('\n');
    write_whole(path, text.as_bytes())
}

/// Reads a value from JSON.
///
/// # Errors
/// When the file cannot be read, or holds something else.
pub fn read_json<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T> {
    let text = std::fs::read_to_string(path).map_err(file_error("read", path))?;
    parse_json(&text, path)
}

/// As [`read_json`], from a text; `path` is what errors call it.
///
/// # Errors
/// When the text holds something else.
pub fn parse_json<T: serde::de::DeserializeOwned>(text: &str, path: &Path) -> Result<T> {
    serde_json::from_str(text).map_err(|error| TrainerError::Json {
        path: path.to_path_buf(),
        problem: error.to_string(),
    })
}

/// Creates a folder and its parents, and checks that it can be written.
///
/// # Errors
/// When it cannot be created or written.
pub fn create_folder(path: &Path) -> Result<PathBuf> {
    std::fs::create_dir_all(path).map_err(file_error("create the folder", path))?;
    tempfile::Builder::new()
        .prefix(".probe-")
        .tempfile_in(path)
        .map_err(file_error("write to the folder", path))?;
    Ok(path.to_path_buf())
}

/// How names of unfinished files begin.
const UNFINISHED: [&str; 2] = [whole_file::UNFINISHED, ".probe-"];
/// Random letters that follow.
const RANDOM_PART: usize = 6;

/// Removes a file, if it is there.
///
/// # Errors
/// When it cannot be removed.
pub fn remove(path: &Path) -> Result<()> {
    match std::fs::remove_file(path) {
        Err(error) if error.kind() != ErrorKind::NotFound => Err(file_error("remove", path)(error)),
        _ => Ok(()),
    }
}

/// Removes the unfinished files that a killed process left in a folder. Nobody else may be writing there.
///
/// # Errors
/// When one cannot be removed. A folder that does not exist has none.
pub fn remove_unfinished(folder: &Path) -> Result<()> {
    let Ok(entries) = std::fs::read_dir(folder) else {
        return Ok(());
    };
    for path in entries.flatten().map(|entry| entry.path()) {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let is_unfinished =
            |prefix: &&str| name.starts_with(*prefix) && name.len() == prefix.len() + RANDOM_PART;
        if path.is_file() && UNFINISHED.iter().any(is_unfinished) {
            remove(&path)?;
        }
    }
    Ok(())
}

/// Removes the pictures of a series whose numbers are above `last`: those that `name` gives for them, which is `PREFIX-`, the number and
/// `.png`. Gaps do not matter: a process that was killed at this leaves some.
///
/// # Errors
/// When the folder cannot be read or one cannot be removed.
pub fn remove_beyond(
    folder: &Path,
    prefix: &str,
    last: usize,
    name: impl Fn(usize) -> String,
) -> Result<()> {
    let entries = std::fs::read_dir(folder).map_err(file_error("read the folder", folder))?;
    for path in entries.flatten().map(|entry| entry.path()) {
        let found = path.file_name().unwrap_or_default().to_string_lossy();
        let digits = (found.strip_prefix(prefix))
            .and_then(|rest| rest.strip_prefix('-')?.strip_suffix(".png"));
        let number = digits.and_then(|digits| digits.parse().ok());
        if number.is_some_and(|n| n > last && name(n) == found) {
            remove(&path)?;
        }
    }
    Ok(())
}
