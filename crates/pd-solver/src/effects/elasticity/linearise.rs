//! Rotations and the factors of their derivatives at all samples of consecutive blocks, and how near one of them is to being not
//! unique.

use super::block::{Block, parts};
use super::kernel::{Actuation, Linearisation};
use super::least_pair_sum::LeastPairSum;
use super::tensor::TensorRule;
use nalgebra::Vector3;
use polar_grad::lanes::{polar_rotation_lanes, product, rotation_factor_lanes};
use pulp::{Simd, WithSimd};

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
        let mut smallest = LeastPairSum::new();
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
                    self.out[at].set(simd, part, &rotation, &factor);
                    smallest.see(simd, &m, &factor);
                }
            }
        }
        smallest.finish()
    }
}
