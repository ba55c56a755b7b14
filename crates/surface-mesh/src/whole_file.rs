//! Output files that appear whole or not at all.

use std::io::{BufWriter, Write};
use std::path::Path;

use crate::SurfaceError;

/// Writes a file through a temporary one in the same folder, which replaces `path` only when everything was written.
pub(crate) fn write_whole(
    path: &Path,
    content: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
) -> Result<(), SurfaceError> {
    try_write(path, content).map_err(|cause| SurfaceError::Write {
        path: path.into(),
        cause,
    })
}

fn try_write(
    path: &Path,
    content: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
) -> std::io::Result<()> {
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let mut builder = tempfile::Builder::new();
    // A temporary file is private by default; what the user asked for follows the umask as any other file does.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let mut file = builder.tempfile_in(folder)?;
    let mut writer = BufWriter::new(file.as_file_mut());
    content(&mut writer)?;
    writer.flush()?;
    drop(writer);
    // Before it gets its name, so that no power cut leaves an empty file under it.
    file.as_file().sync_all()?;
    file.persist(path).map_err(|error| error.error)?;
    Ok(())
}
