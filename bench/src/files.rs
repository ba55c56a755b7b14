//! JSON files that appear whole or not at all.

use crate::error::{BenchError, Result};
use serde::Serialize;
use std::io::Write;
use std::path::Path;

/// Checks that a file can be written, before the hours that its content may take. An older file stays as it is.
pub fn check_writable(path: Option<&Path>) -> Result<()> {
    let Some(path) = path else { return Ok(()) };
    let refused = |cause| BenchError::Write {
        path: path.into(),
        cause,
    };
    if path.is_dir() {
        return Err(refused(std::io::Error::other(
            "it is a folder: name a file",
        )));
    }
    let folder = whole_file::folder(path);
    if !folder.is_dir() {
        let missing = format!("create the folder {} first", folder.display());
        return Err(refused(std::io::Error::other(missing)));
    }
    whole_file::check(path).map_err(refused)
}

/// Writes a value as indented JSON to a temporary file beside `path`, which replaces `path` when it is complete.
pub fn write_json(path: Option<&Path>, value: &impl Serialize) -> Result<()> {
    let Some(path) = path else { return Ok(()) };
    let content = |file: &mut dyn Write| {
        serde_json::to_writer_pretty(&mut *file, value)?;
        writeln!(file)
    };
    whole_file::write(path, content).map_err(|cause| BenchError::Write {
        path: path.into(),
        cause,
    })
}
