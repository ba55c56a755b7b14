//! What a change of the actuation does to the gradient, from one sample in the middle of each element.

use super::kernel::{Actuation, SampleLaw, difference, rotated};
use polar_grad::lanes::LaneMatrix;
use pulp::Simd;

/// The change of the stress `F - R A` where A changes and F does not. Both are those of one sample per element.
#[derive(Clone, Copy)]
pub(super) struct ActuationChange<'a> {
    pub(super) before: &'a [Actuation],
    pub(super) after: &'a [Actuation],
}

impl SampleLaw for ActuationChange<'_> {
    // Hourglass modes do not hang on the actuation.
    const HOURGLASS: bool = false;

    #[inline(always)]
    fn stress<S: Simd>(
        &mut self,
        simd: S,
        sample: usize,
        part: usize,
        f: &LaneMatrix<S>,
    ) -> (LaneMatrix<S>, S::f64s) {
        let before = rotated(simd, f, &self.before[sample].matrix::<S>(part));
        let after = rotated(simd, f, &self.after[sample].matrix::<S>(part));
        (difference(simd, &before, &after), simd.splat_f64s(0.0))
    }
}
