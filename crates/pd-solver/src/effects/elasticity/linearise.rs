//! Rotations and the factors of their derivatives at all samples of consecutive blocks, and how near one of them is to being not
//! unique.

use super::block::{Block, parts};
use super::kernel::{Actuation, Linearisation};
use super::tensor::TensorRule;
use nalgebra::{Matrix3, Vector3};
use polar_grad::RotationGradient;
use polar_grad::lanes::{
    LaneMatrix, SymmetricLanes, polar_rotation_lanes, product, rotation_factor_lanes,
};
use pulp::{Simd, WithSimd};

/// Sums of singular values below this fraction of the norm were perhaps raised in B: what B says of them is not believed.
const RAISED: f64 = 1e-9;
/// The same for all sums whose square is below this.
const RAISED2_MIN: f64 = 1e-280;
/// How much a bound may be above the value it bounds, by rounding.
const ROUNDOFF: f64 = 1e-14;

/// Linearises consecutive blocks; gives the smallest sum of two singular values over their samples, infinite without any number.
pub(super) struct Linearise<'a, const N: usize> {
    pub(super) rule: &'a TensorRule<N>,
    pub(super) blocks: &'a [Block],
    /// Of the samples of these blocks.
    pub(super) actuation: &'a [Actuation],
    /// Positions of the nodes of the body.
    pub(super) u: &'a [Vector3<f64>],
    /// Of the samples of these blocks.
    pub(super) out: &'a mut [Linearisation],
}

impl<const N: usize> WithSimd for Linearise<'_, N> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let samples = TensorRule::<N>::SAMPLES;
        let mut smallest = f64::INFINITY;
        for (i, block) in self.blocks.iter().enumerate() {
            let u = block.gather(self.u);
            for part in 0..parts::<S>() {
                let f = self.rule.gradients(simd, &u, &block.inverse_size, part);
                for number in 0..samples {
                    let at = i * samples + number;
                    let a = self.actuation[at].matrix::<S>(part);
                    let m = product(simd, &f.at(TensorRule::<N>::sample(number)), &a);
                    let rotation = polar_rotation_lanes(simd, &m);
                    let factor = rotation_factor_lanes(simd, &rotation, &m).factor;
                    let out = &mut self.out[at];
                    for (out, x) in out.rotation.iter_mut().zip(rotation) {
                        *out.part_mut::<S>(part) = x;
                    }
                    for (out, x) in out.factor.iter_mut().zip(factor) {
                        *out.part_mut::<S>(part) = x;
                    }
                    let bound = least_pair_sum(simd, &factor);
                    let level = simd.splat_f64s(smallest * (1.0 - ROUNDOFF));
                    let look = simd.or_m64s(
                        simd.less_than_f64s(bound, level),
                        perhaps_raised(simd, &m, bound),
                    );
                    if simd.first_true_m64s(look) != S::F64_LANES {
                        smallest = smallest.min(smallest_of(simd, &m, look));
                    }
                }
            }
        }
        smallest
    }
}

/// A lower bound of the smallest eigenvalue of `B^-1`, at least three quarters of it.
///
/// The largest eigenvalue of a symmetric B of deviator `D = B - tr(B)/3 I` is at most `tr(B)/3 + 2 |D| / sqrt(6)`, and is that
/// where the two others are equal.
#[inline(always)]
fn least_pair_sum<S: Simd>(simd: S, b: &SymmetricLanes<S>) -> S::f64s {
    let trace = simd.add_f64s(simd.add_f64s(b[0], b[3]), b[5]);
    let mean = simd.mul_f64s(trace, simd.splat_f64s(1.0 / 3.0));
    let mut off = simd.mul_f64s(b[1], b[1]);
    off = simd.mul_add_e_f64s(b[2], b[2], off);
    off = simd.mul_add_e_f64s(b[4], b[4], off);
    let mut square = simd.add_f64s(off, off);
    for k in [0, 3, 5] {
        let deviation = simd.sub_f64s(b[k], mean);
        square = simd.mul_add_e_f64s(deviation, deviation, square);
    }
    let spread = simd.sqrt_f64s(simd.mul_f64s(square, simd.splat_f64s(4.0 / 6.0)));
    simd.div_f64s(simd.splat_f64s(1.0), simd.add_f64s(mean, spread))
}

/// Where a bound is so small that it may come from a B whose eigenvalues were raised.
#[inline(always)]
fn perhaps_raised<S: Simd>(simd: S, m: &LaneMatrix<S>, bound: S::f64s) -> S::m64s {
    let mut norm2 = simd.mul_f64s(m[0], m[0]);
    for x in &m[1..] {
        norm2 = simd.mul_add_e_f64s(*x, *x, norm2);
    }
    let fraction = simd.splat_f64s(RAISED * RAISED);
    let level = simd.mul_add_e_f64s(norm2, fraction, simd.splat_f64s(RAISED2_MIN));
    simd.less_than_f64s(simd.mul_f64s(bound, bound), level)
}

/// The smallest sum of two singular values over the lanes to look at, by the scalar function.
#[cold]
#[inline(never)]
fn smallest_of<S: Simd>(simd: S, m: &LaneMatrix<S>, look: S::m64s) -> f64 {
    let flags = simd.select_f64s(look, simd.splat_f64s(1.0), simd.splat_f64s(0.0));
    let lane = |v: &S::f64s, i: usize| {
        pulp::bytemuck::cast_slice::<S::f64s, f64>(std::slice::from_ref(v))[i]
    };
    let sums = (0..S::F64_LANES)
        .filter(|&i| lane(&flags, i) != 0.0)
        .map(|i| {
            let m = Matrix3::from_fn(|row, column| lane(&m[3 * row + column], i));
            RotationGradient::at(&m).smallest_pair_sum
        });
    sums.fold(f64::INFINITY, f64::min)
}
