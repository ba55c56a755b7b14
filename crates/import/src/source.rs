//! A source as a folder or as a zip archive, with the same names in both.

use std::fs::File;
use std::io::{BufReader, Cursor, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use zip::ZipArchive;

use crate::error::{ImportError, Result, file_error};

/// How a source is recognised and where it comes from.
#[derive(Clone, Copy, Debug)]
pub struct Origin {
    /// A file that the source is known by, relative to its root.
    pub marker: &'static str,
    /// Folders below the one given in which the root may lie, `""` for itself. In an archive any folder will do.
    pub roots: &'static [&'static str],
    /// A sentence that says where to get the source.
    pub obtain: &'static str,
}

/// Files of a source by their names relative to its root, `/` between folders.
pub struct Source {
    origin: Origin,
    /// What the names are relative to, for messages: a folder, or a path into an archive.
    root: PathBuf,
    store: Store,
}

enum Store {
    Folder,
    Archive {
        archive: ZipArchive<Box<dyn Seekable>>,
        /// Its size in bytes.
        size: u64,
        /// All names in it.
        names: Vec<String>,
        /// What the names of the source's files begin with.
        prefix: String,
    },
}

/// What an archive is read from.
trait Seekable: Read + Seek {}

impl<T: Read + Seek> Seekable for T {}

/// How a file begins that Git LFS has not fetched.
const LFS_POINTER: &[u8] = b"version https://git-lfs.github.com/spec/";

impl Source {
    /// Finds the source in a folder, or in a zip file (a wheel is one).
    ///
    /// # Errors
    /// [`ImportError::NotTheSource`], [`ImportError::File`], [`ImportError::Archive`].
    pub fn open(place: &Path, origin: Origin) -> Result<Self> {
        let absent = || ImportError::NotTheSource {
            place: place.into(),
            marker: origin.marker,
            obtain: origin.obtain,
        };
        if place.is_dir() {
            let mut roots = origin.roots.iter().map(|root| match *root {
                "" => place.to_path_buf(),
                root => place.join(root),
            });
            let root = roots.find(|root| root.join(origin.marker).is_file());
            return Ok(Self {
                origin,
                root: root.ok_or_else(absent)?,
                store: Store::Folder,
            });
        }
        let file = File::open(place).map_err(file_error("read", place))?;
        Self::archive(Box::new(BufReader::new(file)), place, origin)
    }

    /// As [`Source::open`], from the content of a zip file that is at hand already; `place` is what errors call it.
    ///
    /// # Errors
    /// [`ImportError::NotTheSource`], [`ImportError::Archive`].
    pub fn from_archive(bytes: Vec<u8>, place: &Path, origin: Origin) -> Result<Self> {
        Self::archive(Box::new(Cursor::new(bytes)), place, origin)
    }

    fn archive(mut content: Box<dyn Seekable>, place: &Path, origin: Origin) -> Result<Self> {
        let absent = || ImportError::NotTheSource {
            place: place.into(),
            marker: origin.marker,
            obtain: origin.obtain,
        };
        let size = content
            .seek(SeekFrom::End(0))
            .map_err(file_error("read", place))?;
        let archive = ZipArchive::new(content).map_err(|cause| ImportError::Archive {
            path: place.into(),
            cause,
        })?;
        // A name that is no text belongs to none of the files that are asked for.
        let names = archive.file_names().flatten().map(String::from);
        let names: Vec<String> = names.collect();
        let prefixes = names
            .iter()
            .filter_map(|name| name.strip_suffix(origin.marker))
            .filter(|prefix| prefix.is_empty() || prefix.ends_with('/'));
        let prefix = prefixes.min_by_key(|prefix| prefix.len()).map(String::from);
        let prefix = prefix.ok_or_else(absent)?;
        Ok(Self {
            origin,
            root: place.join(&prefix),
            store: Store::Archive {
                archive,
                size,
                names,
                prefix,
            },
        })
    }

    /// Where a file of the source lies, for messages.
    pub fn path(&self, name: &str) -> PathBuf {
        self.root.join(name)
    }

    /// The names of the files directly in a folder of the source, without the folder, in alphabetical order. Empty where there is no
    /// such folder.
    ///
    /// # Errors
    /// [`ImportError::File`].
    pub fn list(&self, folder: &str) -> Result<Vec<String>> {
        let mut names: Vec<String> = match &self.store {
            Store::Folder => {
                let path = self.path(folder);
                if !path.is_dir() {
                    return Ok(Vec::new());
                }
                let entries = std::fs::read_dir(&path).map_err(file_error("read", &path))?;
                let files = entries.flatten().filter(|entry| entry.path().is_file());
                files
                    .filter_map(|entry| entry.file_name().into_string().ok())
                    .collect()
            }
            Store::Archive { names, prefix, .. } => {
                let start = format!("{prefix}{folder}/");
                let below = names.iter().filter_map(|name| name.strip_prefix(&start));
                let files = below.filter(|name| !name.is_empty() && !name.contains('/'));
                files.map(String::from).collect()
            }
        };
        names.sort_unstable();
        Ok(names)
    }

    /// Demands that files exist, before work on any of them begins.
    ///
    /// # Errors
    /// [`ImportError::Missing`] with all that are not there.
    pub fn require<'a>(&self, names: impl IntoIterator<Item = &'a str>) -> Result<()> {
        let exists = |name: &str| match &self.store {
            Store::Folder => self.path(name).is_file(),
            Store::Archive { names, prefix, .. } => {
                let own = |full: &String| full.strip_prefix(prefix.as_str()) == Some(name);
                names.iter().any(own)
            }
        };
        let files: Vec<String> = names
            .into_iter()
            .filter(|name| !exists(name))
            .map(String::from)
            .collect();
        if files.is_empty() {
            return Ok(());
        }
        Err(self.missing(files))
    }

    fn missing(&self, files: Vec<String>) -> ImportError {
        ImportError::Missing {
            place: self.root.clone(),
            files,
            obtain: self.origin.obtain,
        }
    }

    /// The content of a file.
    ///
    /// # Errors
    /// [`ImportError::Missing`], [`ImportError::File`], [`ImportError::Archive`] where an archive is damaged there, or
    /// [`ImportError::LfsPointer`].
    pub fn read(&mut self, name: &str) -> Result<Vec<u8>> {
        self.require([name])?;
        let path = self.path(name);
        let bytes = match &mut self.store {
            Store::Folder => std::fs::read(&path).map_err(file_error("read", &path))?,
            Store::Archive {
                archive,
                size,
                prefix,
                ..
            } => {
                let damaged = |cause| ImportError::Archive {
                    path: path.clone(),
                    cause,
                };
                let entry = archive.by_name(&format!("{prefix}{name}"));
                let entry = entry.map_err(damaged)?;
                let packed = entry.compressed_size().min(*size);
                unpacked(entry, packed, &path)?
            }
        };
        if bytes.starts_with(LFS_POINTER) {
            return Err(ImportError::LfsPointer { path });
        }
        Ok(bytes)
    }

    /// A JSON file.
    ///
    /// # Errors
    /// As [`Source::read`], and [`ImportError::Json`].
    pub fn read_json<T: serde::de::DeserializeOwned>(&mut self, name: &str) -> Result<T> {
        let bytes = self.read(name)?;
        serde_json::from_slice(&bytes).map_err(|cause| ImportError::Json {
            path: self.path(name),
            cause,
        })
    }
}

/// How many times as large as it is packed a file of a source may be. Texts of numbers reach 10, and what says nothing 1000.
const MOST_UNPACKED: u64 = 64;
/// What any file may unpack to, in bytes.
const ALWAYS_UNPACKED: u64 = 1 << 20;

/// The whole of a packed stream that takes `packed` bytes.
///
/// # Errors
/// [`ImportError::Bomb`] when it goes on and on, or [`ImportError::File`].
pub(crate) fn unpacked(stream: impl Read, packed: u64, path: &Path) -> Result<Vec<u8>> {
    let most = packed.saturating_mul(MOST_UNPACKED).max(ALWAYS_UNPACKED);
    let mut bytes = Vec::new();
    let read = stream.take(most + 1).read_to_end(&mut bytes);
    read.map_err(file_error("unpack", path))?;
    match bytes.len() as u64 > most {
        true => Err(ImportError::Bomb {
            path: path.into(),
            packed,
            most,
        }),
        false => Ok(bytes),
    }
}
