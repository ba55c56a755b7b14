//! The glTF reader on damaged files made by hand: each is refused with the place and the reason.

mod common;

use std::fs;

use common::{buffer, check_problem, document, glb, problem, read, with};
use serde_json::json;
use surface_mesh::{GltfProblem, SurfaceError, read_gltf};

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
