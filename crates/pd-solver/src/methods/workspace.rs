//! The vectors that methods work in, allocated once per body and used again by every solve.

use super::history::History;
use crate::krylov::Reactions;
use crate::vector::{NodalVector, zeros};

/// Vectors of one body.
#[derive(Default)]
pub(crate) struct Workspace {
    pub(crate) gradient: NodalVector,
    /// Energy at the start of the next descent, where that was evaluated last and the gradient is the one there.
    pub(crate) energy_at_start: Option<f64>,
    /// Whether `last_gradient` is the gradient at the start of the next descent before the actuation changed.
    pub(crate) predict: bool,
    /// After a step: the positions and the gradient before it.
    pub(crate) last: NodalVector,
    pub(crate) last_gradient: NodalVector,
    pub(crate) direction: NodalVector,
    pub(crate) scratch: NodalVector,
    pub(crate) krylov: KrylovSpace,
    pub(crate) reactions: Reactions,
    /// What the last descent left, of which the next one may take what its preconditioner was built with.
    pub(crate) history: History,
}

/// The solution and the vectors of an iterative linear solve.
#[derive(Default)]
pub(crate) struct KrylovSpace {
    pub(crate) x: NodalVector,
    pub(crate) r: NodalVector,
    pub(crate) z: NodalVector,
    pub(crate) d: NodalVector,
    pub(crate) q: NodalVector,
    /// Steps of the last solve, and the factors that its directions were mixed by.
    pub(crate) lanczos: Vec<(f64, f64)>,
}

impl Workspace {
    /// Makes the vectors of a descent `n` long.
    pub(crate) fn reserve(&mut self, n: usize) {
        let vectors = [
            &mut self.gradient,
            &mut self.last,
            &mut self.last_gradient,
            &mut self.direction,
            &mut self.scratch,
        ];
        vectors.into_iter().for_each(|v| fit(v, n));
    }
}

impl KrylovSpace {
    /// Makes all vectors `n` long.
    pub(crate) fn reserve(&mut self, n: usize) {
        let vectors = [
            &mut self.x,
            &mut self.r,
            &mut self.z,
            &mut self.d,
            &mut self.q,
        ];
        vectors.into_iter().for_each(|v| fit(v, n));
    }
}

fn fit(vector: &mut NodalVector, n: usize) {
    if vector.len() != n {
        *vector = zeros(n);
    }
}
