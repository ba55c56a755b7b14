//! Newton's method on the true Hessian: conjugate gradients that stop at negative curvature, and a line search.

use super::lbfgs::search;
use super::{Outcome, Target};
use crate::krylov::{LinearSolution, conjugate_gradients};
use crate::problem::Problem;
use crate::solution::Status;
use crate::vector::{NodalVector, dot, max_norm, norm, zeros};
use polar_grad::Filter;

/// Iterations of conjugate gradients per step.
const MAX_INNER: usize = 500;
/// The linear solve is never looser than this, so that a step is a fair estimate of the error before it.
const LOOSEST: f64 = 0.1;
/// Share of a step's length that is reported as the error after it.
pub(super) const REMAINS: f64 = 0.3;

/// Solves `H d = gradient` at `u` to a relative residual, so that `u - d` is the minimum of the quadratic model.
pub(super) fn newton_direction(
    problem: &mut Problem,
    u: &NodalVector,
    gradient: &NodalVector,
    tolerance: f64,
) -> LinearSolution {
    problem.linearise(u, Filter::Exact);
    conjugate_gradients(problem, gradient, tolerance, MAX_INNER)
}

pub(crate) fn newton(
    problem: &mut Problem,
    u: &mut NodalVector,
    target: &Target,
    max_iterations: usize,
) -> Outcome {
    let n = problem.len();
    let (mut gradient, mut trial_gradient, mut trial) = (zeros(n), zeros(n), zeros(n));
    let mut energy = problem.evaluate(u, &mut gradient);
    let mut gradient_norm = norm(&gradient);
    let start_norm = gradient_norm;
    let mut estimate = None;
    let mut iterations = 0;
    let status = loop {
        if !(energy.is_finite() && gradient_norm.is_finite()) {
            break Status::NotFinite;
        }
        if gradient_norm <= target.gradient {
            break Status::Converged;
        }
        if iterations == max_iterations {
            break Status::IterationLimit;
        }
        // Superlinear convergence near the end, no waste far from it (Eisenstat and Walker 1996).
        let tolerance = LOOSEST.min((gradient_norm / start_norm).sqrt());
        let linear = newton_direction(problem, u, &gradient, tolerance);
        let direction = linear.x;
        let length = max_norm(&direction);
        let slope = dot(&gradient, &direction);
        if slope <= 0.0 || !slope.is_finite() {
            break Status::Stalled;
        }
        let accepted = search(
            problem,
            (u, energy, gradient_norm),
            (&direction, slope),
            &mut trial,
            &mut trial_gradient,
        );
        let Some(trial_energy) = accepted else {
            // Not even a tiny part of an exact Newton step helps: the step itself says how far the minimum is.
            if target.is_met(gradient_norm, Some(length)) {
                estimate = Some(length);
                break Status::Converged;
            }
            break Status::Stalled;
        };
        std::mem::swap(u, &mut trial);
        std::mem::swap(&mut gradient, &mut trial_gradient);
        energy = trial_energy;
        gradient_norm = norm(&gradient);
        iterations += 1;
        // What remains after the step is what the linear solve left and what the curvature of the energy adds; the second is
        // not known, so no step counts for more than a reduction by REMAINS.
        estimate = Some(length * REMAINS);
        if target.is_met(gradient_norm, estimate) {
            break Status::Converged;
        }
    };
    Outcome {
        status,
        iterations,
        energy,
        gradient_norm,
        estimated_error: estimate,
    }
}
