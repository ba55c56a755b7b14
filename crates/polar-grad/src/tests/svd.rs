//! The signed SVD: planted values, every hard class and scale, conventions at ties.

use super::{distance_from_rotation, normalised};
use crate::testing::{Random, hard_cases, planted};
use crate::{SignedSvd, signed_svd};
use nalgebra::{Matrix3, Vector3};
use proptest::prelude::*;

/// Asserts everything that is promised of the decomposition of a finite matrix; returns it.
fn check(m: &Matrix3<f64>) -> SignedSvd {
    let svd = signed_svd(m);
    let s = svd.sigma;
    assert!(
        distance_from_rotation(&svd.u) < 4e-15,
        "U of {m} is not a rotation: {}",
        svd.u
    );
    assert!(
        distance_from_rotation(&svd.v) < 4e-15,
        "V of {m} is not a rotation: {}",
        svd.v
    );
    assert!(s.x >= s.y && s.y >= s.z.abs(), "unsorted values {s} of {m}");
    // Relative to the largest entry, in numbers that neither overflow nor underflow.
    let scaled = normalised(m);
    let residual =
        scaled - svd.u * Matrix3::from_diagonal(&signed_svd(&scaled).sigma) * svd.v.transpose();
    assert!(
        residual.amax() <= 5e-15 * scaled.amax(),
        "residual {:e} of {m}",
        residual.amax()
    );
    svd
}

#[test]
fn hard_classes_give_back_their_singular_values() {
    let mut worst: f64 = 0.0;
    for (name, case) in hard_cases(40) {
        let svd = check(&case.matrix);
        let error = (svd.sigma - case.sigma).amax() / case.sigma.x.max(f64::MIN_POSITIVE);
        assert!(
            error < 5e-15,
            "{name}: {} instead of {}",
            svd.sigma,
            case.sigma
        );
        worst = worst.max(error);
    }
    println!("largest error of a singular value, relative to the largest: {worst:e}");
}

#[test]
fn denormal_and_almost_infinite_entries() {
    for case in (0..200).map(|seed| planted([1.0, 0.6, -0.4], seed)) {
        let unit = signed_svd(&case.matrix);
        for exponent in [-1060, -1040, -1022, -1000, 1000, 1022] {
            let m = case
                .matrix
                .map(|x| x * 2.0_f64.powi(exponent / 2) * 2.0_f64.powi(exponent - exponent / 2));
            let svd = check(&m);
            let exact = exponent > -960;
            if exact {
                assert_eq!((svd.u, svd.v), (unit.u, unit.v));
            }
        }
        let huge = (case.matrix / case.matrix.amax()) * f64::MAX;
        assert!(check(&huge).sigma.iter().all(|s| s.is_finite()));
    }
    let tiny = check(&Matrix3::from_diagonal_element(f64::from_bits(1)));
    assert_eq!(tiny.sigma, Vector3::repeat(f64::from_bits(1)));
    let all = check(&Matrix3::repeat(f64::MAX));
    assert_eq!(all.sigma.x, f64::MAX);
}

#[test]
fn ties_follow_the_documented_choice() {
    let identity = Matrix3::identity();
    let zero = signed_svd(&Matrix3::zeros());
    assert_eq!(
        (zero.u, zero.sigma, zero.v),
        (identity, Vector3::zeros(), identity)
    );
    let rest = signed_svd(&(identity * 3.0));
    assert_eq!(
        (rest.u, rest.sigma, rest.v),
        (identity, Vector3::repeat(3.0), identity)
    );
    for seed in 0..100 {
        let r = crate::testing::rotation(seed);
        let svd = signed_svd(&r);
        let is_sign_or_zero = |x: &f64| [-1.0, 0.0, 1.0].contains(x);
        assert!(
            svd.v.iter().all(is_sign_or_zero),
            "only sorting is allowed: {}",
            svd.v
        );
    }
}

/// Orthogonal columns are only sorted, so that small values keep all their digits and signs, however small.
#[test]
fn graded_diagonal_matrices_keep_every_value() {
    for [y, z] in [[1e-3, 1e-9], [1e-100, 1e-150], [1e-200, 1e-290]] {
        for signs in [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, -1.0, 1.0]] {
            let diagonal = Vector3::new(signs[0], signs[1] * y, signs[2] * z);
            let svd = check(&Matrix3::from_diagonal(&diagonal));
            assert_eq!(svd.sigma, Vector3::new(1.0, y, z));
            assert_eq!(svd.rotation(), Matrix3::from_diagonal(&signs.into()));
        }
    }
}

#[test]
fn rank_one_turns_by_the_smallest_angle() {
    for seed in 0..500 {
        let mut random = Random::new(seed);
        let (u, v) = (
            random.rotation().column(0).into_owned(),
            random.rotation().column(0).into_owned(),
        );
        // Two zero columns keep the trailing singular values exactly zero.
        let m = u * Vector3::x().transpose();
        let svd = check(&m);
        assert_eq!((svd.sigma.y, svd.sigma.z), (0.0, 0.0));
        assert!(
            (svd.rotation().trace() - (1.0 + 2.0 * u.x)).abs() < 1e-13,
            "{u}"
        );
        assert!((svd.rotation() * Vector3::x() - u).amax() < 1e-15);
        check(&(u * v.transpose()));
    }
    let half_turn = signed_svd(&Matrix3::from_diagonal(&Vector3::new(-1.0, 0.0, 0.0)));
    assert_eq!(
        half_turn.rotation(),
        Matrix3::from_diagonal(&Vector3::new(-1.0, 1.0, -1.0))
    );
}

#[test]
fn random_bit_patterns_never_give_nan() {
    let mut random = Random::new(7);
    for _ in 0..100_000 {
        let m = Matrix3::from_fn(|_, _| f64::from_bits(random.bits()));
        if m.iter().all(|x| x.is_finite()) {
            check(&m);
        } else {
            assert!(signed_svd(&m).sigma.iter().all(|s| s.is_nan()));
        }
    }
}

proptest! {
    #[test]
    fn planted_values_come_back(x in 0.0..4.0_f64, y in 0.0..1.0_f64, z in -1.0..1.0_f64, exponent in -150..150_i32, seed: u64) {
        let sigma = Vector3::new(x, x * y, x * y * z) * 10.0_f64.powi(exponent);
        let case = planted(sigma.into(), seed);
        let svd = check(&case.matrix);
        prop_assert!((svd.sigma - sigma).amax() <= 5e-15 * sigma.x);
    }

    #[test]
    fn integer_matrices_have_many_ties(entries in proptest::array::uniform9(-2..=2_i32)) {
        check(&Matrix3::from_iterator(entries.map(f64::from)));
    }
}
