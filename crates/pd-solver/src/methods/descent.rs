//! What the methods with a line search share: where they stand, when they stop, and how they step.

use super::history::{History, State};
use super::{Outcome, Target, Workspace};
use crate::problem::Problem;
use crate::solution::{Estimate, Status};
use crate::vector::{NodalVector, add_scaled, max_norm, norm};
use nalgebra::Vector3;

/// Sufficient decrease (Armijo).
const ARMIJO: f64 = 1e-4;
/// Halvings of a step before the search gives up.
const MAX_HALVINGS: usize = 25;
/// Relative size of what roundoff does to an energy that is a sum over many samples.
const ENERGY_ROUNDOFF: f64 = 1e-14;

/// A state by its energy and gradient; the vectors are in the workspace.
pub(super) struct Descent {
    pub(super) gradient_norm: f64,
    /// Whether the last step was taken at its full length: only then does it tell how near the end is.
    pub(super) is_full: bool,
    /// Samples inside out.
    pub(super) inverted: usize,
    energy: f64,
    iterations: usize,
    /// Norm of the gradient before the last step.
    before: f64,
    /// Length of the last step.
    pub(super) step: f64,
}

impl Descent {
    pub(super) fn start(problem: &mut Problem, space: &mut Workspace, u: &NodalVector) -> Self {
        space.reserve(problem.len());
        let energy = match space.energy_at_start.take() {
            Some(energy) => energy,
            None => problem.evaluate(u, &mut space.gradient),
        };
        Self {
            gradient_norm: norm(&space.gradient),
            is_full: true,
            inverted: problem.inverted_where_evaluated(),
            energy,
            iterations: 0,
            before: f64::INFINITY,
            step: f64::INFINITY,
        }
    }

    /// Counts the step against the workspace's direction that was taken to come to the start, from a gradient of norm `before`.
    pub(super) fn count(&mut self, space: &Workspace, before: f64) {
        self.iterations += 1;
        self.before = before;
        self.step = max_norm(&space.direction);
    }

    /// Keeps the last step in `history`, `u` being where it went to. False where the curvature along it was not positive.
    pub(super) fn remember(
        &self,
        history: &mut History,
        space: &Workspace,
        u: &[Vector3<f64>],
    ) -> bool {
        let from = State {
            u: &space.last,
            gradient: &space.last_gradient,
        };
        let to = State {
            u,
            gradient: &space.gradient,
        };
        history.push(from, to, (self.step, self.before))
    }

    /// Steps taken.
    pub(super) fn iterations(&self) -> usize {
        self.iterations
    }

    /// Why to stop before another direction is sought, if there is a reason.
    pub(super) fn stop(&self, target: &Target, max_iterations: usize) -> Option<Status> {
        if !(self.energy.is_finite() && self.gradient_norm.is_finite()) {
            Some(Status::NotFinite)
        } else if target.has_arrived(self.gradient_norm, self.step) {
            Some(Status::Converged)
        } else if self.iterations == max_iterations {
            Some(Status::IterationLimit)
        } else {
            None
        }
    }

    /// Moves `u` against the workspace's direction, whose product with the gradient is `slope`: halves the step until the energy
    /// falls enough; where the fall drowns in roundoff, a smaller gradient is accepted instead. False, and `u` unchanged, when no
    /// step will do.
    pub(super) fn step(
        &mut self,
        problem: &mut Problem,
        space: &mut Workspace,
        u: &mut NodalVector,
        slope: f64,
    ) -> bool {
        let mut length = 1.0;
        if problem.limits_steps() {
            add_scaled(u, -1.0, &space.direction, &mut space.last);
            length = problem.step_limit(u, &space.last);
        }
        for _ in 0..=MAX_HALVINGS {
            add_scaled(u, -length, &space.direction, &mut space.last);
            let energy = problem.evaluate(&space.last, &mut space.last_gradient);
            let decrease = energy <= self.energy - ARMIJO * length * slope;
            let roundoff = ENERGY_ROUNDOFF * self.energy.abs();
            let level = energy <= self.energy + roundoff && slope * length <= 1e3 * roundoff;
            if decrease || (level && norm(&space.last_gradient) < self.gradient_norm) {
                std::mem::swap(u, &mut space.last);
                std::mem::swap(&mut space.gradient, &mut space.last_gradient);
                self.energy = energy;
                self.before = self.gradient_norm;
                self.inverted = problem.inverted_where_evaluated();
                self.gradient_norm = norm(&space.gradient);
                self.iterations += 1;
                self.is_full = length == 1.0;
                self.step = length * max_norm(&space.direction);
                return true;
            }
            length *= 0.5;
        }
        false
    }

    pub(super) fn outcome(&self, status: Status, estimate: Option<(f64, Estimate)>) -> Outcome {
        Outcome {
            status,
            iterations: self.iterations,
            energy: self.energy,
            gradient_norm: self.gradient_norm,
            estimated_error: estimate.map(|(length, _)| length),
            estimate: estimate.map_or(Estimate::None, |(_, kind)| kind),
        }
    }
}
