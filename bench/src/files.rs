//! JSON files that appear whole or not at all.

use crate::error::{BenchError, Result};
use serde::Serialize;
use std::io::Write;
use std::path::Path;
use tempfile::NamedTempFile;

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
    if !folder(path).is_dir() {
        let missing = format!("create the folder {} first", folder(path).display());
        return Err(refused(std::io::Error::other(missing)));
    }
    beside(path).map(drop).map_err(refused)
}

/// Writes a value as indented JSON to a temporary file beside `path`, which replaces `path` when it is complete.
pub fn write_json(path: Option<&Path>, value: &impl Serialize) -> Result<()> {
    let Some(path) = path else { return Ok(()) };
    let write = || -> std::io::Result<()> {
        let mut text = serde_json::to_string_pretty(value)?;
        text.push('\n');
        let mut file = beside(path)?;
        file.write_all(text.as_bytes())?;
        file.as_file().sync_all()?;
        file.persist(path)?;
        Ok(())
    };
    write().map_err(|cause| BenchError::Write {
        path: path.into(),
        cause,
    })
}

fn folder(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

fn beside(path: &Path) -> std::io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    // A temporary file is private by default; what the user asked for follows the umask as any other file does.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.tempfile_in(folder(path))
}
