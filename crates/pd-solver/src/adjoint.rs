//! The exact implicit adjoint (maths.md "Implicit adjoint"): one linear solve with the true Hessian.

use crate::krylov::{LinearStatus, System, minres, smallest_ritz_value, solve_at};
use crate::methods::{Preconditioner, Workspace};
use crate::parameters::Parameters;
use crate::problem::Problem;
use crate::solution::{Adjoint, AdjointOptions, AdjointStats, AdjointStatus, Solution, Status};
use crate::vector::norm;
use nalgebra::Vector3;
use std::time::Instant;

/// How much the residual at the given positions may exceed the one the forward solve reported: roundoff, not another state.
const RESIDUAL_SLACK: f64 = 1.01;

/// Stiffness of a direction against the preconditioner below which the Hessian is called next to singular.
const SOFT: f64 = 1e-7;
/// Sum s_i + s_j at a sample below which its rotation is called not unique.
const UNIQUE: f64 = 1e-10;

/// Linearises where a solve ended: false, if it did not converge or its positions are not where it left them.
pub(crate) fn linearise_at_equilibrium(
    problem: &mut Problem,
    space: &mut Workspace,
    solution: &Solution,
) -> bool {
    if solution.status != Status::Converged {
        return false;
    }
    space.reserve(problem.len());
    problem.linearise_with_gradient(&solution.positions, &mut space.gradient);
    let allowed =
        RESIDUAL_SLACK * solution.stats.gradient_norm + problem.gradient_floor(&solution.positions);
    norm(&space.gradient) <= allowed
}

/// Whether small errors of the state leave a gradient small errors: nothing next to singular was met.
fn is_well_conditioned(softest: Option<f64>, smallest_pair_sum: Option<f64>) -> bool {
    softest.is_none_or(|s| s > SOFT) && smallest_pair_sum.is_none_or(|s| s > UNIQUE)
}

/// Sets `out` to a refusal.
pub(crate) fn refuse(out: &mut Adjoint, status: AdjointStatus, start: Instant) {
    out.gradient = None;
    out.status = status;
    out.stats = AdjointStats {
        iterations: 0,
        negative_curvature: false,
        relative_residual: f64::NAN,
        softest: None,
        smallest_pair_sum: None,
        seconds: start.elapsed().as_secs_f64(),
    };
}

/// The gradient for one cotangent, at a state where the problem is linearised; the memory of `out` is used again.
pub(crate) fn adjoint(
    problem: &mut Problem,
    pre: &mut dyn Preconditioner,
    space: &mut Workspace,
    u: &[Vector3<f64>],
    cotangent: &[Vector3<f64>],
    options: &AdjointOptions,
    out: &mut Adjoint,
) {
    let start = Instant::now();
    if !cotangent.iter().all(|v| v.iter().all(|x| x.is_finite())) {
        return refuse(out, AdjointStatus::NotFinite, start);
    }
    let n = problem.len();
    let smallest_pair_sum = problem.work.smallest_pair_sum;
    space.reserve(n);
    space.krylov.reserve(n);

    // Scaled to unit size, so that cotangents near the limits of the number format neither overflow nor vanish.
    let b = &mut space.scratch;
    b.copy_from_slice(cotangent);
    problem.clear_prescribed(b);
    problem.make_consistent(u, b);
    let scale = norm(b);
    if scale > 0.0 {
        b.iter_mut().for_each(|b| *b /= scale);
    }
    let warm = options.warm_start && out.multiplier.len() == n && scale > 0.0;
    if warm {
        let x = space.krylov.x.iter_mut().zip(&out.multiplier);
        x.for_each(|(x, z)| *x = z / scale);
        problem.clear_prescribed(&mut space.krylov.x);
    }
    let (tolerance, limit) = (options.tolerance, options.max_iterations);
    let mut system = System {
        problem,
        pre,
        reactions: &mut space.reactions,
    };
    let mut linear = solve_at(
        &mut system,
        u,
        &space.scratch,
        &mut space.krylov,
        warm,
        tolerance,
        limit,
    );
    let mut iterations = linear.iterations;
    let softest = smallest_ritz_value(&space.krylov.lanczos);
    let negative_curvature = linear.status == LinearStatus::NegativeCurvature;
    if linear.status != LinearStatus::Converged {
        // MINRES takes any Hessian, but its preconditioner has to be positive definite.
        system.pre.project(system.problem, u);
        linear = minres(
            &mut system,
            &space.scratch,
            &mut space.krylov.x,
            tolerance,
            limit,
        );
        iterations += linear.iterations;
    }
    out.status = match linear.status {
        LinearStatus::Converged if negative_curvature => AdjointStatus::ConvergedIndefinite,
        LinearStatus::Converged => match is_well_conditioned(softest, smallest_pair_sum) {
            true => AdjointStatus::Converged,
            false => AdjointStatus::ConvergedIllConditioned,
        },
        LinearStatus::Breakdown => AdjointStatus::NotFinite,
        _ => AdjointStatus::IterationLimit,
    };
    out.stats = AdjointStats {
        iterations,
        negative_curvature,
        relative_residual: linear.relative_residual,
        softest,
        smallest_pair_sum,
        seconds: 0.0,
    };
    if out.status == AdjointStatus::NotFinite {
        out.gradient = None;
    } else {
        let z = &mut out.multiplier;
        z.resize(n, Vector3::zeros());
        let solved = z.iter_mut().zip(&space.krylov.x);
        solved.for_each(|(z, x)| *z = x * scale);
        let reactions = space.reactions.sum.iter().map(|reaction| reaction * scale);
        gradient(problem, reactions, u, cotangent, out);
    }
    out.stats.seconds = start.elapsed().as_secs_f64();
}

/// dL/d parameters from the multiplier and `H` times it at prescribed nodes.
fn gradient(
    problem: &mut Problem,
    reactions: impl Iterator<Item = Vector3<f64>>,
    u: &[Vector3<f64>],
    cotangent: &[Vector3<f64>],
    out: &mut Adjoint,
) {
    let like = &problem.rest_parameters;
    let gradient = out.gradient.get_or_insert_with(Parameters::default);
    gradient.begin_gradient(like);
    problem.parameter_vjp(u, &out.multiplier, gradient);
    let prescribed = problem.prescribed.iter().zip(reactions);
    for (out, (&node, reaction)) in gradient.prescribed.iter_mut().zip(prescribed) {
        *out = cotangent[node as usize] - reaction;
    }
}

#[cfg(test)]
mod tests;
