//! The polar rotation: what defines it, agreement of the fast path with the SVD, conventions.

use super::{distance_from_rotation, normalised};
use crate::polar::{certified_rotation, rotation_step};
use crate::testing::{Random, hard_cases, planted};
use crate::{polar, polar_rotation, signed_svd};
use nalgebra::{Matrix3, Vector3};
use proptest::prelude::*;

/// Asserts what defines the polar rotation; returns it.
fn check(m: &Matrix3<f64>) -> Matrix3<f64> {
    let r = polar_rotation(m);
    assert!(
        distance_from_rotation(&r) < 4e-15,
        "not a rotation: {r} of {m}"
    );
    let scaled = normalised(m);
    let s = r.transpose() * scaled;
    let asymmetry = (s - s.transpose()).amax();
    assert!(
        asymmetry <= 8e-15 * scaled.amax(),
        "asymmetry {asymmetry:e} of {m}"
    );
    let smallest = (Matrix3::identity() * s.trace() - (s + s.transpose()) * 0.5)
        .symmetric_eigenvalues()
        .min();
    assert!(
        smallest >= -8e-15 * scaled.amax(),
        "not the nearest rotation: {smallest:e} of {m}"
    );
    r
}

#[test]
fn hard_classes() {
    for (name, case) in hard_cases(40) {
        let r = check(&case.matrix);
        let gap = (case.sigma.y + case.sigma.z) / case.sigma.x;
        if gap > 0.0 {
            let error = (r - case.u * case.v.transpose()).amax();
            assert!(
                error <= 4e-15 + 5e-15 / gap,
                "{name}: error {error:e} at gap {gap:e}"
            );
        }
    }
}

#[test]
fn fast_path_serves_ordinary_deformations() {
    let mut random = Random::new(1);
    let mut worst: f64 = 0.0;
    let mut missed = 0;
    for _ in 0..100_000 {
        let m = random.rotation() * (Matrix3::identity() + random.matrix() * 0.5);
        let exact = signed_svd(&m);
        match certified_rotation(&m) {
            Some(r) => {
                worst = worst.max(
                    (r - exact.rotation()).amax() * (exact.sigma.y + exact.sigma.z) / exact.sigma.x,
                )
            }
            None => missed += 1,
        }
        check(&m);
    }
    println!(
        "largest difference from the SVD times (s_y + s_z) / s_x: {worst:e}; left to the SVD: {missed} of 100000"
    );
    assert!(worst < 5e-15);
    assert!(missed < 5, "{missed} of 100000 left the fast path");
}

/// Powers of two scale every step exactly, so that the fast path serves all units of length alike, to the last bit.
#[test]
fn fast_path_is_the_same_in_any_unit_of_length() {
    let mut random = Random::new(31);
    for _ in 0..500 {
        let m = random.rotation() * (Matrix3::identity() + random.matrix() * 0.4);
        let expected = certified_rotation(&m);
        assert!(expected.is_some(), "{m}");
        for exponent in [-60, -20, 20, 60] {
            let scaled = m * 2.0_f64.powi(exponent);
            assert_eq!(certified_rotation(&scaled), expected, "{exponent} {m}");
        }
    }
}

/// The last step is certified only when it was small AND led to the nearest rotation: neither one is enough.
#[test]
fn a_step_is_refused_when_long_and_where_the_rotation_is_not_the_nearest() {
    let mut random = Random::new(32);
    let stretch = Vector3::new(1.3, 1.0, 0.7);
    for _ in 0..200 {
        let nearest = random.rotation();
        let m = nearest * Matrix3::from_diagonal(&stretch);
        let axis = random.rotation().column(0).into_owned();
        let turned = |angle: f64| {
            let turn = nalgebra::Rotation3::from_scaled_axis(axis * angle);
            rotation_step(&m, &(nearest * turn.matrix()), stretch.sum())
        };
        let error = (turned(3e-9).expect("near") - nearest).amax();
        assert!(error < 2e-15, "{error:e}");
        assert_eq!(turned(1e-3), None);
        // Half a turn about an axis of the stretch keeps R^T M symmetric.
        for k in 0..3 {
            let mut half_turn = Matrix3::from_diagonal_element(-1.0);
            half_turn[(k, k)] = 1.0;
            let saddle = nearest * half_turn;
            assert_eq!(rotation_step(&m, &saddle, stretch.sum()), None);
        }
    }
}

#[test]
fn fast_path_never_certifies_a_wrong_rotation() {
    // Gaps from 1 down to rounding, on both sides of every class boundary.
    for seed in 0..20_000 {
        let mut random = Random::new(seed);
        let gap = 10.0_f64.powf(-8.0 * (1.0 + random.signed()));
        let y = 0.5 * (1.0 + random.signed());
        let case = planted([1.0, y, -y + gap.min(2.0 * y)], seed);
        check(&case.matrix);
    }
}

#[test]
fn equals_the_svd_where_the_fast_path_declines() {
    for diagonal in [
        [1.0, 1.0, -1.0],
        [1.0, 0.5, -0.5],
        [0.0, 0.0, 0.0],
        [0.0, 2.0, 0.0],
        [-1.0, -1.0, -1.0],
    ] {
        let m = Matrix3::from_diagonal(&Vector3::from(diagonal));
        assert_eq!(polar_rotation(&m), signed_svd(&m).rotation());
        check(&m);
    }
    assert_eq!(polar_rotation(&Matrix3::zeros()), Matrix3::identity());
    assert_eq!(
        polar_rotation(&Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0))),
        Matrix3::identity()
    );
}

#[test]
fn stretch_recomposes() {
    for (name, case) in hard_cases(4) {
        let p = polar(&case.matrix);
        let error = (p.rotation * p.stretch - case.matrix).amax();
        assert!(error <= 8e-15 * case.sigma.x, "{name}: {error:e}");
        assert_eq!(p.stretch, p.stretch.transpose());
        assert_eq!(p.rotation, polar_rotation(&case.matrix));
    }
}

/// Found by a million draws of entries up to the largest number: `s_x` was cut off at `f64::MAX` before it was composed into `S`, and
/// entries that are far below came out wrong by half.
#[test]
fn stretch_is_right_where_only_a_singular_value_overflows() {
    let mut random = Random::new(21);
    let mut overflowing = 0;
    for _ in 0..2000 {
        let m = random.matrix();
        let unit = m / m.amax();
        let (small, large) = (polar(&unit), polar(&(unit * f64::MAX)));
        overflowing += usize::from(signed_svd(&unit).sigma.x > 1.0);
        assert!((small.rotation - large.rotation).amax() < 1e-12 || small.stretch.trace() < 0.1);
        for (x, y) in small.stretch.iter().zip(&large.stretch) {
            let expected = x.clamp(-1.0, 1.0);
            assert!((expected - y / f64::MAX).abs() < 1e-14, "{unit} {x} {y:e}");
        }
    }
    assert!(overflowing > 1000);
}

#[test]
fn random_bit_patterns() {
    let mut random = Random::new(11);
    for _ in 0..100_000 {
        let m = Matrix3::from_fn(|_, _| f64::from_bits(random.bits()));
        if m.iter().all(|x| x.is_finite()) {
            check(&m);
        } else {
            assert!(polar_rotation(&m).iter().all(|x| x.is_nan()));
        }
    }
}

proptest! {
    #[test]
    fn turning_the_input_turns_the_rotation(seed: u64, size in 0.0..1.0_f64) {
        let mut random = Random::new(seed);
        let (q, m) = (random.rotation(), Matrix3::identity() + random.matrix() * size);
        let s = signed_svd(&m).sigma;
        let error = (polar_rotation(&(q * m)) - q * polar_rotation(&m)).amax();
        prop_assert!(error * (s.y + s.z) <= 1e-14 * s.x);
    }
}
