//! The exact implicit adjoint (maths.md "Implicit adjoint"): one linear solve with the true Hessian.

use crate::error::SolverError;
use crate::krylov::{LinearStatus, conjugate_gradients, minres};
use crate::problem::Problem;
use crate::solution::{Adjoint, AdjointOptions, AdjointStats, AdjointStatus, Solution, Status};
use crate::spec::{Parameters, check_array};
use crate::vector::{norm, zeros};
use nalgebra::Vector3;
use std::time::Instant;

/// How much the residual at the given positions may exceed the one the forward solve reported: roundoff, not another state.
const RESIDUAL_SLACK: f64 = 1.01;

pub(crate) fn adjoint(
    problem: &mut Problem,
    parameters: &Parameters,
    solution: &Solution,
    cotangent: &[Vector3<f64>],
    options: &AdjointOptions,
) -> Result<Adjoint, SolverError> {
    let start = Instant::now();
    parameters.check(&problem.rest_parameters)?;
    let n = problem.len();
    check_array("positions", &solution.positions, n, |_| true)?;
    check_array("cotangent", cotangent, n, |_| true)?;
    problem.set_parameters(parameters);
    let refused = |status| Adjoint {
        gradient: None,
        status,
        stats: AdjointStats {
            iterations: 0,
            negative_curvature: false,
            relative_residual: f64::NAN,
            smallest_pair_sum: None,
            seconds: start.elapsed().as_secs_f64(),
        },
    };
    if !cotangent.iter().all(|v| v.iter().all(|x| x.is_finite())) {
        return Ok(refused(AdjointStatus::NotFinite));
    }
    let u = &solution.positions;
    if !options.allow_unconverged && !is_equilibrium(problem, solution) {
        return Ok(refused(AdjointStatus::ForwardNotConverged));
    }
    problem.linearise(u);
    let smallest_pair_sum = problem.work.smallest_pair_sum;

    // Scaled to unit size, so that cotangents near the limits of the number format neither overflow nor vanish.
    let mut b = cotangent.to_vec();
    problem.clear_prescribed(&mut b);
    let scale = norm(&b);
    if scale > 0.0 {
        b.iter_mut().for_each(|b| *b /= scale);
    }
    let (tolerance, limit) = (options.tolerance, options.max_iterations);
    let mut linear = conjugate_gradients(problem, &b, tolerance, limit);
    let mut iterations = linear.iterations;
    let negative_curvature = linear.status == LinearStatus::NegativeCurvature;
    if linear.status != LinearStatus::Converged {
        linear = minres(problem, &b, tolerance, limit);
        iterations += linear.iterations;
    }
    let status = match linear.status {
        LinearStatus::Converged if negative_curvature => AdjointStatus::ConvergedIndefinite,
        LinearStatus::Converged => AdjointStatus::Converged,
        LinearStatus::Breakdown => AdjointStatus::NotFinite,
        _ => AdjointStatus::IterationLimit,
    };
    let stats = AdjointStats {
        iterations,
        negative_curvature,
        relative_residual: linear.relative_residual,
        smallest_pair_sum,
        seconds: start.elapsed().as_secs_f64(),
    };
    if status == AdjointStatus::NotFinite {
        let gradient = None;
        return Ok(Adjoint {
            gradient,
            status,
            stats,
        });
    }
    let mut z = linear.x;
    z.iter_mut().for_each(|z| *z *= scale);
    let mut gradient = parameters.zeros_like();
    problem.parameter_vjp(u, &z, &mut gradient);
    let mut reaction = zeros(n);
    problem.full_hessian_product(&z, &mut reaction);
    for (out, &node) in gradient.prescribed.iter_mut().zip(&problem.prescribed) {
        *out = cotangent[node as usize] - reaction[node as usize];
    }
    let stats = AdjointStats {
        seconds: start.elapsed().as_secs_f64(),
        ..stats
    };
    Ok(Adjoint {
        gradient: Some(gradient),
        status,
        stats,
    })
}

/// Whether the forward solve converged and its positions still are where it left them.
fn is_equilibrium(problem: &mut Problem, solution: &Solution) -> bool {
    if solution.status != Status::Converged {
        return false;
    }
    let mut gradient = zeros(problem.len());
    problem.evaluate(&solution.positions, &mut gradient);
    let allowed = RESIDUAL_SLACK * solution.stats.gradient_norm + problem.gradient_floor();
    norm(&gradient) <= allowed
}
