//! The vectors that methods work in, allocated once per body and used again by every solve.

use crate::krylov::Reactions;
use crate::vector::{NodalVector, zeros};

/// Steps that L-BFGS remembers. With a good preconditioner the first few are what counts.
pub(crate) const HISTORY: usize = 8;

/// Vectors of one body.
#[derive(Default)]
pub(crate) struct Workspace {
    pub(crate) gradient: NodalVector,
    /// Energy at the start of the next descent, where the gradient is already that there.
    pub(crate) energy_at_start: Option<f64>,
    /// After a step: the positions and the gradient before it.
    pub(crate) last: NodalVector,
    pub(crate) last_gradient: NodalVector,
    pub(crate) direction: NodalVector,
    pub(crate) scratch: NodalVector,
    pub(crate) krylov: KrylovSpace,
    pub(crate) reactions: Reactions,
    pub(crate) history: Vec<Pair>,
    /// Pairs that the last descent left there, of which the next one may take those that its preconditioner was built with.
    pub(crate) pairs: usize,
}

/// A step and the change of the gradient over it.
#[derive(Default)]
pub(crate) struct Pair {
    pub(crate) s: NodalVector,
    pub(crate) y: NodalVector,
    /// `1 / (s . y)`.
    pub(crate) rho: f64,
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

impl Pair {
    pub(crate) fn reserve(&mut self, n: usize) {
        fit(&mut self.s, n);
        fit(&mut self.y, n);
    }
}
