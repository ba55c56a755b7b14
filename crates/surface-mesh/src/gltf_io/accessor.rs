//! Accessors, decoded with every count and offset checked against the bytes that are there.
//!
//! The `gltf` crate's own accessor iterators are not used: they fail on an accessor without buffer view (a legal way to write
//! zeros), lose deltas when sparse indices are not sorted, and panic where the file was not validated before.

use std::borrow::Cow;

use gltf::json::accessor::{Accessor, ComponentType, Type, sparse::Sparse};
use gltf::json::validation::Checked;
use gltf::json::{Index, Root};
use nalgebra::Vector3;

use crate::GltfProblem;

/// The document and its buffers.
pub(super) struct Source<'a> {
    pub root: &'a Root,
    pub buffers: Vec<Cow<'a, [u8]>>,
    /// Size of the file and its buffers: no element is made without a byte to back it.
    pub backing: u64,
}

/// Equally spaced elements of `size` bytes; `bytes` ends with the last of them.
struct Elements<'a> {
    bytes: &'a [u8],
    stride: usize,
    size: usize,
}

impl<'a> Elements<'a> {
    fn iter(&self) -> impl Iterator<Item = &'a [u8]> {
        let size = self.size;
        self.bytes
            .chunks(self.stride.max(1))
            .map(move |chunk| &chunk[..size])
    }
}

impl Source<'_> {
    /// Looks a reference up.
    pub fn get<T>(&self, kind: &'static str, index: Index<T>) -> Result<&T, GltfProblem>
    where
        Root: AsRef<[T]>,
    {
        let all: &[T] = self.root.as_ref();
        all.get(index.value()).ok_or(GltfProblem::Missing {
            kind,
            index: index.value(),
            count: all.len(),
        })
    }

    /// The number of elements an accessor claims.
    pub fn count(&self, accessor: Index<Accessor>) -> Result<u64, GltfProblem> {
        Ok(self.get("accessor", accessor)?.count.0)
    }

    /// Appends the elements of a VEC3 accessor of floats, all finite.
    pub fn append_vectors(
        &self,
        index: Index<Accessor>,
        vectors: &mut Vec<Vector3<f64>>,
    ) -> Result<(), GltfProblem> {
        let accessor = self.get("accessor", index)?;
        let is_vector = matches!(accessor.type_, Checked::Valid(Type::Vec3));
        if !is_vector || component(accessor) != Some(ComponentType::F32) {
            return Err(GltfProblem::AccessorType {
                accessor: index.value(),
                expected: "VEC3 of FLOAT",
            });
        }
        let start = vectors.len();
        self.append(index, 12, vector, vectors)?;
        let added = &vectors[start..];
        match added.iter().position(|v| !v.iter().all(|x| x.is_finite())) {
            Some(element) => Err(GltfProblem::NonFinite {
                accessor: index.value(),
                element,
                value: added[element],
            }),
            None => Ok(()),
        }
    }

    /// The elements of a SCALAR accessor of unsigned integers.
    pub fn indices(&self, index: Index<Accessor>) -> Result<Vec<u32>, GltfProblem> {
        let accessor = self.get("accessor", index)?;
        let is_scalar = matches!(accessor.type_, Checked::Valid(Type::Scalar));
        match component(accessor).and_then(integer) {
            Some(integer) if is_scalar => {
                let mut indices = Vec::new();
                self.append(index, integer.size, integer.read, &mut indices)?;
                Ok(indices)
            }
            _ => Err(GltfProblem::AccessorType {
                accessor: index.value(),
                expected: "SCALAR of UNSIGNED_BYTE, UNSIGNED_SHORT or UNSIGNED_INT",
            }),
        }
    }

    fn append<T: Default + Clone>(
        &self,
        index: Index<Accessor>,
        size: usize,
        read: fn(&[u8]) -> T,
        values: &mut Vec<T>,
    ) -> Result<(), GltfProblem> {
        let accessor = self.get("accessor", index)?;
        let count = accessor.count.0;
        let start = values.len();
        match accessor.buffer_view {
            Some(view) => {
                let offset = accessor.byte_offset.unwrap_or_default().0;
                let place = Place {
                    accessor: index.value(),
                    view,
                    offset,
                };
                values.extend(self.strided(place, count, size)?.iter().map(read));
            }
            None if count <= self.backing => values.resize(start + count as usize, T::default()),
            None => {
                return Err(GltfProblem::Unbacked {
                    needed: count.saturating_mul(size as u64),
                    file: self.backing,
                });
            }
        }
        match &accessor.sparse {
            Some(sparse) => self.replace(index, sparse, size, read, &mut values[start..]),
            None => Ok(()),
        }
    }

    /// Puts the sparse part of an accessor over its base values.
    fn replace<T>(
        &self,
        index: Index<Accessor>,
        sparse: &Sparse,
        size: usize,
        read: fn(&[u8]) -> T,
        values: &mut [T],
    ) -> Result<(), GltfProblem> {
        let accessor = index.value();
        let component = match &sparse.indices.component_type {
            Checked::Valid(component) => integer(component.0),
            Checked::Invalid => None,
        };
        let integer = component.ok_or(GltfProblem::AccessorType {
            accessor,
            expected: "sparse with indices of UNSIGNED_BYTE, UNSIGNED_SHORT or UNSIGNED_INT",
        })?;
        let place = |view, offset| Place {
            accessor,
            view,
            offset,
        };
        let (at, of) = (&sparse.indices, &sparse.values);
        let count = sparse.count.0;
        let indices = self.strided(place(at.buffer_view, at.byte_offset.0), count, integer.size)?;
        let replacements = self.strided(place(of.buffer_view, of.byte_offset.0), count, size)?;
        let mut previous = None;
        for (entry, (index, value)) in indices.iter().zip(replacements.iter()).enumerate() {
            let index = (integer.read)(index);
            if previous.is_some_and(|previous| index <= previous) {
                return Err(GltfProblem::SparseOrder { accessor, entry });
            }
            previous = Some(index);
            let count = values.len();
            *values
                .get_mut(index as usize)
                .ok_or(GltfProblem::SparseRange {
                    accessor,
                    index,
                    count,
                })? = read(value);
        }
        Ok(())
    }

    fn strided(&self, place: Place, count: u64, size: usize) -> Result<Elements<'_>, GltfProblem> {
        let view = self.get("buffer view", place.view)?;
        let stride = view.byte_stride.map_or(size, |stride| stride.0);
        if stride < size {
            return Err(GltfProblem::BadStride {
                view: place.view.value(),
                stride,
                element: size,
            });
        }
        let bytes = self.view_bytes(place.view)?;
        let Some(last) = count.checked_sub(1) else {
            let bytes = &[][..];
            return Ok(Elements {
                bytes,
                stride,
                size,
            });
        };
        let needed = last
            .saturating_mul(stride as u64)
            .saturating_add(size as u64)
            .saturating_add(place.offset);
        if needed > bytes.len() as u64 {
            return Err(GltfProblem::AccessorOutOfBounds {
                accessor: place.accessor,
                view: place.view.value(),
                needed,
                available: bytes.len() as u64,
            });
        }
        let bytes = &bytes[place.offset as usize..needed as usize];
        Ok(Elements {
            bytes,
            stride,
            size,
        })
    }

    fn view_bytes(&self, index: Index<gltf::json::buffer::View>) -> Result<&[u8], GltfProblem> {
        let view = self.get("buffer view", index)?;
        self.get("buffer", view.buffer)?;
        let buffer = &self.buffers[view.buffer.value()];
        let start = view.byte_offset.unwrap_or_default().0;
        let needed = start.saturating_add(view.byte_length.0);
        if needed > buffer.len() as u64 {
            return Err(GltfProblem::ViewOutOfBounds {
                view: index.value(),
                buffer: view.buffer.value(),
                needed,
                available: buffer.len() as u64,
            });
        }
        Ok(&buffer[start as usize..needed as usize])
    }
}

/// Where elements begin, and for whom they are read.
struct Place {
    accessor: usize,
    view: Index<gltf::json::buffer::View>,
    offset: u64,
}

fn component(accessor: &Accessor) -> Option<ComponentType> {
    match &accessor.component_type {
        Checked::Valid(component) => Some(component.0),
        Checked::Invalid => None,
    }
}

/// Size in bytes of an unsigned integer type, and how to read it.
struct Integer {
    size: usize,
    read: fn(&[u8]) -> u32,
}

fn integer(component: ComponentType) -> Option<Integer> {
    let (size, read): (usize, fn(&[u8]) -> u32) = match component {
        ComponentType::U8 => (1, |bytes| bytes[0].into()),
        ComponentType::U16 => (2, |bytes| u16::from_le_bytes([bytes[0], bytes[1]]).into()),
        ComponentType::U32 => (4, |bytes| u32::from_le_bytes(four(bytes, 0))),
        ComponentType::I8 | ComponentType::I16 | ComponentType::F32 => return None,
    };
    Some(Integer { size, read })
}

fn vector(bytes: &[u8]) -> Vector3<f64> {
    Vector3::from_fn(|axis, _| f32::from_le_bytes(four(bytes, 4 * axis)).into())
}

fn four(bytes: &[u8], at: usize) -> [u8; 4] {
    [bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]
}
