//! Gradients where there is next to none.

use crate::body::{Body, elasticity, held, nodes_where};
use crate::case::{Case, Entry, Finding, Section};
use crate::check::{checked_solve, gradient_holds};
use hex_mesh::{HexMesh, Quadrature};
use nalgebra::Vector3;
use pd_solver::{
    Adjoint, AdjointOptions, AdjointStatus, Method, Parameters, Solution, SolveOptions, Status,
    Stop,
};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

pub fn cases() -> Vec<Case> {
    let all: [Entry; 9] = [
        (
            "at the point of buckling",
            "a slender bar between two walls that grows until it is about to bend: the Hessian is next to singular, and the adjoint must say so",
            |_| about_to_buckle(),
        ),
        (
            "at a saddle",
            "the same bar, grown more, but still straight: no minimum, and the adjoint must say so",
            |_| at_a_saddle(),
        ),
        (
            "after buckling",
            "the same bar, bent: a minimum again, with a gradient that finite differences confirm",
            |_| after_buckling(),
        ),
        (
            "not converged",
            "the forward solve stopped at its limit: no gradient at all, unless asked for, and then never called reliable for the equilibrium",
            |_| not_converged(),
        ),
        (
            "elsewhere",
            "positions moved after the solve: no gradient",
            |_| elsewhere(),
        ),
        (
            "cotangent zero",
            "a loss that does not care: the gradient is zero, not 0/0",
            |_| scaled(0.0),
        ),
        (
            "cotangent 1e-300",
            "whose square is zero: the gradient is that of 1, times 1e-300",
            |_| scaled(1e-300),
        ),
        (
            "cotangent 1e300",
            "whose square is infinite: the gradient is that of 1, times 1e300",
            |_| scaled(1e300),
        ),
        (
            "cotangent not finite",
            "a NaN in the loss: no gradient, and no error that ends a program",
            |_| not_finite(),
        ),
    ];
    all.into_iter()
        .map(|(name, story, run)| {
            Case::new(Section::Adjoints, format!("adjoint {name}"), story, run)
        })
        .collect()
}

/// A slender bar between two walls, flat, so that it knows which way to bend.
fn strut() -> Body {
    let mesh = HexMesh::solid_box([24, 2, 3], 0.25, Quadrature::Eight).expect("a valid box");
    let end = 24.0 * 0.25;
    let walls = nodes_where(&mesh, |x| x.x == 0.0 || x.x == end);
    Body::new(mesh, &[elasticity(), held(walls)])
}

/// All of it wants to be longer by a share.
fn grown(body: &Body, share: f64) -> Parameters {
    body.actuated(|_, _| [share, 0.0, 0.0, 0.0, 0.0, 0.0])
}

fn tight(method: Method) -> SolveOptions {
    SolveOptions::new(Stop::RelativeGradient(1e-10)).with_method(method)
}

/// Reproducible numbers without any symmetry.
fn random_cotangent(body: &Body) -> Vec<Vector3<f64>> {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let nodes = body.mesh.nodes().iter();
    nodes
        .map(|_| Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0)))
        .collect()
}

fn adjoint_of(
    body: &mut Body,
    parameters: &Parameters,
    solution: &Solution,
    cotangent: &[Vector3<f64>],
    finding: &mut Finding,
) -> Adjoint {
    let options = AdjointOptions::default();
    let adjoint = body
        .solver
        .adjoint(parameters, solution, cotangent, &options)
        .expect("a state of this body");
    finding.status = format!("{:?}", adjoint.status);
    finding.iterations += adjoint.stats.iterations;
    finding.negative_curvature |= adjoint.stats.negative_curvature;
    finding.see_pair_sum(adjoint.stats.smallest_pair_sum);
    if adjoint.gradient.is_some() {
        finding.residual = adjoint.stats.relative_residual;
    }
    adjoint
}

/// The straight state: a few steps of Newton from rest keep its symmetry.
fn straight(body: &mut Body, share: f64) -> (Parameters, Solution, Finding) {
    let parameters = grown(body, share);
    let (solution, finding) = checked_solve(body, &parameters, None, &tight(Method::Newton));
    (parameters, solution, finding)
}

/// The growth at which the straight state loses its stability, found by what the adjoint says of it.
fn critical(body: &mut Body) -> f64 {
    let cotangent = random_cotangent(body);
    let (mut stable, mut unstable) = (0.0, 0.5);
    for _ in 0..48 {
        let middle = 0.5 * (stable + unstable);
        let (parameters, solution, _) = straight(body, middle);
        let mut unused = Finding::default();
        let adjoint = adjoint_of(body, &parameters, &solution, &cotangent, &mut unused);
        if adjoint.stats.negative_curvature {
            unstable = middle;
        } else {
            stable = middle;
        }
    }
    stable
}

fn about_to_buckle() -> Finding {
    let mut body = strut();
    let share = critical(&mut body);
    let (parameters, solution, mut finding) = straight(&mut body, share);
    let cotangent = random_cotangent(&body);
    let adjoint = adjoint_of(&mut body, &parameters, &solution, &cotangent, &mut finding);
    let softest = adjoint.stats.softest.unwrap_or(f64::NAN);
    finding.notes.push(format!(
        "it buckles when it grows by {:.3} %; softest direction there {softest:.1e} of the preconditioner",
        share * 100.0
    ));
    finding.require(!adjoint.status.is_reliable(), || {
        format!("called {:?} at the bifurcation", adjoint.status)
    });
    finding
}

fn at_a_saddle() -> Finding {
    let mut body = strut();
    let (parameters, solution, mut finding) = straight(&mut body, 0.1);
    let cotangent = random_cotangent(&body);
    let adjoint = adjoint_of(&mut body, &parameters, &solution, &cotangent, &mut finding);
    finding.require(adjoint.stats.negative_curvature, || {
        "no negative curvature met".into()
    });
    finding.require(adjoint.status == AdjointStatus::ConvergedIndefinite, || {
        format!("called {:?}", adjoint.status)
    });
    finding
}

fn after_buckling() -> Finding {
    let mut body = strut();
    let (parameters, flat, _) = straight(&mut body, 0.1);
    let mut finding = Finding::default();
    for method in crate::body::METHODS {
        let options = SolveOptions {
            max_iterations: 20_000,
            ..SolveOptions::new(Stop::Accuracy(1e-7))
                .with_method(method)
                .leaving_saddles()
        };
        let (solution, part) = checked_solve(&mut body, &parameters, None, &options);
        finding.merge(part);
        finding.require(solution.stats.energy < 0.9 * flat.stats.energy, || {
            format!(
                "{method:?} stays straight: energy {} of {}",
                solution.stats.energy, flat.stats.energy
            )
        });
        finding.require(solution.stats.negative_curvature == Some(false), || {
            format!(
                "{method:?} does not tell that this is a minimum: {:?} after {} steps, negative curvature {:?}",
                solution.status, solution.stats.iterations, solution.stats.negative_curvature
            )
        });
        if method == Method::Multigrid {
            finding.notes.push(format!(
                "energy {:.5} straight, {:.5} bent",
                flat.stats.energy, solution.stats.energy
            ));
            finding.merge(gradient_holds(&mut body, &parameters, &solution, method));
        }
    }
    finding
}

/// A bar bent by its actuation, at its equilibrium.
fn bent(limit: usize) -> (Body, Parameters, Solution, Finding) {
    let mut body = Body::bar([8, 3, 3], 0.25);
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let parameters = body.actuated(|_, _| std::array::from_fn(|_| rng.random_range(-0.3..0.3)));
    let options = SolveOptions {
        max_iterations: limit,
        ..tight(Method::Automatic)
    };
    let (solution, finding) = checked_solve(&mut body, &parameters, None, &options);
    (body, parameters, solution, finding)
}

fn not_converged() -> Finding {
    let (mut body, parameters, solution, mut finding) = bent(2);
    finding.require(solution.status == Status::IterationLimit, || {
        format!("two steps are called {:?}", solution.status)
    });
    let cotangent = random_cotangent(&body);
    let adjoint = adjoint_of(&mut body, &parameters, &solution, &cotangent, &mut finding);
    refused(&adjoint, AdjointStatus::ForwardNotConverged, &mut finding);
    finding
}

fn elsewhere() -> Finding {
    let (mut body, parameters, mut solution, mut finding) = bent(2000);
    let last = solution.positions.len() - 1;
    solution.positions[last].x += 0.01;
    let cotangent = random_cotangent(&body);
    let adjoint = adjoint_of(&mut body, &parameters, &solution, &cotangent, &mut finding);
    refused(&adjoint, AdjointStatus::ForwardNotConverged, &mut finding);
    finding
}

fn not_finite() -> Finding {
    let (mut body, parameters, solution, mut finding) = bent(2000);
    let mut cotangent = random_cotangent(&body);
    cotangent[40].y = f64::NAN;
    let adjoint = adjoint_of(&mut body, &parameters, &solution, &cotangent, &mut finding);
    refused(&adjoint, AdjointStatus::NotFinite, &mut finding);
    finding
}

fn refused(adjoint: &Adjoint, expected: AdjointStatus, finding: &mut Finding) {
    finding.require(adjoint.status == expected, || {
        format!("called {:?}", adjoint.status)
    });
    finding.require(adjoint.gradient.is_none(), || {
        "a gradient all the same".into()
    });
}

fn scaled(scale: f64) -> Finding {
    let (mut body, parameters, solution, mut finding) = bent(2000);
    let unit = random_cotangent(&body);
    let of_unit = adjoint_of(&mut body, &parameters, &solution, &unit, &mut finding);
    let cotangent: Vec<_> = unit.iter().map(|c| c * scale).collect();
    let adjoint = adjoint_of(&mut body, &parameters, &solution, &cotangent, &mut finding);
    finding.require(adjoint.status == AdjointStatus::Converged, || {
        format!("called {:?}", adjoint.status)
    });
    let (Some(one), Some(other)) = (of_unit.gradient, adjoint.gradient) else {
        finding.broken.push("no gradient".into());
        return finding;
    };
    let largest = one
        .actuation
        .iter()
        .flatten()
        .fold(0.0, |m: f64, x| m.max(x.abs()));
    let pairs = one
        .actuation
        .iter()
        .flatten()
        .zip(other.actuation.iter().flatten());
    let off = match scale {
        0.0 => pairs.fold(0.0, |m: f64, (_, b)| m.max(b.abs())),
        _ => pairs.fold(0.0, |m: f64, (a, b)| m.max((b / scale - a).abs() / largest)),
    };
    finding.require(off <= 1e-9, || format!("off by {off:.1e} of itself"));
    if scale == 0.0 {
        return finding;
    }
    let wall = one.prescribed.iter().zip(&other.prescribed);
    let off = wall.fold(0.0, |m: f64, (a, b)| m.max((b / scale - a).norm()));
    finding.require(off <= 1e-7, || {
        format!("at prescribed nodes off by {off:.1e}")
    });
    finding
}
