//! GLB files: four vertices, two triangles, dense and sparse morph targets, nodes.

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};

use super::json::change;

/// Positions (48 bytes), indices of 1, 2 and 4 bytes (6, 12, 24) from 48, sparse indices 1 and 3 (2) at 92, deltas (24) at 96.
fn buffer() -> Vec<u8> {
    let corners = [
        [0.0_f32; 3],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
    ];
    let indices = [0_u8, 2, 1, 0, 1, 3];
    let deltas = [[0.5_f32, 0.0, 0.0], [0.0, 0.0, -0.25]];
    let mut bytes: Vec<u8> = corners
        .as_flattened()
        .iter()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    bytes.extend(indices);
    bytes.extend(indices.iter().flat_map(|&i| u16::from(i).to_le_bytes()));
    bytes.extend(indices.iter().flat_map(|&i| u32::from(i).to_le_bytes()));
    bytes.extend([0, 0, 1, 3, 0, 0]);
    bytes.extend(deltas.as_flattened().iter().flat_map(|x| x.to_le_bytes()));
    bytes
}

/// The document, which every part of the reader has something to do for.
pub fn document() -> Value {
    json!({
        "asset": { "version": "2.0", "extras": { "units": "cm" } },
        "extensionsRequired": ["KHR_texture_transform"],
        "extensionsUsed": ["KHR_texture_transform"],
        "buffers": [{ "byteLength": 120 }],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": 48, "byteStride": 12 },
            { "buffer": 0, "byteOffset": 48, "byteLength": 6 },
            { "buffer": 0, "byteOffset": 54, "byteLength": 12 },
            { "buffer": 0, "byteOffset": 66, "byteLength": 24 },
            { "buffer": 0, "byteOffset": 92, "byteLength": 2 },
            { "buffer": 0, "byteOffset": 96, "byteLength": 24 },
        ],
        "accessors": [
            { "bufferView": 0, "byteOffset": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 1] },
            { "bufferView": 1, "componentType": 5121, "count": 6, "type": "SCALAR" },
            { "bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR" },
            { "bufferView": 3, "componentType": 5125, "count": 6, "type": "SCALAR", "normalized": false },
            { "componentType": 5126, "count": 4, "type": "VEC3", "sparse": {
                "count": 2,
                "indices": { "bufferView": 4, "byteOffset": 0, "componentType": 5121 },
                "values": { "bufferView": 5, "byteOffset": 0 },
            } },
            { "componentType": 5126, "count": 4, "type": "VEC3" },
        ],
        "meshes": [{
            "name": "face",
            "primitives": [
                { "attributes": { "POSITION": 0 }, "indices": 1, "mode": 4, "targets": [{ "POSITION": 4 }, { "POSITION": 5 }, {}] },
                { "attributes": { "POSITION": 0 }, "indices": 2, "targets": [{ "POSITION": 4 }, { "POSITION": 5 }, {}] },
                { "attributes": { "POSITION": 0, "NORMAL": 0 }, "indices": 3, "targets": [{ "POSITION": 4 }, { "POSITION": 0 }, { "NORMAL": 0 }] },
            ],
            "weights": [0.0, 0.5, 0.0],
            "extras": { "targetNames": ["stretch", "nothing", "shading"] },
        }],
        "nodes": [
            { "children": [1], "translation": [1, 2, 3], "rotation": [0, 0, 0, 1], "scale": [1, -1, 1] },
            { "children": [2], "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1, 0, 0, 1] },
            { "mesh": 0, "name": "face" },
        ],
        "scenes": [{ "nodes": [0] }],
        "scene": 0,
    })
}

/// A GLB file of a document and its buffer.
pub fn container(document: &Value, buffer: &[u8]) -> Vec<u8> {
    let mut json = serde_json::to_vec(document).expect("JSON is written");
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut bytes = b"glTF".to_vec();
    let length = 12 + 8 + json.len() + 8 + buffer.len();
    bytes.extend([2, length as u32].iter().flat_map(|n| n.to_le_bytes()));
    bytes.extend((json.len() as u32).to_le_bytes());
    bytes.extend(b"JSON");
    bytes.extend(json);
    bytes.extend((buffer.len() as u32).to_le_bytes());
    bytes.extend(b"BIN\0");
    bytes.extend(buffer);
    bytes
}

/// The file as it should be.
pub fn seed() -> Vec<u8> {
    container(&document(), &buffer())
}

/// A file with some values of its document replaced; now and then the document alone, with its buffer in it.
pub fn generate(rng: &mut ChaCha8Rng) -> Vec<u8> {
    let mut document = document();
    let times = rng.random_range(0..5);
    if rng.random_range(0..8_u32) == 0 {
        // 160 letters of base64 are 120 bytes.
        let uri = format!("data:application/octet-stream;base64,{}", "A".repeat(160));
        document["buffers"][0]["uri"] = uri.into();
        change(&mut document, times, rng);
        return serde_json::to_vec(&document).expect("JSON is written");
    }
    change(&mut document, times, rng);
    let mut buffer = buffer();
    if rng.random_range(0..4_u32) == 0 {
        let at = rng.random_range(0..buffer.len());
        buffer[at] = rng.random();
    }
    container(&document, &buffer)
}
