//! The glTF reader on legal files made by hand.

mod common;

use std::fs;

use common::{buffer, check_problem, document, problem, read, with};
use nalgebra::Vector3;
use serde_json::json;
use surface_mesh::{GltfProblem, SurfaceError, read_gltf};

#[test]
fn sparse_empty_and_missing_targets_are_read() {
    let morphed = read(&document()).unwrap();
    assert_eq!(morphed.surface.vertex_count(), 4);
    assert_eq!(morphed.surface.triangles(), [[0, 2, 1], [0, 1, 3]]);
    let names: Vec<_> = morphed.targets.iter().map(|t| t.name.as_str()).collect();
    assert_eq!(names, ["stretch", "nothing", "shading"]);
    let zero = Vector3::zeros();
    assert_eq!(
        morphed.targets[0].deltas,
        [
            zero,
            Vector3::new(0.5, 0.0, 0.0),
            zero,
            Vector3::new(0.0, 0.0, -0.25)
        ]
    );
    assert_eq!(morphed.targets[1].deltas, [zero; 4]);
    assert_eq!(morphed.targets[2].deltas, [zero; 4]);
}

#[test]
fn a_sparse_part_replaces_dense_values() {
    let mut document = document();
    document["accessors"][4]["bufferView"] = json!(0);
    let morphed = read(&document).unwrap();
    assert_eq!(morphed.targets[0].deltas[1], Vector3::new(0.5, 0.0, 0.0));
    assert_eq!(morphed.targets[0].deltas[2], Vector3::new(0.0, 1.0, 0.0));
}

#[test]
fn indices_of_every_width_are_read() {
    for accessor in 1..=3 {
        let morphed = read(&with("/meshes/0/primitives/0/indices", json!(accessor))).unwrap();
        assert_eq!(morphed.surface.triangles(), [[0, 2, 1], [0, 1, 3]]);
    }
}

#[test]
fn missing_indices_are_triples_in_order() {
    let mut document = document();
    document["accessors"][0]["count"] = json!(3);
    document["meshes"][0]["primitives"] = json!([{ "attributes": { "POSITION": 0 } }]);
    document["meshes"][0]["extras"] = json!({ "colour": "blue", "targetNames": [] });
    let morphed = read(&document).unwrap();
    assert_eq!(morphed.surface.triangles(), [[0, 1, 2]]);
    assert!(morphed.targets.is_empty());
}

#[test]
fn missing_names_are_numbered() {
    let morphed = read(&with("/meshes/0/extras", json!({ "targetNames": "none" }))).unwrap();
    assert_eq!(morphed.targets[2].name, "target_2");
}

#[test]
fn strided_views_are_read() {
    let mut document = document();
    // Every other vertex: a stride of 24 bytes over 36 bytes for two elements.
    document["bufferViews"][0] = json!({ "buffer": 0, "byteLength": 36, "byteStride": 24 });
    document["accessors"][0]["count"] = json!(2);
    document["meshes"][0] =
        json!({ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1 }] });
    let found = problem(&document);
    assert!(matches!(
        found,
        GltfProblem::IndexOutOfRange {
            triangle: 0,
            index: 2,
            vertices: 2,
            ..
        }
    ));
    document["accessors"][0]["count"] = json!(3);
    let found = problem(&document);
    assert!(matches!(
        found,
        GltfProblem::AccessorOutOfBounds {
            needed: 60,
            available: 36,
            ..
        }
    ));
}

#[test]
fn primitives_are_joined_in_order() {
    let mut document = document();
    let mut copy = document["accessors"][0].clone();
    copy["byteOffset"] = json!(0);
    document["accessors"].as_array_mut().unwrap().push(copy);
    let first = document["meshes"][0]["primitives"][0].clone();
    let mut shared = first.clone();
    shared["indices"] = json!(2);
    let mut own = first.clone();
    own["attributes"]["POSITION"] = json!(6);
    own["targets"][1]["POSITION"] = json!(4);
    document["meshes"][0]["primitives"] = json!([first, own, shared]);
    let morphed = read(&document).unwrap();
    // The second has vertices of its own, the third shares the first's.
    assert_eq!(morphed.surface.vertex_count(), 8);
    assert_eq!(
        morphed.surface.triangles(),
        [
            [0, 2, 1],
            [0, 1, 3],
            [4, 6, 5],
            [4, 5, 7],
            [0, 2, 1],
            [0, 1, 3]
        ]
    );
    assert_eq!(morphed.targets[1].deltas[1], Vector3::zeros());
    assert_eq!(morphed.targets[1].deltas[5], Vector3::new(0.5, 0.0, 0.0));
}

#[test]
fn transforms_of_the_node_and_its_parents_are_applied() {
    let half = 0.5_f64.sqrt() as f32;
    // Scale, turn by 90 degrees about z, shift; then the parent mirrors x.
    let nodes = json!([
        { "mesh": 0, "translation": [10, 0, 0], "rotation": [0, 0, half, half], "scale": [2, 2, 2] },
        { "children": [0], "matrix": [-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 5, 1] },
    ]);
    let morphed = read(&with("/nodes", nodes)).unwrap();
    let vertex = morphed.surface.vertices()[1];
    assert!(
        (vertex - Vector3::new(-10.0, 2.0, 5.0)).norm() < 1e-14,
        "{vertex}"
    );
    let delta = morphed.targets[0].deltas[1];
    assert!(
        (delta - Vector3::new(0.0, 1.0, 0.0)).norm() < 1e-15,
        "{delta}"
    );
    assert_eq!(morphed.surface.triangles(), [[0, 1, 2], [0, 3, 1]]);
}

#[test]
fn nodes_must_agree_on_the_place() {
    let same = json!([{ "mesh": 0, "scale": [2, 2, 2] }, { "mesh": 0, "scale": [2, 2, 2] }]);
    assert_eq!(
        read(&with("/nodes", same)).unwrap().surface.vertices()[1].x,
        2.0
    );
    check_problem!(
        "/nodes",
        [{ "mesh": 0 }, { "mesh": 0, "scale": [2, 2, 2] }],
        GltfProblem::SeveralPlacements { first: 0, second: 1 }
    );
    check_problem!("/nodes", [{ "mesh": 0, "children": [0] }], GltfProblem::NodeCycle { node: 0 });
    check_problem!("/nodes", [{ "mesh": 0, "children": [7] }], GltfProblem::Missing { kind: "node", index: 7, .. });
    check_problem!("/nodes", [{ "mesh": 0, "rotation": [0, 0, 0, 0] }], GltfProblem::BadTransform { node: 0 });
    // Skinned meshes are placed by their joints, not by their node.
    let skinned = json!([{ "mesh": 0, "skin": 0, "scale": [2, 2, 2] }]);
    assert_eq!(
        read(&with("/nodes", skinned)).unwrap().surface.vertices()[1].x,
        1.0
    );
    assert_eq!(
        read(&with("/nodes", json!([]))).unwrap().surface.vertices()[1].x,
        1.0
    );
}

fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let digit = |bits: u32, i: usize| DIGITS[(bits >> (18 - 6 * i) & 63) as usize] as char;
    assert_eq!(bytes.len() % 3, 0);
    let groups = bytes
        .chunks(3)
        .map(|b| u32::from_be_bytes([0, b[0], b[1], b[2]]));
    groups
        .flat_map(|bits| (0..4).map(move |i| digit(bits, i)))
        .collect()
}

#[test]
fn text_files_take_buffers_from_uris() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("test.gltf");
    let expected = read(&document()).unwrap();
    let read_with = |uri: &str| {
        let document = with("/buffers/0/uri", json!(uri));
        fs::write(&path, serde_json::to_vec_pretty(&document).unwrap()).unwrap();
        read_gltf(&path)
    };
    let data = format!("data:application/octet-stream;base64,{}", base64(&buffer()));
    assert_eq!(read_with(&data).unwrap(), expected);
    fs::write(folder.path().join("a b.bin"), buffer()).unwrap();
    assert_eq!(read_with("a%20b.bin").unwrap(), expected);

    let refused = |uri: &str| match read_with(uri) {
        Err(SurfaceError::Gltf { problem, .. }) => problem,
        other => panic!("{other:?}"),
    };
    assert!(matches!(
        refused("missing.bin"),
        GltfProblem::BufferFile { .. }
    ));
    assert!(matches!(
        refused("https://example.org/a.bin"),
        GltfProblem::BufferUri { .. }
    ));
    assert!(matches!(
        refused("/etc/passwd"),
        GltfProblem::BufferUri { .. }
    ));
    assert!(matches!(
        refused("data:text/plain,hello"),
        GltfProblem::BufferUri { .. }
    ));
    assert!(matches!(
        refused("data:;base64,AAAA*AAA"),
        GltfProblem::Base64 { offset: 4, .. }
    ));
    assert!(matches!(
        refused("data:;base64,AAAA"),
        GltfProblem::BufferTruncated { found: 3, .. }
    ));
    fs::write(&path, serde_json::to_vec(&document()).unwrap()).unwrap();
    assert!(matches!(
        read_gltf(&path),
        Err(SurfaceError::Gltf {
            problem: GltfProblem::NoBinaryChunk { buffer: 0 },
            ..
        })
    ));
}
