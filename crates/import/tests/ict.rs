//! ICT-FaceKit, from a small mesh with a layout of its own.

mod common;

use common::{Files, Mesh, archive, folder, names, opened, tells, with};
use import::{ICT_FACEKIT, IctLayout, ImportError, import_ict_facekit};
use nalgebra::Vector3;
use surface_mesh::{read_obj, read_surface, report};

const NEUTRAL: &str = "FaceXModel/generic_neutral_mesh.obj";
const LICENCE: &str = "a licence of someone else\n";

/// A skin open at the bottom, and the other parts.
fn neutral() -> (Mesh, IctLayout) {
    let mut mesh = Mesh::default();
    let cube = [
        [-1.0, -1.0, -1.0],
        [1.0, -1.0, -1.0],
        [1.0, -1.0, 1.0],
        [-1.0, -1.0, 1.0],
        [-1.0, 1.0, -1.0],
        [1.0, 1.0, -1.0],
        [1.0, 1.0, 1.0],
        [-1.0, 1.0, 1.0],
    ];
    let sides: [&[usize]; 5] = [
        &[4, 7, 6, 5],
        &[0, 4, 5, 1],
        &[1, 5, 6, 2],
        &[2, 6, 7, 3],
        &[3, 7, 4, 0],
    ];
    let skin = mesh.add(&cube, &sides);
    let gums_tongue = mesh.add_tetrahedron([0.0, 0.0, 0.0]);
    let teeth_upper = mesh.add_tetrahedron([0.1, 0.3, 0.2]);
    let teeth_lower = mesh.add_tetrahedron([0.1, -0.3, 0.2]);
    let eye_left = mesh.add_tetrahedron([0.5, 0.5, 0.5]);
    let eye_right = mesh.add_tetrahedron([-0.5, 0.5, 0.5]);
    mesh.add_tetrahedron([0.0, 0.7, 0.7]);
    let layout = IctLayout {
        vertices: mesh.vertices.len(),
        skin,
        gums_tongue,
        teeth_upper,
        teeth_lower,
        eye_left,
        eye_right,
        expressions: &["browDown_L", "jawOpen"],
    };
    (mesh, layout)
}

fn source() -> (Files, IctLayout) {
    let (mesh, layout) = neutral();
    let unit = |change: &dyn Fn(&mut Mesh)| {
        let mut moved = mesh.clone();
        change(&mut moved);
        moved.obj()
    };
    let files = [
        (NEUTRAL, mesh.obj()),
        (
            "FaceXModel/jawOpen.obj",
            unit(&|m| {
                m.vertices[6] += Vector3::new(0.0, -0.25, 0.0);
                // Below the shortest delta.
                m.vertices[7] += Vector3::new(4e-4, 0.0, 0.0);
                for v in &mut m.vertices[layout.teeth_lower.clone()] {
                    *v = opened(v);
                }
            }),
        ),
        (
            "FaceXModel/browDown_L.obj",
            unit(&|m| m.vertices[5] += Vector3::new(0.0, 0.0, 0.125)),
        ),
        (
            "FaceXModel/cheekRaiser_L.obj",
            unit(&|m| m.vertices[4] += Vector3::new(0.5, 0.0, 0.0)),
        ),
        (
            "FaceXModel/tongueTwist.obj",
            unit(&|m| m.vertices[8] += Vector3::new(0.5, 0.0, 0.0)),
        ),
        // None of these is read.
        ("FaceXModel/eyeLookUp_L.obj", b"gaze".to_vec()),
        ("FaceXModel/PupilDilate_L.obj", b"pupil".to_vec()),
        ("FaceXModel/identity000.obj", b"identity".to_vec()),
        ("FaceXModel/vertex_indices.json", b"{}".to_vec()),
        ("LICENSE", LICENCE.into()),
    ];
    let files = files.map(|(name, bytes)| (name.to_string(), bytes));
    (files.to_vec(), layout)
}

#[test]
fn a_clone_becomes_a_face() {
    let (files, layout) = source();
    let place = folder(&files);
    let out = place.path().join("new/data");
    let summary = import_ict_facekit(&place.path().join("source"), &out, &layout).unwrap();
    let face = out.join("face_ict");
    assert_eq!(summary.folder, face);
    assert_eq!(names(&out), ["face_ict"]);
    assert_eq!(
        names(&face),
        [
            "LICENSE-ICT-FaceKit.txt",
            "eye_left.obj",
            "eye_right.obj",
            "gums_tongue.obj",
            "jaw_train.json",
            "neutral_skin.obj",
            "teeth_lower.obj",
            "teeth_upper.obj",
            "train_units.glb",
        ]
    );
    let licence = std::fs::read_to_string(face.join("LICENSE-ICT-FaceKit.txt")).unwrap();
    assert_eq!(licence, LICENCE);

    let (mesh, _) = neutral();
    let skin = read_obj(face.join("neutral_skin.obj")).unwrap();
    assert!(report(&skin).is_solid());
    assert_eq!(skin.vertices()[..8], mesh.vertices[..8]);
    assert_eq!(skin.vertices()[8], Vector3::new(0.0, -1.0, 0.0));
    assert!((skin.signed_volume() - 8.0).abs() < 1e-12);
    assert_eq!((summary.vertices, summary.polygons), (9, 5 + 4));
    assert_eq!(summary.holes, [4]);

    let units = read_surface(face.join("train_units.glb")).unwrap();
    let found: Vec<&str> = units.targets.iter().map(|t| t.name.as_str()).collect();
    assert_eq!(found, ["browDown_L", "cheekRaiser_L", "jawOpen"]);
    let mut expected = vec![Vector3::zeros(); 9];
    expected[6].y = -0.25;
    assert_eq!(units.targets[2].deltas, expected);
    assert_eq!(
        (summary.units, summary.still.as_slice()),
        (3, &["tongueTwist".to_string()][..])
    );

    let lower = read_obj(face.join("teeth_lower.obj")).unwrap();
    assert_eq!(lower.vertices(), &mesh.vertices[layout.teeth_lower]);
    let upper = read_obj(face.join("teeth_upper.obj")).unwrap();
    assert_eq!(upper.vertices(), &mesh.vertices[layout.teeth_upper]);

    assert_eq!(summary.jaw.len(), 1);
    let fit = summary.jaw["jawOpen"];
    for tooth in lower.vertices() {
        assert!((fit.rotation * tooth + fit.translation - opened(tooth)).norm() < 1e-12);
    }
    let text = summary.to_string();
    for part in [
        "9 vertices, 9 polygons",
        "1 (4 corners)",
        "units    3",
        "tongueTwist",
        "jawOpen: turned by 17.19 degrees",
        "0.000 mm (rms)",
    ] {
        assert!(text.contains(part), "no `{part}` in: {text}");
    }
}

#[test]
fn an_archive_and_the_inner_folder_do_as_well() {
    let (files, layout) = source();
    let place = folder(&files);
    let whole = place.path().join("whole");
    import_ict_facekit(&place.path().join("source"), &whole, &layout).unwrap();
    let inner = place.path().join("inner");
    import_ict_facekit(&place.path().join("source/FaceXModel"), &inner, &layout).unwrap();
    let (_keep, zip) = archive(&files, "ICT-FaceKit-master/");
    let zipped = place.path().join("zipped");
    import_ict_facekit(&zip, &zipped, &layout).unwrap();
    for name in names(&whole.join("face_ict")) {
        let bytes =
            |out: &std::path::Path| std::fs::read(out.join("face_ict").join(&name)).unwrap();
        assert_eq!(bytes(&whole), bytes(&inner), "{name}");
        assert_eq!(bytes(&whole), bytes(&zipped), "{name}");
    }
}

/// Importing these files fails, and leaves nothing behind.
#[track_caller]
fn refused(files: &Files, layout: &IctLayout, parts: &[&str]) -> ImportError {
    let place = folder(files);
    let out = place.path().join("out");
    let error = import_ict_facekit(&place.path().join("source"), &out, layout).unwrap_err();
    tells(&error, parts);
    assert_eq!(names(&out), [""; 0], "{error}");
    error
}

#[test]
fn bad_sources_are_refused_with_file_and_mend() {
    let (files, layout) = source();
    let other = |name: &str, bytes: Option<&[u8]>| with(&files, name, bytes);
    refused(
        &other(NEUTRAL, None),
        &layout,
        &["source", NEUTRAL, "ICT-VGL/ICT-FaceKit"],
    );
    refused(
        &other("FaceXModel/jawOpen.obj", None),
        &layout,
        &[
            "missing FaceXModel/jawOpen.obj",
            "source",
            "ICT-VGL/ICT-FaceKit",
        ],
    );
    refused(&other("LICENSE", None), &layout, &["missing LICENSE"]);
    refused(
        &other(
            "FaceXModel/jawOpen.obj",
            Some(b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n"),
        ),
        &layout,
        &["jawOpen.obj", "git lfs pull"],
    );
    refused(
        &other("FaceXModel/jawOpen.obj", Some(b"v 0 0\n")),
        &layout,
        &["jawOpen.obj:1:"],
    );
    let (mut mesh, _) = neutral();
    mesh.add_tetrahedron([0.0; 3]);
    refused(
        &other("FaceXModel/browDown_L.obj", Some(&mesh.obj())),
        &layout,
        &["browDown_L.obj", "36 vertices instead of 32", "edition"],
    );
    let (mut mesh, _) = neutral();
    mesh.polygons.push(vec![0, 1, 9]);
    refused(
        &other(NEUTRAL, Some(&mesh.obj())),
        &layout,
        &["generic_neutral_mesh.obj", "polygon 29", "part skin"],
    );
    refused(
        &files,
        &ICT_FACEKIT,
        &["FaceXModel/browDown_R.obj", "and 37 more"],
    );
}

#[test]
fn what_is_there_stays_as_it_is() {
    let (files, layout) = source();
    let place = folder(&files);
    let out = place.path().join("out");
    std::fs::create_dir_all(out.join("face_ict")).unwrap();
    std::fs::write(out.join("face_ict/mine"), "mine").unwrap();
    let error = import_ict_facekit(&place.path().join("source"), &out, &layout).unwrap_err();
    tells(&error, &["face_ict", "--out"]);
    assert_eq!(names(&out), ["face_ict"]);
    assert_eq!(names(&out.join("face_ict")), ["mine"]);
    let nowhere = place.path().join("nowhere");
    let error = import_ict_facekit(&nowhere, &place.path().join("b"), &layout).unwrap_err();
    tells(&error, &["cannot read", "nowhere"]);
    let text = place.path().join("text.zip");
    std::fs::write(&text, "no archive").unwrap();
    let error = import_ict_facekit(&text, &place.path().join("c"), &layout).unwrap_err();
    tells(&error, &["text.zip", "zip"]);
}

#[test]
fn the_published_layout_is_without_gaps() {
    let l = &ICT_FACEKIT;
    let parts = [
        &l.skin,
        &l.gums_tongue,
        &l.teeth_upper,
        &l.teeth_lower,
        &l.eye_left,
        &l.eye_right,
    ];
    assert_eq!(l.skin.start, 0);
    for pair in parts.windows(2) {
        assert_eq!(pair[0].end, pair[1].start);
    }
    // Behind the eyeballs: fluid, blend and occlusion meshes, eyelashes, in pairs.
    assert_eq!(l.vertices - l.eye_right.end, 2 * (204 + 24 + 152 + 684));
    assert!(l.expressions.is_sorted() && l.expressions.len() == 45);
}
