//! The derivative of the polar rotation of every lane.

use super::algebra::{
    axial, minors_are_above, pair_sums, reciprocal, symmetric_adjugate, symmetric_times, times,
    times_cross, transposed_product,
};
use super::{LaneMatrix, SymmetricLanes, all, for_each_failed, matrix_of_lane, set_symmetric};
use crate::gradient::RotationGradient;
use pulp::Simd;

/// How far the minors of `tr(S) I - S` must stay above zero, relative to `(tr S)^k`. The floors are far below; `S = R^T M` and the
/// inverse by cofactors err by rounding over the smallest pair sum, at most about 1e-11.
const DEFINITE: f64 = 1e-5;
/// Traces whose cubes stay far from overflow and underflow.
const SAFE_TRACE: [f64; 2] = [1e-90, 1e90];

/// The derivative of the polar rotation `R` of `M = R S` in every lane: the matrices of [`crate::RotationGradient`], by their
/// entries 00, 01, 02, 11, 12, 22.
#[derive(Clone, Copy, Debug)]
pub struct RotationFactor<S: Simd> {
    /// `T = tr(S) I - S`, its eigenvalues raised to the floors of [`crate::RotationGradient::pair_sums`].
    pub pair_sums: SymmetricLanes<S>,
    /// `B = T^-1`, so that `dR = R [B axial(R^T dM)]_x`: what [`rotation_tangent_lanes`] takes.
    pub factor: SymmetricLanes<S>,
}

/// The derivative at the matrices `m` whose polar rotations are `rotation`.
///
/// The relative error is about 1e-15 times `|M| / (s_y + s_z)`. A lane whose pair sums are not clearly positive is done by
/// [`crate::RotationGradient::at`], floors and all. Finite for every
/// finite `m`; NaN in every entry of the lane otherwise.
#[inline(always)]
pub fn rotation_factor_lanes<S: Simd>(
    simd: S,
    rotation: &LaneMatrix<S>,
    m: &LaneMatrix<S>,
) -> RotationFactor<S> {
    let b = transposed_product(simd, rotation, m);
    let pair_sums = pair_sums(simd, &b);
    let trace = simd.add_f64s(b[0], simd.add_f64s(b[4], b[8]));
    let (adjugate, determinant) = symmetric_adjugate(simd, &pair_sums);
    let safe = simd.and_m64s(
        simd.less_than_f64s(simd.splat_f64s(SAFE_TRACE[0]), trace),
        simd.less_than_f64s(trace, simd.splat_f64s(SAFE_TRACE[1])),
    );
    let minors = (pair_sums[0], adjugate[5], determinant);
    let good = simd.and_m64s(safe, minors_are_above(simd, minors, DEFINITE, trace));
    let inverse = reciprocal(simd, determinant);
    let fast = RotationFactor {
        pair_sums,
        factor: times(simd, &adjugate, inverse),
    };
    if all(simd, good) {
        return fast;
    }
    again(simd, m, fast, good)
}

/// Does the lanes that are not `good` by the scalar function.
#[cold]
#[inline(never)]
fn again<S: Simd>(
    simd: S,
    m: &LaneMatrix<S>,
    mut fast: RotationFactor<S>,
    good: S::m64s,
) -> RotationFactor<S> {
    for_each_failed(simd, good, |i| {
        let gradient = RotationGradient::at(&matrix_of_lane::<S>(m, i));
        set_symmetric::<S>(&mut fast.pair_sums, i, &gradient.pair_sums);
        set_symmetric::<S>(&mut fast.factor, i, &gradient.factor);
    });
    fast
}

/// `dR = R [B axial(R^T dM)]_x`: [`crate::RotationGradient::apply`], many at once. `factor` holds the entries 00, 01, 02, 11, 12,
/// 22 of B.
#[inline(always)]
pub fn rotation_tangent_lanes<S: Simd>(
    simd: S,
    rotation: &LaneMatrix<S>,
    factor: &SymmetricLanes<S>,
    d_m: &LaneMatrix<S>,
) -> LaneMatrix<S> {
    let n = transposed_product(simd, rotation, d_m);
    let w = symmetric_times(simd, factor, &axial(simd, &n));
    times_cross(simd, rotation, &w)
}
