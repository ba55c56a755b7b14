//! GLB out: triangles of 32-bit floats and sparse morph targets.

use std::borrow::Cow;
use std::path::Path;

use gltf::binary::{Glb, Header};
use nalgebra::Vector3;
use serde_json::{Value, json};

use crate::whole_file::write_whole;
use crate::{MorphedSurface, SurfaceError};

const FLOAT: u32 = 5126;
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// Writes a GLB file of one mesh; polygons become their triangles.
///
/// Positions and deltas are rounded to 32-bit floats; reading the file gives exactly those. Morph targets hold only the
/// vertices they move (sparse accessors), with their names in `mesh.extras.targetNames` and all weights zero. The unit, where there is one, is `mesh.extras.units`.
///
/// # Errors
/// [`SurfaceError::TargetLength`], [`SurfaceError::NonFiniteDelta`], [`SurfaceError::BeyondF32`],
/// [`SurfaceError::GlbTooLarge`] or [`SurfaceError::Write`]; then nothing has changed under `path`.
pub fn write_glb(path: impl AsRef<Path>, morphed: &MorphedSurface) -> Result<(), SurfaceError> {
    let path = path.as_ref();
    morphed.check_targets()?;
    let mut content = Content::default();
    let primitive = content.primitive(path, morphed, Storage::Sparse)?;
    let json = document(&content, primitive, morphed);
    save(path, &json, content.bytes)
}

/// Writes the two chunks of a GLB file, whole or not at all.
pub(super) fn save(path: &Path, json: &Value, binary: Vec<u8>) -> Result<(), SurfaceError> {
    let json = serde_json::to_vec(json).expect("JSON values with string keys serialise");
    let bytes = (binary.len() + json.len()) as u64 + 64;
    if bytes > u32::MAX.into() {
        return Err(SurfaceError::GlbTooLarge {
            path: path.into(),
            bytes,
        });
    }
    // `to_writer` fills the header in by itself.
    let glb = Glb {
        header: Header {
            magic: *b"glTF",
            version: 2,
            length: 0,
        },
        json: Cow::Owned(json),
        bin: Some(Cow::Owned(binary)),
    };
    write_whole(path, |out| {
        // As the system said it, so that a full disk can be told from others.
        glb.to_writer(out).map_err(|error| match error {
            gltf::Error::Io(cause) => cause,
            other => std::io::Error::other(other),
        })
    })
}

/// The JSON of a file with one mesh, of `primitive` and the names of its targets, at node 0.
pub(super) fn document(content: &Content, primitive: Value, morphed: &MorphedSurface) -> Value {
    let mut mesh = json!({ "name": "surface", "primitives": [primitive] });
    if !morphed.targets.is_empty() {
        let names: Vec<&str> = morphed.targets.iter().map(|t| t.name.as_str()).collect();
        mesh["weights"] = json!(vec![0.0; names.len()]);
        mesh["extras"] = json!({ "targetNames": names });
    }
    if let Some(unit) = &morphed.unit {
        mesh["extras"]["units"] = json!(unit);
    }
    json!({
        "asset": { "version": "2.0", "generator": concat!("surface-mesh ", env!("CARGO_PKG_VERSION")) },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "name": "surface" }],
        "meshes": [mesh],
        "accessors": content.accessors,
        "bufferViews": content.views,
        "buffers": [{ "byteLength": content.bytes.len() }],
    })
}

/// How the deltas of morph targets are kept.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Storage {
    /// Only the vertices that move.
    Sparse,
    /// Whichever is smaller for each target: only the vertices that move, or all of them.
    Smaller,
}

/// The binary chunk with the views and accessors into it.
#[derive(Default)]
pub(super) struct Content {
    pub bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Content {
    pub fn primitive(
        &mut self,
        path: &Path,
        morphed: &MorphedSurface,
        storage: Storage,
    ) -> Result<Value, SurfaceError> {
        let surface = &morphed.surface;
        let positions = single(path, "the surface", surface.vertices())?;
        let positions = self.positions(&positions);
        let indices = self.indices(surface.triangles(), surface.vertex_count());
        let mut targets = Vec::with_capacity(morphed.targets.len());
        for target in &morphed.targets {
            let deltas = single(path, &target.name, &target.deltas)?;
            targets.push(json!({ "POSITION": self.target(&deltas, storage) }));
        }
        let mut primitive = json!({
            "attributes": { "POSITION": positions },
            "indices": indices,
            "mode": 4,
        });
        if !targets.is_empty() {
            primitive["targets"] = Value::Array(targets);
        }
        Ok(primitive)
    }

    /// One number per entry; `bounds` are written where given.
    pub fn scalars(&mut self, values: &[f32], bounds: Option<[f32; 2]>) -> usize {
        let view = self.view(None, |bytes| put_floats(bytes, values));
        let mut accessor = json!({
            "bufferView": view, "componentType": FLOAT, "count": values.len(), "type": "SCALAR",
        });
        if let Some(bounds) = bounds {
            // As the exact values of the 32-bit floats, as the bounds of vectors are.
            let [min, max] = bounds.map(f64::from);
            accessor["min"] = json!([min]);
            accessor["max"] = json!([max]);
        }
        self.accessor(accessor)
    }

    fn positions(&mut self, positions: &[[f32; 3]]) -> usize {
        let view = self.view(Some(ARRAY_BUFFER), |bytes| put_vectors(bytes, positions));
        let (min, max) = bounds(positions);
        self.accessor(json!({
            "bufferView": view, "componentType": FLOAT, "count": positions.len(), "type": "VEC3",
            "min": min, "max": max,
        }))
    }

    fn indices(&mut self, triangles: &[[u32; 3]], vertices: usize) -> usize {
        let corners = triangles.as_flattened();
        let view = self.view(Some(ELEMENT_ARRAY_BUFFER), |bytes| {
            put_indices(bytes, corners, vertices)
        });
        self.accessor(json!({
            "bufferView": view, "componentType": index_type(vertices), "count": corners.len(), "type": "SCALAR",
        }))
    }

    fn target(&mut self, deltas: &[[f32; 3]], storage: Storage) -> usize {
        // By bits, so that a negative zero survives too.
        let moves = |delta: &[f32; 3]| delta.iter().any(|x| x.to_bits() != 0);
        let moved: Vec<u32> = (0..deltas.len() as u32)
            .filter(|&vertex| moves(&deltas[vertex as usize]))
            .collect();
        let index_bytes = match index_type(deltas.len()) {
            UNSIGNED_SHORT => 2,
            _ => 4,
        };
        if storage == Storage::Smaller && moved.len() * (12 + index_bytes) >= deltas.len() * 12 {
            return self.positions(deltas);
        }
        self.sparse_target(deltas, moved)
    }

    fn sparse_target(&mut self, deltas: &[[f32; 3]], mut moved: Vec<u32>) -> usize {
        if moved.is_empty() {
            // A sparse part needs one entry at least, and readers disagree on accessors with neither view nor sparse part.
            moved.push(0);
        }
        let values: Vec<[f32; 3]> = moved.iter().map(|&v| deltas[v as usize]).collect();
        let index_view = self.view(None, |bytes| put_indices(bytes, &moved, deltas.len()));
        let value_view = self.view(None, |bytes| put_vectors(bytes, &values));
        let (min, max) = bounds(deltas);
        self.accessor(json!({
            "componentType": FLOAT, "count": deltas.len(), "type": "VEC3", "min": min, "max": max,
            "sparse": {
                "count": moved.len(),
                "indices": { "bufferView": index_view, "componentType": index_type(deltas.len()) },
                "values": { "bufferView": value_view },
            },
        }))
    }

    /// Appends a buffer view, aligned to four bytes.
    fn view(&mut self, target: Option<u32>, put: impl FnOnce(&mut Vec<u8>)) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let start = self.bytes.len();
        put(&mut self.bytes);
        let mut view = json!({
            "buffer": 0, "byteOffset": start, "byteLength": self.bytes.len() - start,
        });
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.views.push(view);
        self.views.len() - 1
    }

    fn accessor(&mut self, accessor: Value) -> usize {
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }
}

/// Rounds to 32-bit floats.
fn single(
    path: &Path,
    what: &str,
    vectors: &[Vector3<f64>],
) -> Result<Vec<[f32; 3]>, SurfaceError> {
    let rounded: Vec<[f32; 3]> = vectors
        .iter()
        .map(|v| [v.x as f32, v.y as f32, v.z as f32])
        .collect();
    match rounded
        .iter()
        .position(|v| !v.iter().all(|x| x.is_finite()))
    {
        Some(vertex) => Err(SurfaceError::BeyondF32 {
            path: path.into(),
            what: what.into(),
            vertex,
        }),
        None => Ok(rounded),
    }
}

/// Entry-wise bounds, as the exact values of the 32-bit floats: a shorter decimal would not be a bound any more.
fn bounds(vectors: &[[f32; 3]]) -> ([f64; 3], [f64; 3]) {
    let (mut min, mut max) = (vectors[0], vectors[0]);
    for vector in vectors {
        for axis in 0..3 {
            min[axis] = min[axis].min(vector[axis]);
            max[axis] = max[axis].max(vector[axis]);
        }
    }
    (min.map(f64::from), max.map(f64::from))
}

fn put_vectors(bytes: &mut Vec<u8>, vectors: &[[f32; 3]]) {
    put_floats(bytes, vectors.as_flattened());
}

fn put_floats(bytes: &mut Vec<u8>, values: &[f32]) {
    for x in values {
        bytes.extend_from_slice(&x.to_le_bytes());
    }
}

/// 16-bit indices where they suffice: the largest, 65535, is reserved.
fn index_type(vertices: usize) -> u32 {
    if vertices < 65536 {
        UNSIGNED_SHORT
    } else {
        UNSIGNED_INT
    }
}

fn put_indices(bytes: &mut Vec<u8>, indices: &[u32], vertices: usize) {
    let short = index_type(vertices) == UNSIGNED_SHORT;
    for index in indices {
        if short {
            bytes.extend_from_slice(&(*index as u16).to_le_bytes());
        } else {
            bytes.extend_from_slice(&index.to_le_bytes());
        }
    }
}
