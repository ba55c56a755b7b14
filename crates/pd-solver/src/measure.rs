//! The error of an equilibrium, measured.

use crate::Solver;
use crate::krylov::LinearStatus;
use crate::methods::{Outcome, Target, Workspace, solve_newton};
use crate::problem::Problem;
use crate::solution::{Estimate, Method, Status};
use crate::vector::{NodalVector, add_scaled, max_norm, norm};

/// Relative residual of the Newton step that measures.
const MEASURED: f64 = 0.03;
/// Share of the gradient that may be left at the end of a Newton step which tells the error. Where more is left the energy is not quadratic
/// over the step, and the minimum may be anywhere: measured on bodies from easy to nearly unstable, at most 0.56 is left where the step tells
/// the error, and 1.14 where it was told to be a thirtieth of what it is.
const LEFT: f64 = 0.8;
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
            pre.prepare(problem, u);
            problem.linearise_with_gradient(u, &mut space.gradient);
            let linear = solve_newton(problem, pre, space, u, MEASURED);
            let error = match linear.status {
                LinearStatus::Converged if leads_down(problem, space, u, &target) => {
                    max_norm(&space.direction)
                }
                // No minimum is near yet, whatever the directions told.
                LinearStatus::Converged | LinearStatus::NegativeCurvature => f64::INFINITY,
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

/// Whether the Newton step in the workspace ends where little of the gradient is left. Not asked where a step may pass through something, or
/// where what is left is what was asked for or roundoff.
fn leads_down(
    problem: &mut Problem,
    space: &mut Workspace,
    u: &NodalVector,
    target: &Target,
) -> bool {
    if problem.limits_steps() {
        return true;
    }
    let before = norm(&space.gradient);
    add_scaled(u, -1.0, &space.direction, &mut space.last);
    problem.evaluate(&space.last, &mut space.last_gradient);
    norm(&space.last_gradient) <= (LEFT * before).max(target.gradient)
}
