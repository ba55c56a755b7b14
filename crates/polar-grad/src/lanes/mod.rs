//! Many 3x3 matrices at once: one per SIMD lane, for any instruction set that [`pulp`] dispatches to.
//!
//! A matrix of lanes is `[S::f64s; 9]`, row by row: entry `3 i + j` holds M_ij of all lanes. A symmetric one is `[S::f64s; 6]`,
//! the entries 00, 01, 02, 11, 12, 22. The functions here are meant to be called inside a [`pulp::WithSimd`] operation, so that a
//! whole loop runs under one dispatch; [`batch`] does that for slices of matrices. What a lane answers depends on nothing but
//! its own numbers and the instruction set.

mod algebra;
pub mod batch;
mod gradient;
mod polar;
mod projection;
#[cfg(test)]
mod tests;

pub use algebra::{
    inverse_cholesky_factor, lower_congruence, product, symmetric_adjugate, symmetric_inverse,
    symmetric_pair_sums, symmetric_square, symmetric_times, times_cross, transposed_product,
    upper_congruence,
};
pub use gradient::{RotationFactor, rotation_factor_lanes, rotation_tangent_lanes};
pub use polar::polar_rotation_lanes;
pub use projection::projected_factor_lanes;

use nalgebra::Matrix3;
use pulp::Simd;

/// One 3x3 matrix per lane, row by row.
pub type LaneMatrix<S> = [<S as Simd>::f64s; 9];

/// One symmetric 3x3 matrix per lane: entries 00, 01, 02, 11, 12, 22.
pub type SymmetricLanes<S> = [<S as Simd>::f64s; 6];

/// Places of the six entries of a symmetric matrix in its nine, row by row.
const SYMMETRIC: [usize; 9] = [0, 1, 2, 1, 3, 4, 2, 4, 5];
/// Row and column of the six entries of a symmetric matrix.
const PLACES: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];

/// Whether a condition holds in all lanes.
#[inline(always)]
fn all<S: Simd>(simd: S, good: S::m64s) -> bool {
    simd.first_true_m64s(simd.not_m64s(good)) == S::F64_LANES
}

/// Calls `action` with the number of every lane that is not `good`.
#[inline(always)]
fn for_each_failed<S: Simd>(simd: S, good: S::m64s, mut action: impl FnMut(usize)) {
    let flags = simd.select_f64s(good, simd.splat_f64s(1.0), simd.splat_f64s(0.0));
    for i in 0..S::F64_LANES {
        if lane::<S>(&flags, i) == 0.0 {
            action(i);
        }
    }
}

/// The number in one lane.
#[inline(always)]
fn lane<S: Simd>(v: &S::f64s, i: usize) -> f64 {
    pulp::bytemuck::cast_slice::<S::f64s, f64>(std::slice::from_ref(v))[i]
}

#[inline(always)]
fn set_lane<S: Simd>(v: &mut S::f64s, i: usize, value: f64) {
    pulp::bytemuck::cast_slice_mut::<S::f64s, f64>(std::slice::from_mut(v))[i] = value;
}

/// The matrix in one lane.
#[inline(always)]
fn matrix_of_lane<S: Simd>(m: &LaneMatrix<S>, i: usize) -> Matrix3<f64> {
    Matrix3::from_fn(|row, column| lane::<S>(&m[3 * row + column], i))
}

/// The symmetric matrix in one lane.
#[inline(always)]
fn symmetric_of_lane<S: Simd>(m: &SymmetricLanes<S>, i: usize) -> Matrix3<f64> {
    Matrix3::from_fn(|row, column| lane::<S>(&m[SYMMETRIC[3 * row + column]], i))
}

#[inline(always)]
fn set_symmetric<S: Simd>(m: &mut SymmetricLanes<S>, i: usize, value: &Matrix3<f64>) {
    for (entry, place) in m.iter_mut().zip(PLACES) {
        set_lane::<S>(entry, i, value[place]);
    }
}
