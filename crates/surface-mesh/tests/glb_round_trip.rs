//! GLB out and in again, and what damage does to such a file.

use std::fs;
use std::sync::LazyLock;

use nalgebra::Vector3;
use proptest::prelude::*;
use surface_mesh::{
    MorphTarget, MorphedSurface, Surface, SurfaceError, primitives, read_gltf, read_surface,
    write_glb,
};

fn single(x: f64) -> f64 {
    f64::from(x as f32)
}

fn rounded(vectors: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    vectors.iter().map(|v| v.map(single)).collect()
}

fn sample() -> MorphedSurface {
    let surface = primitives::icosphere(1, 1.0 / 3.0);
    let target = |name: &str, delta: fn(usize, &Vector3<f64>) -> Vector3<f64>| MorphTarget {
        name: name.into(),
        deltas: surface
            .vertices()
            .iter()
            .enumerate()
            .map(|(i, v)| delta(i, v))
            .collect(),
    };
    let targets = vec![
        target("dense", |_, v| v * 0.1),
        target("sparse \"quoted\" \u{e9}", |i, v| {
            if i % 5 == 2 {
                v.cross(&Vector3::x())
            } else {
                Vector3::zeros()
            }
        }),
        target("zero", |_, _| Vector3::zeros()),
        target("negative zero", |i, _| {
            Vector3::repeat(if i == 3 { -0.0 } else { 0.0 })
        }),
    ];
    MorphedSurface::new(surface, targets).unwrap()
}

#[test]
fn round_trips_are_exact_in_single_precision() {
    let folder = tempfile::tempdir().unwrap();
    let (once, twice) = (
        folder.path().join("once.glb"),
        folder.path().join("twice.GLB"),
    );
    let morphed = sample();
    write_glb(&once, &morphed).unwrap();
    let read = read_surface(&once).unwrap();
    assert_eq!(read.surface.triangles(), morphed.surface.triangles());
    assert_eq!(read.surface.vertices(), rounded(morphed.surface.vertices()));
    for (read, written) in read.targets.iter().zip(&morphed.targets) {
        assert_eq!(read.name, written.name);
        assert_eq!(read.deltas, rounded(&written.deltas));
    }
    assert!(read.targets[3].deltas[3].x.is_sign_negative());
    write_glb(&twice, &read).unwrap();
    assert_eq!(fs::read(&once).unwrap(), fs::read(&twice).unwrap());
    assert_eq!(fs::read_dir(&folder).unwrap().count(), 2);
}

#[test]
fn polygons_become_triangles_and_targets_may_be_absent() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("torus.glb");
    let torus = primitives::torus(2.0, 0.5, 12, 8);
    let mut plain = MorphedSurface::new(torus.clone(), Vec::new()).unwrap();
    plain.unit = Some("cm".into());
    write_glb(&path, &plain).unwrap();
    let read = read_gltf(&path).unwrap();
    assert_eq!(read.surface.triangles(), torus.triangles());
    assert!(read.targets.is_empty());
    assert_eq!(read.unit.as_deref(), Some("cm"));
}

/// 16-bit indices end at 65534, as 65535 is reserved.
#[test]
fn wide_indices_are_used_when_needed() {
    let folder = tempfile::tempdir().unwrap();
    for count in [65535_u32, 65536] {
        let path = folder.path().join(format!("{count}.glb"));
        let vertices = (0..count)
            .map(|i| Vector3::new(i.into(), 0.0, 1.0))
            .collect();
        let surface = Surface::from_triangles(vertices, vec![[0, 7, count - 1]]).unwrap();
        let mut deltas = vec![Vector3::zeros(); count as usize];
        deltas[count as usize - 1].y = 1.0;
        let name = "last".into();
        let morphed = MorphedSurface::new(surface, vec![MorphTarget { name, deltas }]).unwrap();
        write_glb(&path, &morphed).unwrap();
        assert_eq!(read_gltf(&path).unwrap(), morphed);
    }
}

#[test]
fn what_does_not_fit_is_refused_and_nothing_is_left_behind() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("huge.glb");
    fs::write(&path, "precious").unwrap();
    let mut morphed = sample();
    morphed.surface.vertices_mut()[5].y = 1e39;
    let error = write_glb(&path, &morphed).unwrap_err();
    assert!(
        matches!(error, SurfaceError::BeyondF32 { vertex: 5, .. }),
        "{error}"
    );
    morphed = sample();
    morphed.targets[1].deltas.pop();
    assert!(matches!(
        write_glb(&path, &morphed),
        Err(SurfaceError::TargetLength { .. })
    ));
    assert_eq!(fs::read(&path).unwrap(), b"precious");
    assert_eq!(fs::read_dir(&folder).unwrap().count(), 1);
}

/// A small file with two targets, to damage.
static SMALL: LazyLock<Vec<u8>> = LazyLock::new(small);

fn small() -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("small.glb");
    let mut morphed = sample();
    morphed.surface = primitives::icosphere(0, 1.0);
    morphed.targets.truncate(2);
    for target in &mut morphed.targets {
        target.deltas.truncate(12);
    }
    write_glb(&path, &morphed).unwrap();
    fs::read(&path).unwrap()
}

#[test]
fn truncation_at_every_byte_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cut.glb");
    let whole = &*SMALL;
    for length in 0..whole.len() {
        fs::write(&path, &whole[..length]).unwrap();
        assert!(
            read_gltf(&path).is_err(),
            "cut to {length} of {} bytes",
            whole.len()
        );
    }
    // The same with the header's length made to agree, so that the chunks are what is cut.
    for length in 12..whole.len() {
        let mut cut = whole[..length].to_vec();
        cut[8..12].copy_from_slice(&(length as u32).to_le_bytes());
        fs::write(&path, cut).unwrap();
        assert!(
            read_gltf(&path).is_err(),
            "cut to {length} of {} bytes",
            whole.len()
        );
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn damaged_bytes_never_panic(places in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4)) {
        let mut bytes = SMALL.clone();
        for (place, value) in places {
            let place = place.index(bytes.len());
            bytes[place] = value;
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("damaged.glb");
        fs::write(&path, bytes).unwrap();
        if let Ok(morphed) = read_gltf(&path) {
            prop_assert!(morphed.surface.vertices().iter().flatten().all(|x| x.is_finite()));
        }
    }
}
