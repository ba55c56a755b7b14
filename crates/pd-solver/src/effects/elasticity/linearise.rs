//! Rotations and the factors of their derivatives at all samples of consecutive blocks, and how near one of them is to being not
//! unique.

use super::block::{Block, parts};
use super::kernel::{Actuation, Linearisation, SampleLaw, misfit};
use super::least_pair_sum::LeastPairSum;
use super::tensor::TensorRule;
use nalgebra::Vector3;
use polar_grad::lanes::{LaneMatrix, polar_rotation_lanes, product, rotation_factor_lanes};
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
                    linearise(simd, part, &m, &mut self.out[at], &mut smallest);
                }
            }
        }
        smallest.finish()
    }
}

/// Linearises at the matrices `m = F A`; gives their rotations.
#[inline(always)]
fn linearise<S: Simd>(
    simd: S,
    part: usize,
    m: &LaneMatrix<S>,
    out: &mut Linearisation,
    smallest: &mut LeastPairSum,
) -> LaneMatrix<S> {
    let rotation = polar_rotation_lanes(simd, m);
    let factor = rotation_factor_lanes(simd, &rotation, m).factor;
    out.set(simd, part, &rotation, &factor);
    smallest.see(simd, m, &factor);
    rotation
}

/// Energy and gradient, and the linearisation by the way.
pub(super) struct LinearisingGradient<'a> {
    actuation: &'a [Actuation],
    first_sample: usize,
    /// Of the samples from the first on.
    out: &'a mut [Linearisation],
    smallest: LeastPairSum,
}

impl<'a> LinearisingGradient<'a> {
    /// `actuation` is that of the body, `out` that of the samples from `first_sample` on.
    pub(super) fn new(
        actuation: &'a [Actuation],
        first_sample: usize,
        out: &'a mut [Linearisation],
    ) -> Self {
        Self {
            actuation,
            first_sample,
            out,
            smallest: LeastPairSum::new(),
        }
    }

    /// The smallest sum of two singular values over the samples seen, infinite without any number.
    pub(super) fn smallest(self) -> f64 {
        self.smallest.finish()
    }
}

impl SampleLaw for LinearisingGradient<'_> {
    #[inline(always)]
    fn stress<S: Simd>(
        &mut self,
        simd: S,
        sample: usize,
        part: usize,
        f: &LaneMatrix<S>,
    ) -> (LaneMatrix<S>, S::f64s) {
        let a = self.actuation[sample].matrix::<S>(part);
        let out = &mut self.out[sample - self.first_sample];
        let rotation = linearise(simd, part, &product(simd, f, &a), out, &mut self.smallest);
        misfit(simd, f, &product(simd, &rotation, &a))
    }
}
