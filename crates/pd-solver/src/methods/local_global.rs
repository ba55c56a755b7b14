//! Local/global iteration: rotations first, then one solve with the constant matrix (Bouaziz et al. 2014).

use super::{Outcome, Target};
use crate::problem::Problem;
use crate::solution::Status;
use crate::vector::{NodalVector, axpy, max_norm, norm, zeros};

/// `u <- u - K^-1 grad E(u)`. K majorises the Hessian everywhere (maths.md), so the energy never increases.
///
/// The error estimate extrapolates the linear convergence: with steps that shrink by `rho`, what is left is
/// `step * rho / (1 - rho)`.
pub(crate) fn local_global(
    problem: &mut Problem,
    u: &mut NodalVector,
    target: &Target,
    max_iterations: usize,
) -> Outcome {
    let n = problem.len();
    let (mut gradient, mut step) = (zeros(n), zeros(n));
    let mut last_length: Option<f64> = None;
    let mut estimate = None;
    let mut iterations = 0;
    loop {
        let energy = problem.evaluate(u, &mut gradient);
        let gradient_norm = norm(&gradient);
        let outcome = |status| Outcome {
            status,
            iterations,
            energy,
            gradient_norm,
            estimated_error: estimate,
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
        problem.constant_solve(&gradient, &mut step);
        axpy(-1.0, &step, u);
        let length = max_norm(&step);
        estimate = last_length.map(|last| {
            let rate = (length / last).min(0.999);
            length * (rate / (1.0 - rate)).max(1.0)
        });
        last_length = Some(length);
        iterations += 1;
    }
}
