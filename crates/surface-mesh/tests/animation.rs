//! Animated GLB files, read back as a viewer reads them.

use std::fs;
use std::path::Path;

use gltf::animation::util::ReadOutputs;
use gltf::animation::{Interpolation, Property};
use nalgebra::Vector3;
use surface_mesh::{
    AnimationProblem, FrameAnimation, MorphTarget, MorphedSurface, SurfaceError, primitives,
    read_gltf, write_animated_glb,
};

/// A ball with one frame at rest, one that moves a single vertex, and more that move all of them.
fn frames(count: usize) -> MorphedSurface {
    let surface = primitives::icosphere(1, 1.0);
    let target = |i: usize| MorphTarget {
        name: format!("frame-{i:04}"),
        deltas: (surface.vertices().iter().enumerate())
            .map(|(vertex, x)| match i {
                0 => Vector3::zeros(),
                1 if vertex != 7 => Vector3::zeros(),
                _ => Vector3::new(0.25 * i as f64, x.y, -0.5),
            })
            .collect(),
    };
    let targets = (0..count).map(target).collect();
    MorphedSurface::new(surface, targets).unwrap()
}

fn animation(times: &[f64], smooth: bool) -> FrameAnimation {
    FrameAnimation {
        name: "performance".into(),
        times: times.to_vec(),
        smooth,
    }
}

/// Times and weights of the only animation of a file, and its interpolation.
fn read_animation(path: &Path) -> (Vec<f32>, Vec<f32>, Interpolation) {
    let file = gltf::Gltf::open(path).unwrap();
    let animation = file.animations().next().unwrap();
    assert_eq!(animation.name(), Some("performance"));
    let channels: Vec<_> = animation.channels().collect();
    assert_eq!(channels.len(), 1);
    let channel = &channels[0];
    assert_eq!(channel.target().property(), Property::MorphTargetWeights);
    let mesh = channel.target().node().mesh().unwrap();
    assert_eq!(mesh.index(), 0);
    let reader = channel.reader(|_| file.blob.as_deref());
    let times: Vec<f32> = reader.read_inputs().unwrap().collect();
    let Some(ReadOutputs::MorphTargetWeights(weights)) = reader.read_outputs() else {
        panic!("outputs that are no weights");
    };
    let weights: Vec<f32> = weights.into_f32().collect();
    let input = channel.sampler().input();
    let bound = |value: Option<gltf::json::Value>| value.unwrap()[0].as_f64().unwrap();
    assert_eq!(bound(input.min()), f64::from(times[0]));
    assert_eq!(bound(input.max()), f64::from(times[times.len() - 1]));
    let output = channel.sampler().output();
    let targets = mesh.primitives().next().unwrap().morph_targets().len();
    assert_eq!(input.count(), targets);
    assert_eq!(output.count(), targets * times.len());
    (times, weights, channel.sampler().interpolation())
}

#[test]
fn each_time_shows_one_frame() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("animation.glb");
    for count in [1, 2, 7] {
        let morphed = frames(count);
        let times: Vec<f64> = (0..count).map(|i| i as f64 / 24.0).collect();
        for (smooth, expected) in [(true, Interpolation::Linear), (false, Interpolation::Step)] {
            write_animated_glb(&path, &morphed, &animation(&times, smooth)).unwrap();
            let (read, weights, interpolation) = read_animation(&path);
            assert_eq!(interpolation, expected);
            assert!(read.is_sorted_by(|a, b| a < b));
            let single = times.iter().map(|&t| t as f32);
            assert!(read.iter().copied().eq(single));
            for (i, at_time) in weights.chunks(count).enumerate() {
                let shown = at_time.iter().enumerate();
                assert!(
                    shown
                        .clone()
                        .all(|(j, &w)| w == if i == j { 1.0 } else { 0.0 })
                );
            }
            assert_eq!(read_gltf(&path).unwrap().targets.len(), count);
        }
    }
}

#[test]
fn targets_come_back_and_are_sparse_where_that_is_smaller() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("animation.glb");
    let morphed = frames(4);
    write_animated_glb(&path, &morphed, &animation(&[0.0, 0.5, 1.0, 3.0], true)).unwrap();
    let read = read_gltf(&path).unwrap();
    for (read, written) in read.targets.iter().zip(&morphed.targets) {
        assert_eq!(read.name, written.name);
        let single = |v: &Vector3<f64>| v.map(|x| f64::from(x as f32));
        assert!(
            read.deltas
                .iter()
                .copied()
                .eq(written.deltas.iter().map(single))
        );
    }
    let file = gltf::Gltf::open(&path).unwrap();
    let primitive = file.meshes().next().unwrap().primitives().next().unwrap();
    let targets = primitive.morph_targets();
    let sparse = targets.map(|t| t.positions().unwrap().sparse().map(|s| s.count()));
    // A frame at rest has no view and one entry: readers disagree on accessors with nothing at all.
    assert!(sparse.eq([Some(1), Some(1), None, None]));
}

#[test]
fn what_does_not_fit_is_refused_and_nothing_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("animation.glb");
    let problem = |count: usize, times: &[f64]| {
        let refused = write_animated_glb(&path, &frames(count), &animation(times, true));
        match refused.unwrap_err() {
            SurfaceError::Animation { name, problem, .. } => {
                assert_eq!(name, "performance");
                problem
            }
            other => panic!("{other}"),
        }
    };
    assert_eq!(problem(0, &[]), AnimationProblem::NoFrames);
    let count = AnimationProblem::TimeCount {
        times: 2,
        targets: 3,
    };
    assert_eq!(problem(3, &[0.0, 1.0]), count);
    let nan = problem(2, &[0.0, f64::NAN]);
    assert!(matches!(nan, AnimationProblem::Time { frame: 1, .. }));
    for (times, frame) in [
        ([-1.0, 1.0], 0),
        ([0.0, 1e300], 1),
        ([1.0, 1.0], 1),
        ([1.0, 0.5], 1),
        // Too close for 32-bit floats.
        ([1e6, 1e6 + 1e-3], 1),
    ] {
        let time = times[frame];
        assert_eq!(problem(2, &times), AnimationProblem::Time { frame, time });
    }
    assert_eq!(fs::read_dir(&folder).unwrap().count(), 0);
}
