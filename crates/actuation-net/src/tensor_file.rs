//! Named tensors and text metadata in a safetensors file: what a network, an optimiser and a checkpoint are stored in.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use safetensors::{Dtype, SafeTensors};

use crate::Error;

/// The contents of a safetensors file.
///
/// Equal contents give equal files, byte for byte. Names are free; several networks can share a file under prefixes, see
/// [`crate::ActuationNet::insert_into`].
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TensorFile {
    path: PathBuf,
    metadata: BTreeMap<String, String>,
    tensors: BTreeMap<String, StoredTensor>,
}

#[derive(Debug, Clone, PartialEq)]
struct StoredTensor {
    dtype: Dtype,
    shape: Vec<usize>,
    bytes: Vec<u8>,
}

impl TensorFile {
    /// No tensors, no metadata.
    pub fn new() -> Self {
        Self::default()
    }

    /// Reads a whole file.
    ///
    /// # Errors
    /// [`Error::Read`] and [`Error::Malformed`], the latter for truncated files too.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, Error> {
        let path = path.as_ref();
        let bytes = std::fs::read(path).map_err(|source| Error::Read {
            path: path.to_path_buf(),
            source,
        })?;
        Self::parse(&bytes, path)
    }

    /// As [`TensorFile::read`], from the content of a file that is at hand already; `path` is what errors call it.
    ///
    /// # Errors
    /// [`Error::Malformed`].
    pub fn parse(bytes: &[u8], path: impl AsRef<Path>) -> Result<Self, Error> {
        let path = path.as_ref().to_path_buf();
        let malformed = |source| Error::Malformed {
            path: path.clone(),
            source,
        };
        let (length, header) = SafeTensors::read_metadata(bytes).map_err(malformed)?;
        // Behind the header and its length; all offsets were checked against it.
        let data = &bytes[8 + length..];
        let tensors = header.tensors().into_iter();
        let tensors = tensors.map(|(name, info)| {
            let (start, end) = info.data_offsets;
            let tensor = StoredTensor {
                dtype: info.dtype,
                shape: info.shape.clone(),
                bytes: data[start..end].to_vec(),
            };
            (name, tensor)
        });
        let tensors = tensors.collect();
        let metadata = header.metadata().iter().flatten();
        let metadata = metadata.map(|(key, value)| (key.clone(), value.clone()));
        let metadata = metadata.collect();
        Ok(Self {
            path,
            metadata,
            tensors,
        })
    }

    /// Writes the file. It appears whole or not at all: an older file stays until the new one is complete and on disk.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn write(&self, path: impl AsRef<Path>) -> Result<(), Error> {
        let path = path.as_ref();
        self.write_atomically(path).map_err(|source| Error::Write {
            path: path.to_path_buf(),
            source,
        })
    }

    /// The file this was read from; empty if it was made in memory.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Names of all tensors, sorted.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.tensors.keys().map(String::as_str)
    }

    /// The metadata entry `key`.
    ///
    /// # Errors
    /// [`Error::MissingMetadata`].
    pub fn metadata(&self, key: &str) -> Result<&str, Error> {
        match self.metadata.get(key) {
            Some(value) => Ok(value),
            None => Err(Error::MissingMetadata {
                path: self.path.clone(),
                key: key.to_string(),
            }),
        }
    }

    /// Sets the metadata entry `key`.
    pub fn insert_metadata(&mut self, key: impl Into<String>, value: impl Into<String>) {
        self.metadata.insert(key.into(), value.into());
    }

    /// Adds or replaces a tensor of f32 numbers, row-major.
    ///
    /// # Panics
    /// If `values` does not fill `shape`.
    pub fn insert_f32(&mut self, name: impl Into<String>, shape: &[usize], values: &[f32]) {
        let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.insert(name.into(), Dtype::F32, shape, values.len(), bytes);
    }

    /// Adds or replaces a tensor of u64 numbers, row-major.
    ///
    /// # Panics
    /// If `values` does not fill `shape`.
    pub fn insert_u64(&mut self, name: impl Into<String>, shape: &[usize], values: &[u64]) {
        let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.insert(name.into(), Dtype::U64, shape, values.len(), bytes);
    }

    /// The f32 tensor `name`, which must have `shape` and be finite.
    ///
    /// # Errors
    /// [`Error::MissingTensor`], [`Error::TensorType`], [`Error::TensorShape`] and [`Error::NonFiniteTensor`].
    pub fn f32_tensor(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, Error> {
        let bytes = self.bytes(name, Dtype::F32, shape)?;
        let (entries, _) = bytes.as_chunks();
        let values: Vec<f32> = entries.iter().map(|b| f32::from_le_bytes(*b)).collect();
        match values.iter().position(|value| !value.is_finite()) {
            None => Ok(values),
            Some(index) => Err(Error::NonFiniteTensor {
                path: self.path.clone(),
                tensor: name.to_string(),
                index,
                value: values[index],
            }),
        }
    }

    /// The u64 tensor `name`, which must have `shape`.
    ///
    /// # Errors
    /// [`Error::MissingTensor`], [`Error::TensorType`] and [`Error::TensorShape`].
    pub fn u64_tensor(&self, name: &str, shape: &[usize]) -> Result<Vec<u64>, Error> {
        let bytes = self.bytes(name, Dtype::U64, shape)?;
        let (entries, _) = bytes.as_chunks();
        Ok(entries.iter().map(|b| u64::from_le_bytes(*b)).collect())
    }

    /// # Errors
    /// [`Error::UnknownTensor`] for the first tensor whose name starts with `prefix` but is not `known` without it.
    pub(crate) fn check_names(
        &self,
        prefix: &str,
        known: impl Fn(&str) -> bool,
    ) -> Result<(), Error> {
        let mut local_names = self.names().filter_map(|name| name.strip_prefix(prefix));
        match local_names.find(|name| !known(name)) {
            None => Ok(()),
            Some(name) => Err(Error::UnknownTensor {
                path: self.path.clone(),
                tensor: format!("{prefix}{name}"),
            }),
        }
    }

    fn insert(
        &mut self,
        name: String,
        dtype: Dtype,
        shape: &[usize],
        count: usize,
        bytes: Vec<u8>,
    ) {
        assert_eq!(
            shape.iter().product::<usize>(),
            count,
            "the values of tensor `{name}` must fill its shape {shape:?}"
        );
        let shape = shape.to_vec();
        let tensor = StoredTensor {
            dtype,
            shape,
            bytes,
        };
        self.tensors.insert(name, tensor);
    }

    fn bytes(&self, name: &str, dtype: Dtype, shape: &[usize]) -> Result<&[u8], Error> {
        let (path, tensor) = (self.path.clone(), name.to_string());
        let Some(stored) = self.tensors.get(name) else {
            return Err(Error::MissingTensor { path, tensor });
        };
        if stored.dtype != dtype {
            return Err(Error::TensorType {
                path,
                tensor,
                found: stored.dtype,
                expected: dtype,
            });
        }
        if stored.shape != shape {
            return Err(Error::TensorShape {
                path,
                tensor,
                found: stored.shape.clone(),
                expected: shape.to_vec(),
            });
        }
        Ok(&stored.bytes)
    }

    fn write_atomically(&self, path: &Path) -> std::io::Result<()> {
        let (header, order) = self.header()?;
        whole_file::write(path, |file| {
            file.write_all(&(header.len() as u64).to_le_bytes())?;
            file.write_all(&header)?;
            order
                .iter()
                .try_for_each(|tensor| file.write_all(&tensor.bytes))
        })
    }

    /// The JSON header, padded with blanks to whole 8 bytes, and the tensors in the order of their data.
    ///
    /// Written here rather than by the safetensors crate because that one keeps metadata in a hash map, whose order, and so
    /// the file's bytes, change from run to run.
    fn header(&self) -> std::io::Result<(Vec<u8>, Vec<&StoredTensor>)> {
        let mut order: Vec<_> = self.tensors.iter().collect();
        // Wide numbers first keeps every tensor aligned.
        order.sort_by_key(|(_, tensor)| std::cmp::Reverse(tensor.dtype.bitsize()));
        let mut entries = serde_json::Map::new();
        let metadata = serde_json::to_value(&self.metadata)?;
        entries.insert("__metadata__".to_string(), metadata);
        let mut offset = 0;
        for (name, tensor) in &order {
            let end = offset + tensor.bytes.len();
            let entry = serde_json::json!({
                "dtype": tensor.dtype,
                "shape": tensor.shape,
                "data_offsets": [offset, end],
            });
            entries.insert((*name).clone(), entry);
            offset = end;
        }
        let mut header = serde_json::to_vec(&entries)?;
        header.resize(header.len().next_multiple_of(8), b' ');
        Ok((
            header,
            order.into_iter().map(|(_, tensor)| tensor).collect(),
        ))
    }
}
