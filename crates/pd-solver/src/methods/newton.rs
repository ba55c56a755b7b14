//! Newton's method on the true Hessian: conjugate gradients that stop at negative curvature, and a line search.

use super::descent::Descent;
use super::{Outcome, Target};
use crate::krylov::{LinearSolution, conjugate_gradients};
use crate::problem::Problem;
use crate::solution::Status;
use crate::vector::{NodalVector, dot, max_norm};

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
    problem.linearise(u);
    conjugate_gradients(problem, gradient, tolerance, MAX_INNER)
}

pub(crate) fn newton(
    problem: &mut Problem,
    u: &mut NodalVector,
    target: &Target,
    max_iterations: usize,
) -> Outcome {
    let mut descent = Descent::start(problem, u);
    let start_norm = descent.gradient_norm;
    let mut estimate = None;
    let status = loop {
        if let Some(status) = descent.stop(target, max_iterations) {
            break status;
        }
        // Superlinear convergence near the end, no waste far from it (Eisenstat and Walker 1996).
        let tolerance = LOOSEST.min((descent.gradient_norm / start_norm).sqrt());
        let direction = newton_direction(problem, u, &descent.gradient, tolerance).x;
        let length = max_norm(&direction);
        let slope = dot(&descent.gradient, &direction);
        if slope <= 0.0 || !slope.is_finite() {
            break Status::Stalled;
        }
        if !descent.step(problem, u, &direction, slope) {
            // Not even a tiny part of an exact Newton step helps: the step itself says how far the minimum is.
            if target.is_met(descent.gradient_norm, Some(length)) {
                estimate = Some(length);
                break Status::Converged;
            }
            break Status::Stalled;
        }
        // What remains after the step is what the linear solve left and what the curvature of the energy adds; the second is
        // not known, so no step counts for more than a reduction by REMAINS.
        estimate = Some(length * REMAINS);
        if target.is_met(descent.gradient_norm, estimate) {
            break Status::Converged;
        }
    };
    descent.outcome(status, estimate)
}
