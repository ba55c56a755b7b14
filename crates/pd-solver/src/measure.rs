//! The error of an equilibrium, measured.

use crate::Solver;
use crate::krylov::LinearStatus;
use crate::methods::{Outcome, Target, newton_direction};
use crate::solution::{Estimate, Method, Status};
use crate::vector::{NodalVector, max_norm};

/// Relative residual of the Newton step that measures.
const MEASURED: f64 = 0.03;
/// How often a solve goes on because it is not as near as was asked.
const REPEATS: usize = 4;
/// A solve that goes on asks for this share of what it asked for before, or less.
const TIGHTER: f64 = 0.3;
/// And never for less than this share at once.
const LEAST: f64 = 0.05;

impl Solver {
    /// Measures the error of what converged, and goes on where it is more than asked.
    pub(crate) fn measure(
        &mut self,
        method: Method,
        u: &mut NodalVector,
        mut target: Target,
        limit: usize,
        outcome: &mut Outcome,
    ) {
        let asked = target.accuracy;
        for _ in 0..REPEATS {
            if outcome.status != Status::Converged {
                return;
            }
            let (problem, pre, space) = self.parts(method);
            space.reserve(u.len());
            problem.evaluate(u, &mut space.gradient);
            pre.prepare(problem, u);
            let linear = newton_direction(problem, pre, space, u, MEASURED);
            let error = match linear.status {
                LinearStatus::Converged => max_norm(&space.direction),
                // No minimum is near yet, whatever the directions told.
                LinearStatus::NegativeCurvature => f64::INFINITY,
                _ => return,
            };
            if error.is_finite() {
                outcome.estimated_error = Some(error);
                outcome.estimate = Estimate::Measured;
            }
            let Some(accuracy) = target.accuracy.filter(|_| asked.is_some_and(|a| error > a))
            else {
                return;
            };
            // The rule was taken in by that factor, and may be again.
            target.accuracy = Some(accuracy * TIGHTER.min(accuracy / error).max(LEAST));
            let done = outcome.iterations;
            *outcome = self.run_method(method, u, &target, limit.saturating_sub(done));
            outcome.iterations += done;
        }
    }
}
