//! What must hold of every solve and every gradient.

use crate::body::{Body, name};
use crate::case::Finding;
use nalgebra::Vector3;
use pd_solver::{
    AdjointOptions, AdjointStatus, Method, Parameters, Solution, SolveOptions, Status, Stop,
};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// How much an energy may rise by roundoff, of the largest seen.
const ROUNDOFF: f64 = 1e-12;
/// Accuracy of the equilibria that a difference is taken of, in edges of an element.
const TIGHT: f64 = 1e-10;
/// How far a slope may be from the difference that it is compared with.
const SLOPE: f64 = 1e-4;
/// Limits of iterations after which the energy of a solve is looked at.
const LIMITS: [usize; 9] = [0, 1, 2, 3, 4, 6, 10, 20, 50];

/// Whether all entries are finite.
pub fn all_finite(x: &[Vector3<f64>]) -> bool {
    x.iter().all(|x| x.iter().all(|x| x.is_finite()))
}

/// Solves, and looks at what every solve must keep: finite numbers, and a status that tells the truth.
pub fn checked_solve(
    body: &mut Body,
    parameters: &Parameters,
    start: Option<&[Vector3<f64>]>,
    options: &SolveOptions,
) -> (Solution, Finding) {
    let mut finding = Finding::default();
    let solution = match body.solver.solve(parameters, start, options) {
        Ok(solution) => solution,
        Err(error) => {
            finding.status = "refused".into();
            finding.broken.push(error.to_string());
            return (Solution::default(), finding);
        }
    };
    let stats = &solution.stats;
    let method = name(options.method);
    finding.status = format!("{:?}", solution.status).to_lowercase();
    finding.iterations = stats.iterations;
    finding.residual = stats.relative_gradient().unwrap_or(0.0);
    finding.see_pair_sum(stats.work.smallest_pair_sum);
    finding.require(all_finite(&solution.positions), || {
        format!("{method}: positions that are not finite")
    });
    let (energy, gradient) = body
        .solver
        .energy_gradient(parameters, &solution.positions)
        .expect("a state of this body");
    let norm = gradient
        .iter()
        .map(|g| g.norm_squared())
        .sum::<f64>()
        .sqrt();
    finding.require(energy.is_finite() && norm.is_finite(), || {
        format!("{method}: energy {energy}, gradient {norm}")
    });
    // The status tells the truth: what the solver says of its result is so when it is computed anew.
    let same = |a: f64, b: f64| (a - b).abs() <= 1e-9 * a.abs().max(b.abs()) + 1e-300;
    finding.require(same(energy, stats.energy), || {
        format!(
            "{method}: tells energy {} where it is {energy}",
            stats.energy
        )
    });
    finding.require(
        (norm - stats.gradient_norm).abs() <= 1e-9 * norm + 1e-12 * energy.abs().sqrt() + 1e-14,
        || {
            format!(
                "{method}: tells gradient {} where it is {norm}",
                stats.gradient_norm
            )
        },
    );
    if let (Status::Converged, Stop::RelativeGradient(asked), Some(rest)) =
        (solution.status, options.stop, stats.gradient_norm_rest)
    {
        let size = body.mesh.element_size() * (body.mesh.nodes().len() as f64).sqrt();
        let floor = 1e-13 * body.stiffest * size;
        finding.require(norm <= asked * rest * (1.0 + 1e-9) + floor, || {
            format!("{method}: converged with a gradient of {norm}, asked {asked} of {rest}")
        });
    }
    (solution, finding)
}

/// Whether a gradient that is called reliable is the slope of what it belongs to: of a loss linear in the positions, along a random change of the
/// actuation, by a central difference of equilibria solved anew from here. Where the adjoint warns, nothing is asked of it.
pub fn gradient_holds(
    body: &mut Body,
    parameters: &Parameters,
    solution: &Solution,
    method: Method,
) -> Finding {
    let mut finding = Finding::default();
    let tight = SolveOptions {
        max_iterations: 30,
        ..SolveOptions::new(Stop::Accuracy(TIGHT * body.mesh.element_size()))
            .with_method(Method::Newton)
    };
    // As near the equilibrium as floating point allows: the slope is that of the branch that this state is on.
    let Ok(mut here) = body
        .solver
        .solve(parameters, Some(&solution.positions), &tight)
    else {
        return finding;
    };
    if here.status == Status::Stalled {
        here.status = Status::Converged;
    }
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let cotangent: Vec<Vector3<f64>> = here
        .positions
        .iter()
        .map(|_| Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0)))
        .collect();
    let adjoint = body
        .solver
        .adjoint(parameters, &here, &cotangent, &AdjointOptions::default())
        .expect("a state of this body");
    finding.negative_curvature = adjoint.stats.negative_curvature;
    finding.see_pair_sum(adjoint.stats.smallest_pair_sum);
    let Some(gradient) = adjoint
        .gradient
        .filter(|_| adjoint.status == AdjointStatus::Converged)
    else {
        let status = format!("{:?}", adjoint.status);
        finding
            .notes
            .push(format!("{}: the adjoint says {status}", name(method)));
        return finding;
    };
    let direction: Vec<[f64; 6]> = parameters
        .actuation
        .iter()
        .map(|_| std::array::from_fn(|_| rng.random_range(-1.0..1.0)))
        .collect();
    let slope: f64 = direction
        .iter()
        .flatten()
        .zip(gradient.actuation.iter().flatten())
        .map(|(d, g)| d * g)
        .sum();
    let mut loss = |t: f64| -> Option<f64> {
        let mut moved = parameters.clone();
        let entries = moved.actuation.iter_mut().flatten();
        entries
            .zip(direction.iter().flatten())
            .for_each(|(b, d)| *b += t * d);
        let near = body
            .solver
            .solve(&moved, Some(&here.positions), &tight)
            .ok()?;
        let terms = near.positions.iter().zip(&cotangent);
        Some(terms.map(|(x, c)| x.dot(c)).sum())
    };
    // Steps from large to small: where the equilibrium bends, only a small one shows its slope.
    let mut best = f64::INFINITY;
    for step in [1e-3, 1e-4, 1e-5, 1e-6] {
        let at = [step, -step, 2.0 * step, -2.0 * step].map(&mut loss);
        if let [Some(a), Some(b), Some(c), Some(d)] = at {
            let found = (8.0 * (a - b) - (c - d)) / (12.0 * step);
            best = best.min((found - slope).abs() / slope.abs().max(found.abs()));
        }
    }
    finding.residual = best;
    finding.require(best < SLOPE, || {
        format!(
            "{}: a gradient called reliable is off by {best:.1e} of itself",
            name(method)
        )
    });
    finding
}

/// Whether the energy never rises from iteration to iteration: the same solve with higher and higher limits.
pub fn never_rises(
    body: &mut Body,
    parameters: &Parameters,
    start: &[Vector3<f64>],
    method: Method,
) -> Finding {
    let mut finding = Finding::default();
    let mut last = f64::INFINITY;
    for limit in LIMITS {
        let options = SolveOptions {
            max_iterations: limit,
            ..SolveOptions::new(Stop::RelativeGradient(1e-10)).with_method(method)
        };
        let energy = match body.solver.solve(parameters, Some(start), &options) {
            Ok(solution) => solution.stats.energy,
            Err(error) => {
                finding.broken.push(error.to_string());
                return finding;
            }
        };
        let rise = energy - last;
        finding.require(energy.is_finite(), || {
            format!("{}: energy {energy}", name(method))
        });
        finding.require(rise <= ROUNDOFF * energy.abs().max(1e-300), || {
            format!(
                "{}: the energy rises by {rise:.1e} up to iteration {limit}",
                name(method)
            )
        });
        last = energy;
    }
    finding
}
