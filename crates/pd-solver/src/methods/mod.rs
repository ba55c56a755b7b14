//! The methods, one per file, behind one signature: a problem, a preconditioner, vectors to work in, and a start.

mod anderson;
pub(crate) mod coarse_to_fine;
mod descent;
mod history;
mod lbfgs;
mod local_global;
mod newton;
mod predict;
mod workspace;

use crate::problem::Problem;
use crate::solution::{Estimate, Status};
use crate::vector::NodalVector;
pub(crate) use anderson::anderson;
pub(crate) use lbfgs::lbfgs;
pub(crate) use local_global::local_global;
use nalgebra::Vector3;
pub(crate) use newton::{newton, solve_newton};
pub(crate) use workspace::{KrylovSpace, Workspace};

/// An approximate inverse of the Hessian over the free nodes, symmetric and positive definite. One that is the same at all states has nothing to
/// do but to be applied.
pub(crate) trait Preconditioner {
    /// `z = M^-1 r`, zero at prescribed nodes.
    fn apply(&mut self, r: &[Vector3<f64>], z: &mut NodalVector);

    /// Whether it is built at a state, or the same for all.
    fn follows(&self) -> bool {
        false
    }

    /// Whether it is so near the Hessian that the length of its directions tells the error.
    fn tells_errors(&self) -> bool {
        false
    }

    /// Makes sure that it is built at a state near `u`, and for what touches there. False where it already was, for an earlier solve.
    fn prepare(&mut self, _problem: &mut Problem, _u: &[Vector3<f64>]) -> bool {
        true
    }

    /// Builds it at `u`.
    fn rebuild(&mut self, _problem: &mut Problem, _u: &[Vector3<f64>]) {}

    /// Builds it at `u` so that it is positive definite whatever the state; false where it already was.
    fn project(&mut self, _problem: &Problem, _u: &[Vector3<f64>]) -> bool {
        false
    }

    /// Makes it safer after it was found not to be positive definite at `u`; false where that is not possible.
    fn strengthen(&mut self, _problem: &Problem, _u: &[Vector3<f64>]) -> bool {
        false
    }
}

/// When a method may stop: at an estimated error in length units, or at a gradient norm; the gradient norm is never zero.
pub(crate) struct Target {
    /// Whether somebody wants to know the error at the end.
    pub(crate) tell_error: bool,
    pub(crate) accuracy: Option<f64>,
    pub(crate) gradient: f64,
    /// The longest last step after which such a gradient will do.
    pub(crate) step: f64,
}

/// Share of the gradient asked for that will do after any step.
const TINY: f64 = 1e-2;

impl Target {
    /// Whether a gradient norm is small enough after a step of this length.
    fn has_arrived(&self, gradient_norm: f64, step: f64) -> bool {
        gradient_norm <= self.gradient
            && (step <= self.step || gradient_norm <= TINY * self.gradient)
    }

    /// Whether the rule is met by a gradient norm and, where there is one, an error estimate.
    pub(crate) fn is_met(&self, gradient_norm: f64, estimate: Option<f64>) -> bool {
        let near = match (self.accuracy, estimate) {
            (Some(accuracy), Some(estimate)) => estimate <= accuracy,
            _ => false,
        };
        near || gradient_norm <= self.gradient
    }
}

/// How a method ended; the positions are updated in place.
pub(crate) struct Outcome {
    pub(crate) status: Status,
    pub(crate) iterations: usize,
    pub(crate) energy: f64,
    pub(crate) gradient_norm: f64,
    pub(crate) estimated_error: Option<f64>,
    pub(crate) estimate: Estimate,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A small gradient after a long step is no arrival: slender parts are still on their way.
    #[test]
    fn arrival_takes_a_short_step_or_a_tiny_gradient() {
        let target = Target {
            tell_error: false,
            accuracy: None,
            gradient: 1.0,
            step: 0.2,
        };
        assert!(target.has_arrived(0.9, 0.1));
        assert!(!target.has_arrived(0.9, 0.3));
        assert!(!target.has_arrived(1.1, 0.1));
        assert!(target.has_arrived(0.009, f64::INFINITY));
    }
}
