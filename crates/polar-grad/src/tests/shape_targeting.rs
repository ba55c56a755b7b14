//! The energy, its gradients and the adjoint product: finite differences and the 9x9 formulas.

use super::{differences, mat, oracle, vec};
use crate::testing::{Random, deformation_with};
use crate::*;
use nalgebra::{Matrix3, SVector, Vector1};

/// Named deformation gradients and actuation entries with `s_y + s_z` well away from zero.
fn cases() -> Vec<(Matrix3<f64>, [f64; 6])> {
    let mut cases = Vec::new();
    for seed in 0..20 {
        let mut random = Random::new(seed);
        let b = random.actuation_entries(0.3);
        let a = actuation_from_b(&b);
        let r = random.rotation();
        cases.extend([
            (r * (Matrix3::identity() + random.matrix() * 0.2), b),
            (r * (Matrix3::identity() + random.matrix() * 0.2), [0.0; 6]),
            (r * a, b),
            (r * a * 0.6, b),
            (deformation_with([1.3, 0.8, -0.3], &a, seed), b),
            (
                r * (Matrix3::identity() + random.matrix() * 0.1),
                [0.0, 0.1, 0.0, 0.0, 0.1, -1.5],
            ),
        ]);
    }
    cases
}

fn actuation(b: &SVector<f64, 6>) -> Matrix3<f64> {
    actuation_from_b(&(*b).into())
}

#[test]
fn gradients_are_differences_of_the_energy() {
    for (f, b) in cases() {
        let a = actuation_from_b(&b);
        let by_f = differences(
            |x| Vector1::new(shape_targeting_energy(&mat(x), &a)),
            &vec(&f),
            1e-3,
        );
        assert!((by_f.transpose() - vec(&shape_targeting_gradient(&f, &a))).amax() < 1e-8);
        let by_b = differences(
            |x| Vector1::new(shape_targeting_energy(&f, &actuation(x))),
            &b.into(),
            1e-3,
        );
        let expected = SVector::from(shape_targeting_actuation_gradient(&f, &a));
        assert!((by_b.transpose() - expected).amax() < 1e-8);
    }
}

#[test]
fn energy_is_zero_exactly_at_the_target() {
    for (f, b) in cases() {
        let a = actuation_from_b(&b);
        if a.symmetric_eigenvalues().min() > 0.0 {
            assert!(shape_targeting_energy(&(polar_rotation(&f) * a), &a) < 1e-29);
        }
    }
}

#[test]
fn actuation_vjp_is_minus_the_transposed_derivative() {
    let mut random = Random::new(42);
    for (f, b) in cases() {
        let a = actuation_from_b(&b);
        let core = HessianCore::new(&f, &a);
        let y = random.matrix();
        let product = SVector::from(actuation_vjp(&core, &f, &y));
        let jacobian = differences(
            |x| vec(&shape_targeting_gradient(&f, &actuation(x))),
            &b.into(),
            5e-4,
        );
        assert!((product + jacobian.transpose() * vec(&y)).amax() < 1e-6);
        let rotation = polar_rotation(&(f * a));
        let dense = oracle::outer_hat(&rotation).transpose()
            + oracle::outer_hat(&f).transpose()
                * oracle::rotation_gradient(&(f * a))
                * oracle::hat(&a);
        let expected = oracle::duplication().transpose() * dense * vec(&y);
        assert!((product - expected).amax() < 1e-13);
    }
}

#[test]
#[should_panic(expected = "needs the exact core")]
fn actuation_vjp_refuses_a_filtered_core() {
    let f = Matrix3::identity() * 0.5;
    let core = HessianCore::new(&f, &Matrix3::identity()).filtered(Filter::Projected);
    actuation_vjp(&core, &f, &f);
}

#[test]
fn six_entries_and_back() {
    let b = [0.1, -0.2, 0.3, 0.4, -0.5, 0.6];
    let a = actuation_from_b(&b);
    assert_eq!(a, a.transpose());
    assert_eq!(
        symmetric_entries(&(a - Matrix3::identity())).map(|x| (x * 1e12).round() / 1e12),
        b
    );
    let d = oracle::duplication();
    let m = Random::new(1).matrix();
    assert_eq!(
        SVector::from(symmetric_cotangent(&m)),
        d.transpose() * vec(&m)
    );
    assert_eq!(vec(&a), vec(&Matrix3::identity()) + d * SVector::from(b));
}
