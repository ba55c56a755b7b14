//! Solves that begin somewhere hopeless. The material wants to be as it was, so the rest shape, with energy zero, is the answer.

use crate::body::{Body, METHODS, max_distance, name};
use crate::case::{Case, Finding, Section};
use crate::check::{checked_solve, never_rises};
use nalgebra::{Rotation3, Vector3};
use pd_solver::{SolveOptions, Status, Stop};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// How far from rest the end may be, in edges of an element.
const NEAR: f64 = 1e-6;
/// What the solver is asked for, in edges of an element.
const ASKED: f64 = 1e-7;
/// Enough even for local/global iterations.
const LIMIT: usize = 5_000;
/// Starts drawn at random, each from another seed.
const SEEDS: u64 = 3;

type Start = fn(&Body, u64) -> Vec<Vector3<f64>>;

pub fn cases() -> Vec<Case> {
    let all: [(&str, &str, u64, Start); 12] = [
        (
            "at one point",
            "every free node stands where the others do: all deformation gradients are zero",
            1,
            |body, _| {
                body.mesh
                    .nodes()
                    .iter()
                    .map(|_| Vector3::repeat(0.3))
                    .collect()
            },
        ),
        (
            "flattened to a plane",
            "one singular value is zero in every sample: inside out is as near as upright",
            1,
            |body, _| moved(body, |x| Vector3::new(x.x, x.y, 0.5)),
        ),
        (
            "flattened to a line",
            "two singular values are zero: the rotation about the line is free",
            1,
            |body, _| moved(body, |x| Vector3::new(x.x, 0.5, 0.5)),
        ),
        (
            "random in the box",
            "nodes anywhere in the bounding box: half of the samples are inverted",
            SEEDS,
            |body, seed| {
                let mut rng = ChaCha8Rng::seed_from_u64(seed);
                let [low, high] = body.bounds();
                let nodes = body.mesh.nodes().iter();
                nodes
                    .map(|_| low.zip_map(&high, |l, h| rng.random_range(l..h)))
                    .collect()
            },
        ),
        (
            "mirrored",
            "every sample is a perfect reflection, whose rotation is not unique",
            1,
            |body, _| moved(body, |x| Vector3::new(-x.x, x.y, x.z)),
        ),
        (
            "mirrored across",
            "mirrored about the plane through its axis: the held face stands against the rest",
            1,
            |body, _| moved(body, |x| Vector3::new(x.x, x.y, 1.0 - x.z)),
        ),
        (
            "twisted by 1 turn",
            "a full turn from end to end",
            1,
            |body, _| twisted(body, 1.0),
        ),
        (
            "twisted by 2 turns",
            "two turns from end to end: neighbouring elements differ by 60 degrees",
            1,
            |body, _| twisted(body, 2.0),
        ),
        (
            "twisted by 4 turns",
            "four turns from end to end: neighbouring elements differ by 120 degrees, and corners fold over",
            1,
            |body, _| twisted(body, 4.0),
        ),
        (
            "shrunk to a millionth",
            "all singular values 1e-6",
            1,
            |body, _| moved(body, |x| x * 1e-6),
        ),
        (
            "blown up a million times",
            "all singular values 1e6",
            1,
            |body, _| moved(body, |x| x * 1e6),
        ),
        (
            "rest",
            "nothing to do, and nothing must be done",
            1,
            |body, _| body.mesh.nodes().to_vec(),
        ),
    ];
    let cases = all.into_iter();
    cases
        .map(|(name, story, seeds, start)| {
            Case::new(Section::Starts, format!("start {name}"), story, move |_| {
                recover(start, seeds)
            })
        })
        .collect()
}

fn moved(body: &Body, to: impl Fn(&Vector3<f64>) -> Vector3<f64>) -> Vec<Vector3<f64>> {
    body.mesh.nodes().iter().map(to).collect()
}

/// The bar turned about its axis, more and more from the wall to its free end.
fn twisted(body: &Body, turns: f64) -> Vec<Vector3<f64>> {
    let [low, high] = body.bounds();
    let middle = (low + high) / 2.0;
    moved(body, |x| {
        let angle = std::f64::consts::TAU * turns * (x.x - low.x) / (high.x - low.x);
        middle + Rotation3::from_axis_angle(&Vector3::x_axis(), angle) * (x - middle)
    })
}

/// Lets every method find the rest shape again.
fn recover(start: Start, seeds: u64) -> Finding {
    let mut body = Body::bar([12, 4, 4], 0.25);
    let parameters = body.solver.rest_parameters();
    let mut finding = Finding::default();
    for method in METHODS {
        let mut found = 0;
        for seed in 0..seeds {
            let start = start(&body, seed);
            let stop = Stop::Accuracy(ASKED * body.mesh.element_size());
            let options = SolveOptions {
                max_iterations: LIMIT,
                ..SolveOptions::new(stop).with_method(method)
            };
            let (solution, part) = checked_solve(&mut body, &parameters, Some(&start), &options);
            finding.merge(part);
            let off =
                max_distance(&solution.positions, body.mesh.nodes()) / body.mesh.element_size();
            if off <= NEAR && solution.status == Status::Converged {
                found += 1;
            } else {
                finding.notes.push(format!(
                    "{}: {:?}, energy {:.3e}, {off:.1e} edges off",
                    name(method),
                    solution.status,
                    solution.stats.energy
                ));
            }
        }
        let first = start(&body, 0);
        finding.merge(never_rises(&mut body, &parameters, &first, method));
        finding.recovered.push((method, found, seeds as usize));
        finding.require(found == seeds as usize, || {
            format!("{} recovers {found} of {seeds}", name(method))
        });
    }
    finding
}
