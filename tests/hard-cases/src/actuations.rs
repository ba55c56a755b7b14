//! Actuations that no muscle has. What must hold: every method tells the truth, the energy falls, and a gradient that is called reliable is the
//! slope of what it belongs to.

use crate::body::{Body, METHODS, name};
use crate::case::{Case, Finding, Section};
use crate::check::{checked_solve, gradient_holds, never_rises};
use nalgebra::{Matrix3, Rotation3, Vector3};
use pd_solver::{Parameters, SolveOptions, Status, Stop};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// What the solver is asked for, in edges of an element.
const ASKED: f64 = 1e-6;
/// Steps at most: some of these bodies fold in thousands of places.
const LIMIT: usize = 3000;

type Actuation = fn(&Body) -> Parameters;

pub fn cases() -> Vec<Case> {
    let all: [(&str, &str, Actuation); 6] = [
        (
            "random stretch",
            "every sample wants another stretch, 0.1 to 10 along axes of its own",
            |body| {
                let mut rng = ChaCha8Rng::seed_from_u64(7);
                body.actuated(|_, _| {
                    let turn = Rotation3::new(Vector3::from_fn(|_, _| rng.random_range(-3.0..3.0)));
                    let stretch = Vector3::from_fn(|_, _| 10f64.powf(rng.random_range(-1.0..1.0)));
                    entries(&(turn * Matrix3::from_diagonal(&stretch) * turn.inverse()))
                })
            },
        ),
        (
            "alternating signs",
            "every second element along the bar wants to be upside down: A = I, then A = -I",
            |body| by_parity(body, |cell| cell[0], [1.0, -1.0]),
        ),
        (
            "checkerboard",
            "neighbours across every face want twice and half the size",
            |body| by_parity(body, |cell| cell[0] + cell[1] + cell[2], [2.0, 0.5]),
        ),
        (
            "jump of a thousand",
            "one half wants to be a thousand times as large as the other",
            |body| {
                let cells = body.mesh.cells().to_vec();
                body.actuated(|e, _| uniform(if cells[e][0] < 6 { 1.0 } else { 1e3 }))
            },
        ),
        (
            "vanishing",
            "all material wants to be a point: A = 0, so that no rotation is told from another",
            |body| body.actuated(|_, _| uniform(0.0)),
        ),
        (
            "inside out",
            "all material wants to be its mirror image, which no rotation reaches",
            |body| {
                body.actuated(|_, _| {
                    entries(&Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0)))
                })
            },
        ),
    ];
    all.into_iter()
        .map(|(name, story, make)| {
            Case::new(
                Section::Actuations,
                format!("actuation {name}"),
                story,
                move |_| solve_all(make),
            )
        })
        .collect()
}

/// b of a symmetric A.
fn entries(a: &Matrix3<f64>) -> [f64; 6] {
    let b = a - Matrix3::identity();
    [b.m11, b.m12, b.m13, b.m22, b.m23, b.m33]
}

fn uniform(stretch: f64) -> [f64; 6] {
    entries(&(Matrix3::identity() * stretch))
}

fn by_parity(body: &Body, number: fn(&[i32; 3]) -> i32, stretches: [f64; 2]) -> Parameters {
    let cells = body.mesh.cells().to_vec();
    body.actuated(|e, _| uniform(stretches[number(&cells[e]).rem_euclid(2) as usize]))
}

/// Solves from rest by every method.
fn solve_all(make: Actuation) -> Finding {
    let mut body = Body::bar([12, 4, 4], 0.25);
    let parameters = make(&body);
    let rest = body.mesh.nodes().to_vec();
    let mut finding = Finding::default();
    let mut energies = Vec::new();
    for method in METHODS {
        let options = SolveOptions {
            max_iterations: LIMIT,
            ..SolveOptions::new(Stop::Accuracy(ASKED * body.mesh.element_size()))
                .with_method(method)
        };
        let (solution, part) = checked_solve(&mut body, &parameters, None, &options);
        finding.merge(part);
        finding.merge(never_rises(&mut body, &parameters, &rest, method));
        energies.push(format!(
            "{} {:.6} ({:?}, {} steps)",
            name(method),
            solution.stats.energy,
            solution.status,
            solution.stats.iterations
        ));
        if solution.status == Status::Converged {
            finding.merge(gradient_holds(&mut body, &parameters, &solution, method));
        }
    }
    finding
        .notes
        .push(format!("energies: {}", energies.join("; ")));
    finding
}
