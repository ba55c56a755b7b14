//! A small glTF document and its buffer, to be damaged value by value.
#![allow(dead_code, unused_macros, unused_imports)] // Each test program uses its own part.

use std::fs;
use std::path::PathBuf;

use serde_json::{Value, json};
use surface_mesh::{GltfProblem, MorphedSurface, SurfaceError, read_gltf};
use tempfile::TempDir;

/// A document and its only buffer, written as GLB.
pub fn glb(document: &Value, buffer: &[u8]) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("test.glb");
    let glb = gltf::Glb {
        header: gltf::binary::Header {
            magic: *b"glTF",
            version: 2,
            length: 0,
        },
        json: serde_json::to_vec(document).unwrap().into(),
        bin: Some(buffer.into()),
    };
    fs::write(&path, glb.to_vec().unwrap()).unwrap();
    (folder, path)
}

pub fn read(document: &Value) -> Result<MorphedSurface, SurfaceError> {
    let (_folder, path) = glb(document, &buffer());
    read_gltf(path)
}

/// Four positions (48 bytes), then 6 indices as bytes (6), 16-bit (12) and 32-bit (24) numbers from 48, then two sparse
/// indices (bytes 1, 3) at 92 and two deltas (24) at 96.
pub fn buffer() -> Vec<u8> {
    let positions = [
        [0.0_f32, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
    ];
    let indices = [0_u8, 2, 1, 0, 1, 3];
    let deltas = [[0.5_f32, 0.0, 0.0], [0.0, 0.0, -0.25]];
    let floats = |rows: &[[f32; 3]]| -> Vec<u8> {
        rows.as_flattened()
            .iter()
            .flat_map(|x| x.to_le_bytes())
            .collect()
    };
    let mut bytes = floats(&positions);
    bytes.extend(indices);
    bytes.extend(indices.iter().flat_map(|&i| u16::from(i).to_le_bytes()));
    bytes.extend(indices.iter().flat_map(|&i| u32::from(i).to_le_bytes()));
    assert_eq!(bytes.len(), 90);
    bytes.extend([0, 0, 1, 3, 0, 0]);
    bytes.extend(floats(&deltas));
    bytes
}

pub fn document() -> Value {
    json!({
        "asset": { "version": "2.0" },
        "buffers": [{ "byteLength": 120 }],
        "bufferViews": [
            { "buffer": 0, "byteLength": 48 },
            { "buffer": 0, "byteOffset": 48, "byteLength": 6 },
            { "buffer": 0, "byteOffset": 54, "byteLength": 12 },
            { "buffer": 0, "byteOffset": 66, "byteLength": 24 },
            { "buffer": 0, "byteOffset": 92, "byteLength": 2 },
            { "buffer": 0, "byteOffset": 96, "byteLength": 24 },
        ],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 1] },
            { "bufferView": 1, "componentType": 5121, "count": 6, "type": "SCALAR" },
            { "bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR" },
            { "bufferView": 3, "componentType": 5125, "count": 6, "type": "SCALAR" },
            { "componentType": 5126, "count": 4, "type": "VEC3", "sparse": {
                "count": 2,
                "indices": { "bufferView": 4, "componentType": 5121 },
                "values": { "bufferView": 5 },
            } },
            { "componentType": 5126, "count": 4, "type": "VEC3" },
        ],
        "meshes": [{
            "primitives": [{
                "attributes": { "POSITION": 0 }, "indices": 1,
                "targets": [{ "POSITION": 4 }, { "POSITION": 5 }, { "NORMAL": 0 }],
            }],
            "extras": { "targetNames": ["stretch", "nothing", "shading"] },
        }],
        "nodes": [{ "mesh": 0 }],
    })
}

/// The document with one value replaced.
pub fn with(pointer: &str, value: Value) -> Value {
    let mut document = document();
    let (parent, key) = pointer.rsplit_once('/').unwrap();
    let parent = document.pointer_mut(parent).unwrap();
    match parent {
        Value::Array(items) => items[key.parse::<usize>().unwrap()] = value,
        parent => parent[key] = value,
    }
    document
}

#[track_caller]
pub fn problem(document: &Value) -> GltfProblem {
    match read(document) {
        Err(SurfaceError::Gltf { problem, .. }) => problem,
        other => panic!("{other:?}"),
    }
}

/// Asserts what is wrong with the document when one value is replaced.
macro_rules! check_problem {
    ($pointer:expr, $value:tt, $pattern:pat) => {{
        let found = $crate::common::problem(&$crate::common::with($pointer, json!($value)));
        assert!(matches!(found, $pattern), "{}: {found:?}", $pointer);
    }};
}
pub(crate) use check_problem;
