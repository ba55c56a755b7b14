//! Files made to do harm: each is refused, without the memory, the stack or the files that it is after.

mod common;

use std::fs;
use std::path::Path;

use common::{document, glb, problem, read, with};
use serde_json::{Value, json};
use surface_mesh::{GltfProblem, SurfaceError, parse_gltf, parse_obj, read_gltf, write_obj};

/// With a view, without one, and in targets alone: nothing backs four billion vertices, which would need 100 GB.
#[test]
fn a_glb_of_four_billion_vertices_is_refused_at_once() {
    let count = json!(u32::MAX);
    let mut all = document();
    for accessor in [0, 4, 5] {
        all["accessors"][accessor]["count"] = count.clone();
    }
    let mut unbacked = all.clone();
    let accessor = unbacked["accessors"][0].as_object_mut().unwrap();
    accessor.remove("bufferView");
    for hostile in [&all, &unbacked] {
        assert!(matches!(problem(hostile), GltfProblem::Unbacked { .. }));
    }
    let one = with("/accessors/0/count", count);
    assert!(matches!(problem(&one), GltfProblem::TargetLength { .. }));
    let indices = with("/accessors/1/count", json!(u32::MAX));
    assert!(matches!(problem(&indices), GltfProblem::Unbacked { .. }));
}

/// A hundred megabytes of zeros could ask for a hundred gigabytes of deltas: once, 1024 bytes of memory were believed per byte of file.
#[test]
fn empty_targets_do_not_multiply_a_file_beyond_belief() {
    let mut many = document();
    let vertices = 100_000;
    for accessor in [0, 4, 5] {
        many["accessors"][accessor]["count"] = json!(vertices);
    }
    many["bufferViews"][0] = json!({ "buffer": 0, "byteLength": 12 * vertices });
    many["buffers"][0]["byteLength"] = json!(12 * vertices);
    many["meshes"][0]["extras"] = json!(null);
    let zeros = vec![0; 12 * vertices];
    let with_targets = |count: usize| {
        let mut document = many.clone();
        document["meshes"][0]["primitives"][0]["targets"] =
            vec![json!({ "POSITION": 5 }); count].into();
        let (_folder, path) = glb(&document, &zeros);
        read_gltf(path)
    };
    // As many as a face has units are fine, though none of them has a byte of its own.
    assert_eq!(with_targets(20).unwrap().targets.len(), 20);
    match with_targets(300) {
        Err(SurfaceError::Gltf {
            problem: GltfProblem::Unbacked { .. },
            ..
        }) => {}
        other => panic!("{:?}", other.map(|m| m.targets.len())),
    }
}

#[test]
fn json_that_is_nested_without_end_is_refused_before_the_stack_ends() {
    for (open, close) in [("[", "]"), ("{\"a\":", "}")] {
        let deep = open.repeat(200_000) + "0" + &close.repeat(200_000);
        for text in [
            format!("{{\"asset\":{{\"version\":\"2.0\"}},\"nodes\":{deep}}}"),
            format!("{{\"asset\":{{\"version\":\"2.0\"}},\"extras\":{deep}}}"),
            format!("{{\"asset\":{{\"version\":\"2.0\",\"extras\":{deep}}}}}"),
            format!("{{\"unknown\":{deep}"),
        ] {
            let refused = parse_gltf(text.as_bytes(), "deep.gltf").unwrap_err();
            assert!(matches!(refused, SurfaceError::Gltf { .. }), "{refused}");
        }
    }
}

#[test]
fn nodes_in_a_circle_are_refused() {
    for circle in [json!([[0]]), json!([[1], [0]]), json!([[1], [2], [0]])] {
        let mut cyclic = document();
        let children = circle.as_array().unwrap();
        let nodes: Value = children
            .iter()
            .map(|c| json!({ "children": c, "mesh": 0 }))
            .collect();
        cyclic["nodes"] = nodes;
        assert!(
            matches!(problem(&cyclic), GltfProblem::NodeCycle { .. }),
            "{circle}"
        );
    }
    let mut beyond = document();
    beyond["nodes"][0]["children"] = json!([u32::MAX]);
    assert!(matches!(
        problem(&beyond),
        GltfProblem::Missing { kind: "node", .. }
    ));
}

#[test]
fn references_out_of_range_are_refused_wherever_they_stand() {
    let far = json!(4_000_000_000_u32);
    for pointer in [
        "/meshes/0/primitives/0/attributes/POSITION",
        "/meshes/0/primitives/0/indices",
        "/meshes/0/primitives/0/targets/0/POSITION",
        "/accessors/0/bufferView",
        "/accessors/4/sparse/indices/bufferView",
        "/accessors/4/sparse/values/bufferView",
        "/bufferViews/0/buffer",
    ] {
        let found = problem(&with(pointer, far.clone()));
        assert!(
            matches!(found, GltfProblem::Missing { .. }),
            "{pointer}: {found:?}"
        );
    }
    for pointer in [
        "/bufferViews/0/byteOffset",
        "/bufferViews/0/byteLength",
        "/accessors/0/byteOffset",
    ] {
        for value in [json!(121), json!(u32::MAX), json!(u64::MAX)] {
            assert!(
                read(&with(pointer, value.clone())).is_err(),
                "{pointer} {value}"
            );
        }
    }
}

/// The bytes of a buffer turn up as coordinates in all that is written: a file from elsewhere must not name other files of this machine.
#[test]
fn a_buffer_that_climbs_out_of_the_folder_is_not_read() {
    let outer = tempfile::tempdir().unwrap();
    fs::write(outer.path().join("secret.bin"), common::buffer()).unwrap();
    let folder = outer.path().join("models");
    fs::create_dir_all(folder.join("parts")).unwrap();
    fs::write(folder.join("parts/own.bin"), common::buffer()).unwrap();
    let path = folder.join("a.gltf");
    let read_from = |uri: &str| {
        let document = with("/buffers/0/uri", json!(uri));
        fs::write(&path, serde_json::to_vec(&document).unwrap()).unwrap();
        read_gltf(&path)
    };
    read_from("parts/own.bin").unwrap();
    read_from("./parts/own.bin").unwrap();
    let absolute = outer.path().join("secret.bin");
    for uri in [
        "../secret.bin",
        "%2e%2e/secret.bin",
        "parts/../../secret.bin",
        "parts/..%2F..%2Fsecret.bin",
        "..\\secret.bin",
        "file:../secret.bin",
        absolute.to_str().unwrap(),
    ] {
        match read_from(uri) {
            Err(SurfaceError::Gltf { problem, .. }) => {
                assert!(
                    matches!(problem, GltfProblem::BufferUri { .. }),
                    "{uri}: {problem}"
                );
                assert!(problem.to_string().contains("put the file there"));
            }
            other => panic!("{uri}: {other:?}"),
        }
    }
}

/// What stands under the name of an output is replaced, a symbolic link as well; what the link points to is nobody's output.
#[cfg(unix)]
#[test]
fn an_output_replaces_a_symbolic_link_and_spares_what_it_points_to() {
    let folder = tempfile::tempdir().unwrap();
    let (precious, link) = (
        folder.path().join("precious"),
        folder.path().join("out.obj"),
    );
    fs::write(&precious, "mine").unwrap();
    let surface = surface_mesh::primitives::icosphere(0, 1.0);
    for target in [precious.as_path(), Path::new("dangling")] {
        std::os::unix::fs::symlink(target, &link).unwrap();
        write_obj(&link, &surface).unwrap();
        assert!(!link.is_symlink());
        assert!(fs::read_to_string(&link).unwrap().contains("\nv "));
        fs::remove_file(&link).unwrap();
    }
    assert_eq!(fs::read_to_string(&precious).unwrap(), "mine");
    assert!(!folder.path().join("dangling").exists());
}

/// Corners that name vertices not read yet cost 16 bytes each, eight times their text, until only those beyond all others were kept.
#[test]
fn the_first_vertex_that_is_missing_is_told_though_few_are_remembered() {
    let told = |text: &str| parse_obj(text.as_bytes(), "a.obj").unwrap_err().to_string();
    assert!(told("f 1 2 3\nf 9 8 9\nf 10 9 9\nv 0 0 0\n").starts_with("a.obj:1: vertex 2 "));
    assert!(told("f 1 1 1\nf 9 8 9\nf 10 9 9\nv 0 0 0\n").starts_with("a.obj:2: vertex 9 "));
    parse_obj(b"f 3 2 1\nf 1 2 3\nv 0 0 0\nv 1 0 0\nv 0 1 0\n", "a.obj").unwrap();
}
