//! Local/global iteration: rotations first, then one solve with the constant matrix (Bouaziz et al. 2014).

use super::{Outcome, Preconditioner, Target, Workspace};
use crate::problem::Problem;
use crate::solution::{Estimate, Status};
use crate::vector::{NodalVector, axpy, max_norm, norm};

/// `u <- u - K^-1 grad E(u)`. K majorises the Hessian everywhere (maths.md), so the energy never increases.
///
/// The error estimate extrapolates the linear convergence: with steps that shrink by `rho`, what is left is
/// `step * rho / (1 - rho)`.
pub(crate) fn local_global(
    problem: &mut Problem,
    constant: &mut dyn Preconditioner,
    space: &mut Workspace,
    u: &mut NodalVector,
    target: &Target,
    max_iterations: usize,
) -> Outcome {
    space.reserve(problem.len());
    let mut last_length: Option<f64> = None;
    let mut estimate = None;
    let mut iterations = 0;
    loop {
        let energy = problem.evaluate(u, &mut space.gradient);
        let gradient_norm = norm(&space.gradient);
        let outcome = |status| Outcome {
            status,
            iterations,
            energy,
            gradient_norm,
            estimated_error: estimate,
            estimate: estimate.map_or(Estimate::None, |_| Estimate::Extrapolation),
        };
        if !(energy.is_finite() && gradient_norm.is_finite()) {
            return outcome(Status::NotFinite);
        }
        if target.is_met(gradient_norm, estimate) {
            return outcome(Status::Converged);
        }
        if iterations == max_iterations {
            return outcome(Status::IterationLimit);
        }
        constant.apply(&space.gradient, &mut space.direction);
        axpy(-1.0, &space.direction, u);
        let length = max_norm(&space.direction);
        estimate = last_length.map(|last| {
            let rate = (length / last).min(0.999);
            length * (rate / (1.0 - rate)).max(1.0)
        });
        last_length = Some(length);
        iterations += 1;
    }
}
