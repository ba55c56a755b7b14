//! Output files that appear whole or not at all.

use std::io::{Result as IoResult, Write};
use std::path::Path;

use crate::SurfaceError;

/// As [`whole_file::write`], with the file in the error.
pub(crate) fn write_whole(
    path: &Path,
    content: impl FnOnce(&mut dyn Write) -> IoResult<()>,
) -> Result<(), SurfaceError> {
    whole_file::write(path, content).map_err(|cause| SurfaceError::Write {
        path: path.into(),
        cause,
    })
}
