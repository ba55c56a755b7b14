//! The steps of the rotation by themselves: what each one certifies.

use super::*;
use crate::testing::{Random, planted};
use nalgebra::Matrix3;
use pulp::Arch;

fn splat<S: Simd>(simd: S, m: &Matrix3<f64>) -> LaneMatrix<S> {
    let mut out = [simd.splat_f64s(0.0); 9];
    for (k, v) in out.iter_mut().enumerate() {
        *v = simd.splat_f64s(m[(k / 3, k % 3)]);
    }
    out
}

/// A Newton-Schulz step at a matrix that is a rotation but for a small error: the result of one lane, and whether all are certain.
struct Orthogonalised(Matrix3<f64>);

impl WithSimd for Orthogonalised {
    type Output = (Matrix3<f64>, bool);

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let (r, near) = newton_schulz(simd, &splat::<S>(simd, &self.0));
        (matrix_of_lane::<S>(&r, S::F64_LANES - 1), all(simd, near))
    }
}

/// The step squares the error: 1e-9 becomes rounding, and from 1e-4 it would not.
#[test]
fn a_newton_schulz_step_is_certain_where_its_square_is_rounding() {
    let mut random = Random::new(40);
    for _ in 0..200 {
        let r = random.rotation();
        let error = random.matrix();
        let near = r + error * 1e-9;
        let far = r + error * 1e-4;
        for (result, certain) in [
            Arch::new().dispatch(Orthogonalised(near)),
            Orthogonalised(near).with_simd(pulp::Scalar),
        ] {
            assert!(certain, "{r}");
            let defect = (result.transpose() * result - Matrix3::identity()).amax();
            assert!(defect < 1e-15, "{r} {defect:e}");
        }
        assert!(!Orthogonalised(far).with_simd(pulp::Scalar).1, "{r}");
        // Improper, though as orthogonal.
        assert!(!Orthogonalised(-near).with_simd(pulp::Scalar).1, "{r}");
    }
}

/// Next to a reflection the first attempt gives up, and the second one serves: the scalar function is for the rest.
#[test]
fn the_second_attempt_serves_all_lanes_next_to_a_reflection() {
    for gap in [1e-2, 1e-4, 1e-6] {
        for seed in 0..50 {
            let cases: [_; WIDEST] = std::array::from_fn(|lane| {
                planted([1.0, 0.5, -0.5 + gap], WIDEST as u64 * seed + lane as u64)
            });
            let mut retry = Retry {
                m: std::array::from_fn(|k| {
                    std::array::from_fn(|lane| cases[lane].matrix[(k / 3, k % 3)])
                }),
                rotation: [[0.0; WIDEST]; 9],
                good: [0.0; WIDEST],
                lanes: WIDEST,
            };
            Arch::new().dispatch(&mut retry);
            for (lane, case) in cases.iter().enumerate() {
                assert_ne!(retry.good[lane], 0.0, "{gap:e} {seed} {lane}");
                let r = Matrix3::from_fn(|i, j| retry.rotation[3 * i + j][lane]);
                let error = (r - case.u * case.v.transpose()).amax();
                assert!(error < 1e-14 / gap, "{gap:e} {seed} {lane}: {error:e}");
            }
        }
    }
}
