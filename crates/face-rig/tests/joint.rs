//! The joint against finite differences, its own adjoint, planted motions and the jaw motions of a real face.

use face_rig::{Joint, JointParameters, RigError};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use std::f64::consts::PI;

fn vector(scale: f64) -> impl Strategy<Value = Vector3<f64>> {
    prop::array::uniform3(-scale..scale).prop_map(Vector3::from)
}

fn parameters(angle: f64) -> impl Strategy<Value = JointParameters> {
    (-angle..angle, -angle..angle, vector(3.0))
        .prop_map(|(pitch, yaw, t)| [pitch, yaw, t.x, t.y, t.z])
}

fn dot(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}

fn difference(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    a.iter()
        .zip(b)
        .map(|(a, b)| (a - b).norm())
        .fold(0.0, f64::max)
}

/// Fourth-order central difference of `f` along `direction`.
fn slope(
    f: impl Fn(JointParameters) -> f64,
    at: JointParameters,
    direction: JointParameters,
) -> f64 {
    let step = 1e-3;
    let value = |factor: f64| {
        f(std::array::from_fn(|i| {
            at[i] + factor * step * direction[i]
        }))
    };
    (8.0 * (value(1.0) - value(-1.0)) - (value(2.0) - value(-2.0))) / (12.0 * step)
}

/// A pseudo-random but fixed set of points, some centimetres across.
fn jaw_points() -> Vec<Vector3<f64>> {
    (0..40)
        .map(|i| {
            let t = i as f64;
            Vector3::new(
                6.0 * (1.3 * t).sin(),
                -3.0 + 2.0 * (2.1 * t).cos(),
                5.0 + 4.0 * (0.7 * t).sin(),
            )
        })
        .collect()
}

proptest! {
    #[test]
    fn transform_follows_the_documented_formula(pivot in vector(10.0), theta in parameters(20.0), point in vector(10.0)) {
        let joint = Joint::new(pivot);
        let rotation = Rotation3::from_axis_angle(&Vector3::y_axis(), theta[1])
            * Rotation3::from_axis_angle(&Vector3::x_axis(), theta[0]);
        let expected = rotation * (point - pivot) + pivot + Vector3::new(theta[2], theta[3], theta[4]);
        prop_assert!((joint.positions(theta, &[point])[0] - expected).norm() < 1e-12);
        let by_transform = joint.transform(theta) * nalgebra::Point3::from(point);
        prop_assert!((by_transform.coords - expected).norm() < 1e-12);
    }

    #[test]
    fn pure_pitch_and_pure_yaw_are_groups(pivot in vector(10.0), first in -9.0..9.0_f64, second in -9.0..9.0_f64) {
        let joint = Joint::new(pivot);
        for axis in 0..2 {
            let turn = |angle: f64| {
                let mut theta = Joint::REST;
                theta[axis] = angle;
                joint.transform(theta)
            };
            let product = (turn(first) * turn(second)).to_homogeneous();
            prop_assert!((product - turn(first + second).to_homogeneous()).norm() < 1e-11);
            let there_and_back = (turn(first) * turn(-first)).to_homogeneous();
            prop_assert!((there_and_back - nalgebra::Matrix4::identity()).norm() < 1e-11);
        }
    }

    #[test]
    fn cotangent_passes_the_dot_product_and_slope_tests(
        pivot in vector(10.0), theta in parameters(20.0), direction in parameters(1.0), seed in 0.0..9.0_f64,
    ) {
        let joint = Joint::new(pivot);
        let points = jaw_points();
        let points_bar: Vec<_> = points.iter().map(|p| Vector3::new((p.x + seed).sin(), p.y.cos(), (p.z * seed).sin())).collect();
        let theta_bar = joint.vjp(theta, &points, &points_bar);
        let by_adjoint: f64 = theta_bar.iter().zip(direction).map(|(a, b)| a * b).sum();
        let by_tangent = dot(&points_bar, &joint.tangent(theta, direction, &points));
        let by_difference = slope(|at| dot(&points_bar, &joint.positions(at, &points)), theta, direction);
        let scale = 1.0 + theta_bar.iter().map(|v| v.abs()).sum::<f64>();
        prop_assert!((by_adjoint - by_tangent).abs() < 1e-13 * scale);
        prop_assert!((by_adjoint - by_difference).abs() < 1e-9 * scale, "{by_adjoint} {by_difference}");
    }

    #[test]
    fn transform_cotangent_passes_the_slope_test(
        pivot in vector(10.0), theta in parameters(20.0), direction in parameters(1.0),
        rotation_bar in prop::array::uniform9(-1.0..1.0), translation_bar in vector(1.0),
    ) {
        let joint = Joint::new(pivot);
        let rotation_bar = Matrix3::from_row_slice(&rotation_bar);
        let loss = |at: JointParameters| {
            let motion = joint.transform(at);
            rotation_bar.dot(motion.rotation.to_rotation_matrix().matrix()) + translation_bar.dot(&motion.translation.vector)
        };
        let theta_bar = joint.transform_vjp(theta, &rotation_bar, &translation_bar);
        let by_adjoint: f64 = theta_bar.iter().zip(direction).map(|(a, b)| a * b).sum();
        let scale = 1.0 + theta_bar.iter().map(|v| v.abs()).sum::<f64>();
        prop_assert!((by_adjoint - slope(loss, theta, direction)).abs() < 1e-9 * scale);
    }

    #[test]
    fn fit_recovers_planted_motions_of_any_angle(pivot in vector(10.0), theta in parameters(PI)) {
        let joint = Joint::new(pivot);
        let from = jaw_points();
        let to = joint.positions(theta, &from);
        let fit = joint.fit(&from, &to).unwrap();
        prop_assert!(fit.residual_max < 1e-12, "{fit:?}");
        prop_assert!(difference(&joint.positions(fit.parameters, &from), &to) < 1e-12);
        for (found, planted) in fit.parameters.iter().zip(theta) {
            prop_assert!((found - planted).abs() < 1e-12, "{fit:?}");
        }
        let by_motion = joint.fit_motion(&joint.transform(theta)).unwrap();
        for (found, planted) in by_motion.parameters.iter().zip(theta) {
            prop_assert!((found - planted).abs() < 1e-12, "{by_motion:?}");
        }
        prop_assert!(by_motion.residual_angle < 1e-7);
    }

    #[test]
    fn fit_is_the_global_minimum(pivot in vector(10.0), targets in prop::collection::vec(vector(5.0), 6)) {
        let joint = Joint::new(pivot);
        let from = &jaw_points()[..6];
        let fit = joint.fit(from, &targets).unwrap();
        let residual_at = |theta: JointParameters| {
            let moved = joint.positions(theta, from);
            let shift = (targets.iter().sum::<Vector3<f64>>() - moved.iter().sum::<Vector3<f64>>()) / 6.0;
            let squares: f64 = moved.iter().zip(&targets).map(|(a, b)| (a + shift - b).norm_squared()).sum();
            (squares / 6.0).sqrt()
        };
        prop_assert!((fit.residual_rms - residual_at(fit.parameters)).abs() < 1e-12);
        for pitch in 0..40 {
            for yaw in 0..40 {
                let theta = [PI * pitch as f64 / 20.0, PI * yaw as f64 / 20.0, 0.0, 0.0, 0.0];
                prop_assert!(fit.residual_rms <= residual_at(theta) + 1e-12);
            }
        }
        for axis in 0..5 {
            let mut direction = Joint::REST;
            direction[axis] = 1.0;
            let gradient = slope(|at| {
                let moved = joint.positions(at, from);
                moved.iter().zip(&targets).map(|(a, b)| (a - b).norm_squared()).sum()
            }, fit.parameters, direction);
            prop_assert!(gradient.abs() < 1e-7, "slope {gradient} along {axis}");
        }
    }

    #[test]
    fn pivot_of_a_hinge_is_found_on_its_axis(pivot in vector(10.0), angles in prop::collection::vec(0.1..0.5, 1..5)) {
        let joint = Joint::new(pivot);
        let motions: Vec<_> = angles.iter().map(|&a| joint.transform([a, 0.0, 0.0, 0.0, 0.0])).collect();
        let fit = Joint::fit_pivot(&motions, Vector3::zeros()).unwrap();
        prop_assert_eq!(fit.determined, 2);
        let expected = Vector3::new(0.0, pivot.y, pivot.z);
        prop_assert!((fit.joint.pivot - expected).norm() < 1e-11);
        prop_assert!(fit.slide_rms < 1e-12);
    }

    #[test]
    fn pivot_of_pitch_and_yaw_is_found_exactly(pivot in vector(10.0), pitch in 0.1..0.5, yaw in 0.1..0.5) {
        let joint = Joint::new(pivot);
        let motions = [joint.transform([pitch, 0.0, 0.0, 0.0, 0.0]), joint.transform([0.0, yaw, 0.0, 0.0, 0.0])];
        let fit = Joint::fit_pivot(&motions, Vector3::zeros()).unwrap();
        prop_assert_eq!(fit.determined, 3);
        prop_assert!((fit.joint.pivot - pivot).norm() < 1e-11);
    }
}

#[test]
fn rest_moves_nothing() {
    let joint = Joint::new(Vector3::new(1.0, -2.0, 3.0));
    assert_eq!(joint.transform(Joint::REST), Isometry3::identity());
    assert_eq!(
        difference(&joint.positions(Joint::REST, &jaw_points()), &jaw_points()),
        0.0
    );
}

#[test]
fn a_positive_pitch_opens_the_jaw() {
    let moved = Joint::new(Vector3::zeros()).positions([0.2, 0.0, 0.0, 0.0, 0.0], &[Vector3::z()]);
    assert!(moved[0].y < 0.0);
}

#[test]
fn angles_a_point_set_leaves_open_are_zero() {
    let joint = Joint::new(Vector3::new(1.0, 2.0, 3.0));
    let point = [Vector3::new(4.0, 5.0, 6.0)];
    let fit = joint.fit(&point, &[point[0] + Vector3::y()]).unwrap();
    assert_eq!(fit.parameters[..2], [0.0, 0.0]);
    assert!(fit.residual_max < 1e-14);

    let ear_to_ear = [Vector3::new(-2.0, 0.0, 0.0), Vector3::new(2.0, 0.0, 0.0)];
    let fit = joint.fit(&ear_to_ear, &ear_to_ear).unwrap();
    assert!(
        fit.parameters.iter().all(|value| value.abs() < 1e-14),
        "{fit:?}"
    );
}

#[test]
fn motions_without_rotation_leave_the_pivot_where_it_was() {
    let near = Vector3::new(1.0, 2.0, 3.0);
    let slide = Isometry3::translation(0.0, 0.0, 1.0);
    let fit = Joint::fit_pivot(&[slide, Isometry3::identity()], near).unwrap();
    assert_eq!((fit.joint.pivot, fit.determined), (near, 0));
    assert!((fit.slide_rms - 0.5_f64.sqrt()).abs() < 1e-15);
}

#[test]
fn bad_points_are_named() {
    let joint = Joint::new(Vector3::zeros());
    let two = [Vector3::zeros(), Vector3::x()];
    assert_eq!(
        joint.fit(&two, &two[..1]),
        Err(RigError::PointCount { from: 2, to: 1 })
    );
    assert_eq!(joint.fit(&[], &[]), Err(RigError::NoPoints));
    let bad = [Vector3::zeros(), Vector3::new(0.0, f64::INFINITY, 0.0)];
    assert_eq!(
        joint.fit(&two, &bad),
        Err(RigError::NonFinite {
            index: 1,
            value: f64::INFINITY
        })
    );
    assert_eq!(Joint::fit_pivot(&[], two[0]), Err(RigError::NoMotions));
}

/// All numbers of the array that follows `key`, for each time it occurs.
fn arrays(text: &str, key: &str) -> Vec<Vec<f64>> {
    text.split(key)
        .skip(1)
        .map(|rest| {
            let open = rest.find('[').unwrap() + 1;
            let close = rest.find(']').unwrap();
            rest[open..close]
                .split(',')
                .map(|number| number.trim().parse().unwrap())
                .collect()
        })
        .collect()
}

#[test]
fn the_jaw_of_a_real_face_is_a_joint() {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../../shared/data/face_ict/train_frames.json"
    );
    let Ok(text) = std::fs::read_to_string(path) else {
        eprintln!("skipped: the ICT face frames are not here");
        return;
    };
    let motions: Vec<Isometry3<f64>> = arrays(&text, "\"rotation_rowmajor\"")
        .iter()
        .zip(arrays(&text, "\"translation_cm\""))
        .map(|(rotation, t)| {
            let rotation = Rotation3::from_matrix(&Matrix3::from_row_slice(rotation));
            Isometry3::from_parts(
                Translation3::new(t[0], t[1], t[2]),
                UnitQuaternion::from_rotation_matrix(&rotation),
            )
        })
        .collect();
    assert_eq!(motions.len(), 27);
    let openings: Vec<_> = motions
        .iter()
        .filter(|motion| motion.rotation.angle() > 0.1)
        .copied()
        .collect();
    let pivot = Joint::fit_pivot(&openings, Vector3::zeros()).unwrap();
    let worst = motions
        .iter()
        .map(|motion| pivot.joint.fit_motion(motion).unwrap().residual_angle)
        .fold(0.0, f64::max);
    eprintln!(
        "pivot {:.3?} cm, slide {:.3} cm, roll {worst:.2e} rad",
        pivot.joint.pivot.as_slice(),
        pivot.slide_rms
    );
    // Two rotations suffice: what the joint cannot follow is far below the 0.1 mm that the data itself claims.
    assert!(worst < 1e-2);
    // The hinge lies behind and above the mouth, which is at y -3.45, z 10.3 cm.
    assert!(pivot.joint.pivot.y > -3.0 && pivot.joint.pivot.z < 8.0);
}
