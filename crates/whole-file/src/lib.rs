#![doc = include_str!("../README.md")]

use std::io::{BufWriter, Result, Write};
use std::path::Path;
use tempfile::NamedTempFile;

/// How the names of unfinished files begin, with six more letters behind: a process that was killed may leave some.
pub const UNFINISHED: &str = ".part-";

/// Writes a file by `content`. It gets its name, and replaces what had it, when all of it is on disk.
///
/// # Errors
/// When the folder cannot be written, and what `content` returns; then there is no new file, and an old one stays as it is.
pub fn write(path: &Path, content: impl FnOnce(&mut dyn Write) -> Result<()>) -> Result<()> {
    let mut file = beside(path)?;
    let mut writer = BufWriter::new(file.as_file_mut());
    content(&mut writer)?;
    writer.flush()?;
    drop(writer);
    // Before it gets its name, so that no power cut leaves an empty file under it.
    file.as_file().sync_all()?;
    file.persist(path)?;
    Ok(())
}

/// Whether a file can be written here, which leaves nothing behind.
///
/// # Errors
/// When it cannot.
pub fn check(path: &Path) -> Result<()> {
    beside(path).map(drop)
}

/// The folder that a file is in: that of the process for a name alone.
pub fn folder(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

fn beside(path: &Path) -> Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(UNFINISHED);
    // A temporary file is private by default; what the user asked for follows the umask as any other file does.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.tempfile_in(folder(path))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Error;

    #[test]
    fn a_file_is_there_when_all_of_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        check(&path).unwrap();
        write(&path, |file| file.write_all(b"old")).unwrap();
        let halfway = |file: &mut dyn Write| {
            file.write_all(b"ne")?;
            Err(Error::other("no more"))
        };
        assert_eq!(write(&path, halfway).unwrap_err().to_string(), "no more");
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        write(&path, |file| file.write_all(b"new")).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"new");
        // Nothing else is left.
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        let nowhere = folder.path().join("none/a.txt");
        assert!(check(&nowhere).is_err());
        assert!(write(&nowhere, |_| Ok(())).is_err());
    }

    /// As a file that is created without this crate.
    #[cfg(unix)]
    #[test]
    fn it_has_the_mode_of_any_other() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let mode = |name: &str| {
            let file = std::fs::metadata(folder.path().join(name)).unwrap();
            file.permissions().mode()
        };
        write(&folder.path().join("a"), |_| Ok(())).unwrap();
        std::fs::write(folder.path().join("b"), "").unwrap();
        assert_eq!(mode("a"), mode("b"));
    }
}
