//! What the methods with a line search share: where they stand, when they stop, and how they step.

use super::{Outcome, Target};
use crate::problem::Problem;
use crate::solution::Status;
use crate::vector::{NodalVector, add_scaled, norm, zeros};

/// Sufficient decrease (Armijo).
const ARMIJO: f64 = 1e-4;
/// Halvings of a step before the search gives up.
const MAX_HALVINGS: usize = 25;
/// Relative size of what roundoff does to an energy that is a sum over many samples.
const ENERGY_ROUNDOFF: f64 = 1e-14;

/// A state, its energy and gradient, and the state before it.
pub(super) struct Descent {
    pub(super) gradient: NodalVector,
    pub(super) gradient_norm: f64,
    energy: f64,
    iterations: usize,
    /// After a step: the positions and the gradient before it.
    pub(super) last: NodalVector,
    pub(super) last_gradient: NodalVector,
}

impl Descent {
    pub(super) fn start(problem: &mut Problem, u: &NodalVector) -> Self {
        let n = problem.len();
        let mut gradient = zeros(n);
        let energy = problem.evaluate(u, &mut gradient);
        Self {
            gradient_norm: norm(&gradient),
            gradient,
            energy,
            iterations: 0,
            last: zeros(n),
            last_gradient: zeros(n),
        }
    }

    /// Why to stop before another direction is sought, if there is a reason.
    pub(super) fn stop(&self, target: &Target, max_iterations: usize) -> Option<Status> {
        if !(self.energy.is_finite() && self.gradient_norm.is_finite()) {
            Some(Status::NotFinite)
        } else if self.gradient_norm <= target.gradient {
            Some(Status::Converged)
        } else if self.iterations == max_iterations {
            Some(Status::IterationLimit)
        } else {
            None
        }
    }

    /// Moves `u` against `direction`, whose product with the gradient is `slope`: halves the step until the energy falls enough;
    /// where the fall drowns in roundoff, a smaller gradient is accepted instead. False, and `u` unchanged, when no step will do.
    pub(super) fn step(
        &mut self,
        problem: &mut Problem,
        u: &mut NodalVector,
        direction: &NodalVector,
        slope: f64,
    ) -> bool {
        let mut length = 1.0;
        for _ in 0..=MAX_HALVINGS {
            add_scaled(u, -length, direction, &mut self.last);
            let energy = problem.evaluate(&self.last, &mut self.last_gradient);
            let decrease = energy <= self.energy - ARMIJO * length * slope;
            let roundoff = ENERGY_ROUNDOFF * self.energy.abs();
            let level = energy <= self.energy + roundoff && slope * length <= 1e3 * roundoff;
            if decrease || (level && norm(&self.last_gradient) < self.gradient_norm) {
                std::mem::swap(u, &mut self.last);
                std::mem::swap(&mut self.gradient, &mut self.last_gradient);
                self.energy = energy;
                self.gradient_norm = norm(&self.gradient);
                self.iterations += 1;
                return true;
            }
            length *= 0.5;
        }
        false
    }

    pub(super) fn outcome(&self, status: Status, estimated_error: Option<f64>) -> Outcome {
        Outcome {
            status,
            iterations: self.iterations,
            energy: self.energy,
            gradient_norm: self.gradient_norm,
            estimated_error,
        }
    }
}
