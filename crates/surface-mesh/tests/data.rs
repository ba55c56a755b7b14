//! The project's faces, bodies and shapes, where they are present.

use std::path::{Path, PathBuf};

use surface_mesh::{MorphedSurface, Surface, read_obj, read_surface, report, write_glb};

const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data");

fn folder() -> Option<PathBuf> {
    let folder = Path::new(FOLDER);
    if !folder.is_dir() {
        eprintln!("skipped: the data set is not at {FOLDER}");
        return None;
    }
    Some(folder.into())
}

/// File, vertices, polygons where the data set's page states them, pieces, whether watertight.
const SURFACES: [(&str, usize, Option<usize>, Option<bool>); 21] = [
    ("face_ict/neutral_skin.obj", 14063, Some(14088), Some(true)),
    ("face_ict/teeth_upper.obj", 0, None, Some(true)),
    ("face_ict/teeth_lower.obj", 0, None, Some(true)),
    ("face_ict/gums_tongue.obj", 0, None, Some(false)),
    ("face_ict/eye_left.obj", 0, None, Some(true)),
    ("face_ict/eye_right.obj", 0, None, Some(true)),
    ("face_ict/skull_cranium.obj", 0, None, Some(true)),
    ("face_ict/mandible.obj", 0, None, Some(true)),
    ("face_makehuman/neutral_head.obj", 4494, None, Some(true)),
    ("face_makehuman/teeth_upper.obj", 68, None, Some(false)),
    ("face_makehuman/teeth_lower.obj", 68, None, Some(false)),
    ("face_makehuman/tongue.obj", 0, None, None),
    ("face_makehuman/eye_l.obj", 0, None, None),
    ("face_makehuman/eye_r.obj", 0, None, None),
    (
        "body_makehuman/neutral_body.obj",
        13380,
        Some(13378),
        Some(true),
    ),
    ("shapes/starfish.obj", 8436, None, Some(true)),
    ("shapes/starfish_lowres.obj", 1040, None, Some(true)),
    ("shapes/spot.obj", 11533, None, Some(true)),
    ("shapes/spot_lowres.obj", 829, None, Some(true)),
    ("shapes/penguin.obj", 3362, None, Some(true)),
    (
        "face_ict/train_units_lowres.glb",
        3002,
        Some(6000),
        Some(true),
    ),
];

#[test]
fn surfaces_are_as_the_data_set_states() {
    let Some(folder) = folder() else { return };
    for (name, vertices, polygons, watertight) in SURFACES {
        let morphed = read_surface(folder.join(name)).unwrap();
        let findings = report(&morphed.surface);
        println!("{name}: {findings}");
        if vertices > 0 {
            assert_eq!(morphed.surface.vertex_count(), vertices, "{name}");
        }
        if let Some(polygons) = polygons {
            assert_eq!(morphed.surface.polygon_count(), polygons, "{name}");
        }
        if let Some(watertight) = watertight {
            assert_eq!(findings.is_closed(), watertight, "{name}: {findings}");
            if watertight {
                assert!(findings.is_solid(), "{name}: {findings}");
            }
        }
    }
    let skin = report(&read_obj(folder.join("face_ict/neutral_skin.obj")).unwrap());
    assert_eq!((skin.triangles, skin.components.len()), (28122, 1));
    // Euler's formula for one closed piece: V - E + F = 2 - 2 genus, and E is 3 F / 2 for triangles.
    assert_eq!(skin.vertices as i64 - skin.triangles as i64 / 2, 2);
}

/// GLB, its neutral OBJ, number of targets, the first target.
const TARGETS: [(&str, &str, usize, &str); 5] = [
    (
        "face_ict/train_units.glb",
        "face_ict/neutral_skin.obj",
        37,
        "browDown_L",
    ),
    (
        "face_makehuman/train_units.glb",
        "face_makehuman/neutral_head.obj",
        34,
        "",
    ),
    (
        "body_makehuman/train_poses.glb",
        "body_makehuman/neutral_body.obj",
        12,
        "t_pose",
    ),
    (
        "shapes/starfish_train.glb",
        "shapes/starfish.obj",
        10,
        "all_up",
    ),
    (
        "shapes/starfish_lowres_train.glb",
        "shapes/starfish_lowres.obj",
        10,
        "all_up",
    ),
];

/// Largest difference of a coordinate between vertices of the same index.
fn mismatch(a: &Surface, b: &Surface) -> f64 {
    assert_eq!(a.vertex_count(), b.vertex_count());
    let differences = a
        .vertices()
        .iter()
        .zip(b.vertices())
        .map(|(a, b)| (a - b).amax());
    differences.fold(0.0, f64::max)
}

#[test]
fn glb_vertices_are_in_the_order_of_the_neutral_obj() {
    let Some(folder) = folder() else { return };
    for (glb, obj, count, first) in TARGETS {
        let morphed = read_surface(folder.join(glb)).unwrap();
        let neutral = read_obj(folder.join(obj)).unwrap();
        let mismatch = mismatch(&morphed.surface, &neutral);
        println!(
            "{glb}: mismatch {mismatch:e}, {:?}",
            morphed.targets[0].name
        );
        // The OBJ files have five decimals, the GLB files 24 bits.
        let rounding = 5e-6 + neutral.diagonal() * f64::from(f32::EPSILON);
        assert!(mismatch < rounding, "{glb}: {mismatch:e}");
        assert_eq!(
            morphed.surface.triangles().len(),
            neutral.triangles().len(),
            "{glb}"
        );
        assert_eq!(morphed.targets.len(), count, "{glb}");
        assert!(morphed.targets[0].name.starts_with(first), "{glb}");
        let moves = |m: &MorphedSurface| {
            m.targets
                .iter()
                .all(|t| t.deltas.iter().any(|d| d.norm() > 0.0))
        };
        assert!(moves(&morphed), "{glb}");
    }
}

#[test]
fn morph_targets_survive_writing_bit_for_bit() {
    let Some(folder) = folder() else { return };
    let scratch = tempfile::tempdir().unwrap();
    let path = scratch.path().join("again.glb");
    for (glb, ..) in TARGETS {
        let morphed = read_surface(folder.join(glb)).unwrap();
        write_glb(&path, &morphed).unwrap();
        assert_eq!(read_surface(&path).unwrap(), morphed, "{glb}");
    }
}
