//! The rotation gradient: finite differences, the textbook formula, behaviour near and at
//! singularities.

use super::{differences, mat, oracle, vec};
use crate::testing::{Random, hard_cases, planted};
use crate::{PAIR_SUM_FLOOR, PAIR_SUM_MIN, RotationGradient, polar_rotation, signed_svd};
use nalgebra::Matrix3;
use proptest::prelude::*;

fn is_finite(g: &RotationGradient) -> bool {
    let matrices = [g.rotation, g.factor, g.pair_sums];
    matrices.iter().all(|m| m.iter().all(|x| x.is_finite())) && g.smallest_pair_sum >= 0.0
}

#[test]
fn finite_differences() {
    let mut worst: f64 = 0.0;
    for (_, case) in hard_cases(3).filter(|(_, c)| c.sigma.x > 1e-4 && c.sigma.x < 1e5) {
        let gap = case.sigma.y + case.sigma.z;
        if gap < 1e-4 * case.sigma.x {
            continue;
        }
        let gradient = RotationGradient::at(&case.matrix);
        let h = 0.02 * gap;
        let jacobian = differences(|x| vec(&polar_rotation(&mat(x))), &vec(&case.matrix), h);
        worst = worst.max((jacobian - gradient.to_matrix()).amax() * gap);
    }
    println!("largest error of H_R times (s_y + s_z): {worst:e}");
    assert!(worst < 1e-6);
}

#[test]
fn textbook_formula_at_every_hard_class() {
    let mut worst: f64 = 0.0;
    for (name, case) in hard_cases(10) {
        let s = case.sigma;
        let gradient = RotationGradient::at(&case.matrix);
        assert!(is_finite(&gradient), "{name}: {gradient:?}");
        assert_eq!(gradient.rotation, polar_rotation(&case.matrix));
        let gap = (s.y + s.z) / s.x;
        assert!(
            (gradient.smallest_pair_sum - (s.y + s.z)).abs() <= 1e-14 * s.x,
            "{name}: {gradient:?}"
        );
        if gap > 2.0 * PAIR_SUM_FLOOR && s.y + s.z > 2.0 * PAIR_SUM_MIN {
            let expected = oracle::rotation_gradient(&case.matrix);
            let error = (gradient.to_matrix() - expected).amax() / expected.amax();
            assert!(
                error < 2e-13 + 2e-15 / gap,
                "{name}: relative error {error:e} at gap {gap:e}"
            );
            worst = worst.max(error * gap);
        }
    }
    println!("largest relative error of H_R times (s_y + s_z) / s_x: {worst:e}");
}

/// The SVD is for what is next to singular.
#[test]
fn derivatives_of_ordinary_deformations_need_no_svd() {
    let mut random = Random::new(33);
    for _ in 0..500 {
        let m = random.rotation() * (Matrix3::identity() + random.matrix() * 0.2);
        let fast = RotationGradient::well_conditioned(&m, polar_rotation(&m));
        assert_eq!(fast, Some(RotationGradient::at(&m)), "{m}");
    }
}

#[test]
fn factor_inverts_the_pair_sums() {
    for (name, case) in hard_cases(10) {
        let g = RotationGradient::at(&case.matrix);
        assert_eq!(g.factor, g.factor.transpose());
        let s = case.sigma;
        if s.y + s.z > 1e-3 * s.x {
            let error = (g.factor * g.pair_sums - Matrix3::identity()).amax();
            assert!(error < 1e-12, "{name}: {error:e}");
        }
    }
}

#[test]
fn floors_are_as_documented() {
    assert_eq!(PAIR_SUM_FLOOR, 2f64.powi(-40));
    assert_eq!(PAIR_SUM_MIN, 2f64.powi(-511));
    let reflection = RotationGradient::at(&planted([3.0, 1.0, -1.0], 5).matrix);
    let largest = reflection.factor.symmetric_eigenvalues().max();
    assert!((largest * 3.0 * PAIR_SUM_FLOOR - 1.0).abs() < 1e-3);
    assert!(reflection.smallest_pair_sum < 1e-14);
    let zero = RotationGradient::at(&Matrix3::zeros());
    assert_eq!(
        zero.factor,
        Matrix3::from_diagonal_element(1.0 / PAIR_SUM_MIN)
    );
    assert_eq!(
        (zero.rotation, zero.smallest_pair_sum),
        (Matrix3::identity(), 0.0)
    );
}

#[test]
fn finite_for_every_finite_input() {
    let mut random = Random::new(3);
    for k in 0..100_000 {
        let m = if k % 2 == 0 {
            Matrix3::from_fn(|_, _| f64::from_bits(random.bits()))
        } else {
            random.matrix()
        };
        let g = RotationGradient::at(&m);
        assert_eq!(m.iter().all(|x| x.is_finite()), is_finite(&g), "{m}: {g:?}");
    }
    for extreme in [f64::MAX, f64::MIN_POSITIVE, f64::from_bits(1)] {
        for pattern in [
            Matrix3::identity(),
            Matrix3::repeat(1.0),
            random.matrix().map(f64::signum),
        ] {
            assert!(
                is_finite(&RotationGradient::at(&(pattern * extreme))),
                "{extreme:e} {pattern}"
            );
        }
    }
}

/// Found by draws of entries up to the largest number: entries of `T` were cut off at `f64::MAX` one by one, which made it indefinite, and
/// what was projected with it NaN.
#[test]
fn pair_sums_stay_definite_where_they_overflow() {
    let mut random = Random::new(23);
    for _ in 0..2000 {
        let m = random.matrix();
        let unit = m / m.amax();
        let g = RotationGradient::at(&(unit * f64::MAX));
        let scaled = g.pair_sums / f64::MAX;
        let smallest = scaled.symmetric_eigenvalues().min();
        let expected = RotationGradient::at(&unit).smallest_pair_sum.min(1.0);
        assert!((smallest - expected).abs() < 1e-14, "{unit} {smallest:e}");
    }
}

#[test]
fn smallest_pair_sum_keeps_its_digits_at_double_eigenvalues() {
    for seed in 0..5_000 {
        let mut random = Random::new(seed);
        let split = 0.5 * 10.0_f64.powf(-8.0 * (1.0 + random.signed()));
        for sigma in [
            [1.0, 1.0 - split, 0.5],
            [1.0, 0.5, 0.5 - split],
            [1.0, 1.0 - split, 1.0 - 2.0 * split],
        ] {
            let m = planted(sigma, seed).matrix;
            let error = RotationGradient::at(&m).smallest_pair_sum - (sigma[1] + sigma[2]);
            assert!(error.abs() < 4e-15, "{sigma:?}: {error:e}");
        }
    }
}

proptest! {
    #[test]
    fn product_is_the_matrix_and_symmetric(seed: u64) {
        let mut random = Random::new(seed);
        let m = random.rotation() + random.matrix() * 0.4;
        let g = RotationGradient::at(&m);
        let (x, y) = (random.matrix(), random.matrix());
        let scale = g.factor.norm();
        prop_assert!((vec(&g.apply(&x)) - g.to_matrix() * vec(&x)).amax() < 1e-14 * scale);
        prop_assert!((g.apply(&x).dot(&y) - g.apply(&y).dot(&x)).abs() < 2e-14 * scale);
        let s = signed_svd(&m).sigma;
        prop_assert!((g.smallest_pair_sum - s.y - s.z).abs() < 4e-15 * s.x);
    }
}
