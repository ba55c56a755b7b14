//! The glTF reader on files made by hand, legal and damaged.

use std::fs;
use std::path::PathBuf;

use nalgebra::Vector3;
use serde_json::{Value, json};
use surface_mesh::{GltfProblem, MorphedSurface, SurfaceError, read_gltf};
use tempfile::TempDir;

/// A document and its only buffer, written as GLB.
fn glb(document: &Value, buffer: &[u8]) -> (TempDir, PathBuf) {
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

fn read(document: &Value) -> Result<MorphedSurface, SurfaceError> {
    let (_folder, path) = glb(document, &buffer());
    read_gltf(path)
}

/// Four positions (48 bytes), then 6 indices as bytes (6), 16-bit (12) and 32-bit (24) numbers from 48, then two sparse
/// indices (bytes 1, 3) at 92 and two deltas (24) at 96.
fn buffer() -> Vec<u8> {
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

fn document() -> Value {
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
fn with(pointer: &str, value: Value) -> Value {
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
fn problem(document: &Value) -> GltfProblem {
    match read(document) {
        Err(SurfaceError::Gltf { problem, .. }) => problem,
        other => panic!("{other:?}"),
    }
}

macro_rules! check_problem {
    ($pointer:expr, $value:tt, $pattern:pat) => {{
        let found = problem(&with($pointer, json!($value)));
        assert!(matches!(found, $pattern), "{}: {found:?}", $pointer);
    }};
}

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

#[test]
fn damaged_accessors_are_refused() {
    use GltfProblem as P;
    check_problem!(
        "/accessors/0/count",
        5,
        P::TargetLength {
            target: 0,
            expected: 5,
            found: 4,
            ..
        }
    );
    check_problem!(
        "/accessors/1/count",
        7,
        P::AccessorOutOfBounds {
            accessor: 1,
            view: 1,
            needed: 7,
            available: 6
        }
    );
    check_problem!(
        "/accessors/1/count",
        9007199254740993_u64,
        P::Unbacked { .. }
    );
    check_problem!("/accessors/1/count", 5, P::IndexCount { count: 5, .. });
    check_problem!(
        "/accessors/1/byteOffset",
        18446744073709551615_u64,
        P::AccessorOutOfBounds { .. }
    );
    check_problem!(
        "/accessors/1/componentType",
        5126,
        P::AccessorType { accessor: 1, .. }
    );
    check_problem!(
        "/accessors/1/componentType",
        1,
        P::AccessorType { accessor: 1, .. }
    );
    check_problem!(
        "/accessors/0/componentType",
        5125,
        P::AccessorType { accessor: 0, .. }
    );
    check_problem!(
        "/accessors/0/type",
        "VEC4",
        P::AccessorType { accessor: 0, .. }
    );
    check_problem!(
        "/accessors/0/bufferView",
        9,
        P::Missing {
            kind: "buffer view",
            index: 9,
            count: 6
        }
    );
    check_problem!(
        "/accessors/0/byteOffset",
        4,
        P::AccessorOutOfBounds { accessor: 0, .. }
    );
    check_problem!(
        "/bufferViews/0/buffer",
        1,
        P::Missing { kind: "buffer", .. }
    );
    check_problem!(
        "/bufferViews/0/byteOffset",
        100,
        P::ViewOutOfBounds {
            view: 0,
            needed: 148,
            available: 120,
            ..
        }
    );
    check_problem!(
        "/bufferViews/0/byteLength",
        18446744073709551615_u64,
        P::ViewOutOfBounds { .. }
    );
    check_problem!(
        "/bufferViews/0/byteStride",
        8,
        P::BadStride {
            view: 0,
            stride: 8,
            element: 12
        }
    );
    check_problem!("/bufferViews/0/byteStride", 0, P::BadStride { .. });
    check_problem!(
        "/buffers/0/byteLength",
        121,
        P::BufferTruncated {
            declared: 121,
            found: 120,
            ..
        }
    );
    check_problem!("/buffers", [], P::Missing { kind: "buffer", .. });
}

#[test]
fn damaged_sparse_parts_are_refused() {
    use GltfProblem as P;
    // Byte 90 on is 0, 0, 1, 3: not rising; byte 94 on is 0, 0: not rising; from 93 on it is 3, 0.
    for (offset, entry) in [(90, 1), (93, 1), (94, 1)] {
        let found = problem(&with("/bufferViews/4/byteOffset", json!(offset)));
        assert!(
            matches!(found, P::SparseOrder { accessor: 4, entry: e } if e == entry),
            "{found:?}"
        );
    }
    let mut short = document();
    short["accessors"][0]["count"] = json!(3);
    short["accessors"][4]["count"] = json!(3);
    short["accessors"][5]["count"] = json!(3);
    assert!(matches!(
        problem(&short),
        P::SparseRange {
            accessor: 4,
            index: 3,
            count: 3
        }
    ));
    check_problem!(
        "/accessors/4/sparse/count",
        3,
        P::AccessorOutOfBounds {
            accessor: 4,
            view: 4,
            ..
        }
    );
    check_problem!(
        "/accessors/4/sparse/values/bufferView",
        4,
        P::AccessorOutOfBounds {
            accessor: 4,
            view: 4,
            ..
        }
    );
    check_problem!(
        "/accessors/4/sparse/indices/componentType",
        5126,
        P::AccessorType { accessor: 4, .. }
    );
}

#[test]
fn damaged_meshes_are_refused() {
    use GltfProblem as P;
    check_problem!("/meshes", [], P::NoMesh);
    check_problem!("/meshes/0/primitives", [], P::NoMesh);
    check_problem!(
        "/meshes/0/primitives/0/mode",
        5,
        P::NotTriangles { primitive: 0 }
    );
    check_problem!(
        "/meshes/0/primitives/0/mode",
        99,
        P::NotTriangles { primitive: 0 }
    );
    check_problem!("/meshes/0/primitives/0/attributes", { "NORMAL": 0 }, P::NoPositions { primitive: 0 });
    check_problem!(
        "/meshes/0/primitives/0/attributes/POSITION",
        77,
        P::Missing {
            kind: "accessor",
            index: 77,
            count: 6
        }
    );
    check_problem!(
        "/meshes/0/extras/targetNames",
        ["one"],
        P::TargetNames {
            names: 1,
            targets: 3
        }
    );
    check_problem!(
        "/extensionsRequired",
        ["KHR_draco_mesh_compression"],
        P::RequiredExtension { .. }
    );
    read(&with("/extensionsRequired", json!(["KHR_materials_unlit"]))).unwrap();

    let mut uneven = document();
    let mut second = uneven["meshes"][0]["primitives"][0].clone();
    second["targets"].as_array_mut().unwrap().pop();
    uneven["meshes"][0]["primitives"]
        .as_array_mut()
        .unwrap()
        .push(second);
    assert!(matches!(
        problem(&uneven),
        P::TargetCount {
            primitive: 1,
            expected: 3,
            found: 2
        }
    ));

    let mut two = document();
    two["meshes"] = json!([
        { "name": "head", "primitives": [] }, { "primitives": [] },
    ]);
    let text = problem(&two).to_string();
    assert_eq!(
        text,
        "the file has 2 meshes (head, mesh 1); export only one of them"
    );
}

#[test]
fn values_that_are_not_finite_are_refused() {
    let mut bytes = buffer();
    bytes[12..16].copy_from_slice(&f32::NAN.to_le_bytes());
    let (_folder, path) = glb(&document(), &bytes);
    let error = read_gltf(&path).unwrap_err().to_string();
    assert!(
        error.ends_with("element 1 of accessor 0 is not finite: (NaN, 0, 0)"),
        "{error}"
    );
}

/// Counts that nothing backs must not be allocated first: these would need terabytes.
#[test]
fn huge_counts_allocate_nothing() {
    let mut huge = document();
    for accessor in [0, 4, 5] {
        huge["accessors"][accessor]["count"] = json!(1_u64 << 40);
    }
    huge["accessors"][0]
        .as_object_mut()
        .unwrap()
        .remove("bufferView");
    assert!(matches!(problem(&huge), GltfProblem::Unbacked { .. }));

    // One dense target, named a hundred thousand times.
    let mut repeated = document();
    let targets = vec![json!({ "POSITION": 0 }); 100_000];
    repeated["meshes"][0]["primitives"][0]["targets"] = json!(targets);
    repeated["meshes"][0]["extras"] = json!(null);
    assert_eq!(read(&repeated).unwrap().targets.len(), 100_000);
    for accessor in [0, 4, 5] {
        repeated["accessors"][accessor]["count"] = json!(1_000_000);
    }
    assert!(matches!(problem(&repeated), GltfProblem::Unbacked { .. }));
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

#[test]
fn other_files_are_told_apart() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("test.glb");
    let refused = |bytes: &[u8]| {
        fs::write(&path, bytes).unwrap();
        match read_gltf(&path) {
            Err(SurfaceError::Gltf { problem, .. }) => problem,
            other => panic!("{other:?}"),
        }
    };
    assert!(matches!(
        refused(b"\x89PNG\r\n"),
        GltfProblem::WrongMagic { .. }
    ));
    assert!(matches!(
        refused(b""),
        GltfProblem::Truncated {
            expected: 12,
            found: 0,
            ..
        }
    ));
    assert!(matches!(
        refused(b"{ \"asset\": "),
        GltfProblem::Json { .. }
    ));
    assert!(matches!(
        refused(b"glTF\x01\0\0\0\x0c\0\0\0"),
        GltfProblem::Version { version: 1 }
    ));
    assert!(matches!(
        refused(b"glTF\x02\0\0\0\x05\0\0\0"),
        GltfProblem::Truncated { .. }
    ));
    assert!(matches!(
        refused(b"glTF\x02\0\0\0\xff\xff\xff\xff"),
        GltfProblem::Truncated { .. }
    ));
    assert!(matches!(
        refused(b"glTF\x02\0\0\0\x14\0\0\0\0\0\0\0BIN\0"),
        GltfProblem::WrongChunk
    ));
    assert!(matches!(
        read_gltf("no/such.glb"),
        Err(SurfaceError::Read { .. })
    ));
}
