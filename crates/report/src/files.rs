//! Files that appear whole or not at all.

use crate::error::ReportError;
use std::path::Path;

/// As [`whole_file::write`], with the file in the error.
pub(crate) fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), ReportError> {
    whole_file::write(path, |file| file.write_all(bytes)).map_err(|source| ReportError::Write {
        path: path.to_owned(),
        source,
    })
}
