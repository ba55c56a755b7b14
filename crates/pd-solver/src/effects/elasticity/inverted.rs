//! How many samples are inside out.

use super::block::{Block, parts};
use super::tensor::TensorRule;
use nalgebra::Vector3;
use polar_grad::lanes::LaneMatrix;
use pulp::{Simd, WithSimd};

/// Counts the samples of consecutive blocks whose deformation gradient has a negative determinant.
pub(super) struct Inverted<'a, const N: usize> {
    pub(super) rule: &'a TensorRule<N>,
    pub(super) blocks: &'a [Block],
    /// Positions of the nodes of the body.
    pub(super) u: &'a [Vector3<f64>],
}

impl<const N: usize> WithSimd for Inverted<'_, N> {
    type Output = usize;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> usize {
        let mut inverted = InvertedLanes::new(simd);
        for block in self.blocks {
            let u = block.gather(self.u);
            for part in 0..parts::<S>() {
                let f = self.rule.gradients(simd, &u, &block.inverse_size, part);
                for number in 0..TensorRule::<N>::SAMPLES {
                    let f = f.at(TensorRule::<N>::sample(number));
                    inverted.see(simd, &f, block.weight.part::<S>(part));
                }
            }
        }
        inverted.count(simd)
    }
}

/// Samples with a negative determinant so far, lane by lane.
pub(super) struct InvertedLanes<S: Simd>(S::f64s);

impl<S: Simd> InvertedLanes<S> {
    #[inline(always)]
    pub(super) fn new(simd: S) -> Self {
        Self(simd.splat_f64s(0.0))
    }

    /// Sees the deformation gradients of one sample of a block. Lanes that hold no element have no weight.
    #[inline(always)]
    pub(super) fn see(&mut self, simd: S, f: &LaneMatrix<S>, weight: S::f64s) {
        let (zero, one) = (simd.splat_f64s(0.0), simd.splat_f64s(1.0));
        let negative = simd.less_than_f64s(determinant(simd, f), zero);
        let held = simd.less_than_f64s(zero, weight);
        let counts = simd.and_m64s(negative, held);
        self.0 = simd.add_f64s(self.0, simd.select_f64s(counts, one, zero));
    }

    #[inline(always)]
    pub(super) fn count(self, simd: S) -> usize {
        simd.reduce_sum_f64s(self.0) as usize
    }
}

#[inline(always)]
fn determinant<S: Simd>(simd: S, f: &LaneMatrix<S>) -> S::f64s {
    let mut sum = simd.splat_f64s(0.0);
    for i in 0..3 {
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        let minor = simd.sub_f64s(
            simd.mul_f64s(f[3 + j], f[6 + k]),
            simd.mul_f64s(f[3 + k], f[6 + j]),
        );
        sum = simd.mul_add_e_f64s(f[i], minor, sum);
    }
    sum
}
