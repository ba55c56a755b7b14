//! Newton's method on the true Hessian: conjugate gradients that stop at negative curvature, and a line search.

use super::descent::Descent;
use super::{Outcome, Preconditioner, Target, Workspace};
use crate::krylov::{LinearSolution, LinearStatus, System, solve_at};
use crate::problem::Problem;
use crate::solution::{Estimate, Status};
use crate::vector::{NodalVector, dot, max_norm};
use nalgebra::Vector3;

/// Iterations of conjugate gradients per step.
const MAX_INNER: usize = 500;
/// The linear solve is never looser than this, so that a step is a fair estimate of the error before it.
const LOOSEST: f64 = 0.1;
/// Share of a step's length that is reported as the error after it.
const REMAINS: f64 = 0.3;
/// Deep in a barrier a step doubles the distance and halves the gradient, and is short however far the minimum is. Where steps have a limit, only
/// one that leaves no more than this share of the gradient tells the error.
pub(super) const CONTRACTS: f64 = 0.25;

/// Solves `H d = gradient` at `u` to a relative residual, so that `u - d` is the minimum of the quadratic model; the gradient and
/// the direction are the workspace's.
pub(crate) fn newton_direction(
    problem: &mut Problem,
    pre: &mut dyn Preconditioner,
    space: &mut Workspace,
    u: &[Vector3<f64>],
    tolerance: f64,
) -> LinearSolution {
    problem.linearise(u);
    solve_newton(problem, pre, space, u, tolerance)
}

/// [`newton_direction`] of a problem that is linearised at `u`.
pub(crate) fn solve_newton(
    problem: &mut Problem,
    pre: &mut dyn Preconditioner,
    space: &mut Workspace,
    u: &[Vector3<f64>],
    tolerance: f64,
) -> LinearSolution {
    space.krylov.reserve(u.len());
    let mut system = System {
        problem,
        pre,
        reactions: &mut space.reactions,
    };
    let solution = solve_at(
        &mut system,
        u,
        &space.gradient,
        &mut space.krylov,
        false,
        tolerance,
        MAX_INNER,
    );
    std::mem::swap(&mut space.direction, &mut space.krylov.x);
    solution
}

/// How a Newton step went.
pub(super) struct Step {
    /// Whether it was taken, in full or in part.
    pub(super) taken: bool,
    /// The error before it, where the linear solve tells that. Where the curvature is negative, a direction leads away from here, but says nothing
    /// of how far.
    pub(super) before: Option<f64>,
    /// Whether it was such that the error after it is a share of that before.
    pub(super) tells: bool,
}

/// Takes a step to the minimum of the quadratic model, found to a relative residual.
pub(super) fn newton_step(
    problem: &mut Problem,
    pre: &mut dyn Preconditioner,
    space: &mut Workspace,
    u: &mut NodalVector,
    descent: &mut Descent,
    tolerance: f64,
) -> Step {
    let linear = newton_direction(problem, pre, space, u, tolerance);
    let length = max_norm(&space.direction);
    let before = (linear.status == LinearStatus::Converged).then_some(length);
    let slope = dot(&space.gradient, &space.direction);
    let gradient_norm = descent.gradient_norm;
    let taken = slope > 0.0 && slope.is_finite() && descent.step(problem, space, u, slope);
    let contracts = !problem.limits_steps() || descent.gradient_norm <= CONTRACTS * gradient_norm;
    Step {
        taken,
        before,
        tells: taken && descent.is_full && contracts,
    }
}

pub(crate) fn newton(
    problem: &mut Problem,
    pre: &mut dyn Preconditioner,
    space: &mut Workspace,
    u: &mut NodalVector,
    target: &Target,
    max_iterations: usize,
) -> Outcome {
    let mut descent = Descent::start(problem, space, u);
    let start_norm = descent.gradient_norm;
    let mut estimate = None;
    let status = loop {
        if let Some(status) = descent.stop(target, max_iterations) {
            break status;
        }
        pre.prepare(problem, u);
        // Superlinear convergence near the end, no waste far from it (Eisenstat and Walker 1996).
        let tolerance = LOOSEST.min((descent.gradient_norm / start_norm).sqrt());
        let step = newton_step(problem, pre, space, u, &mut descent, tolerance);
        if !step.taken {
            // Not even a tiny part of an exact Newton step helps: the step itself says how far the minimum is.
            if step.before.is_some() && target.is_met(descent.gradient_norm, step.before) {
                estimate = step.before.map(|length| (length, Estimate::NewtonStep));
                break Status::Converged;
            }
            break Status::Stalled;
        }
        // What remains after the step is what the linear solve left and what the curvature of the energy adds; the second is
        // not known, so no step counts for more than a reduction by REMAINS.
        let before = step.before.filter(|_| step.tells);
        estimate = before.map(|length| (length * REMAINS, Estimate::NewtonStep));
        if target.is_met(descent.gradient_norm, estimate.map(|(length, _)| length)) {
            break Status::Converged;
        }
    };
    descent.outcome(status, estimate)
}
