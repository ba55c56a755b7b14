//! Many solves of one body, each from where the last one ended.

use crate::body::{Body, max_distance};
use crate::case::{Case, Effort, Finding, Section};
use crate::check::{all_finite, checked_solve};
use pd_solver::{Solution, SolveOptions, Status, Stop};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// What the solver is asked for, in edges of an element.
const ASKED: f64 = 1e-5;
/// Solves between comparisons with one from rest.
const COMPARED: usize = 100;
/// Growth of the process that is not one: pages of the allocator.
const PAGES: u64 = 1 << 20;

pub fn cases() -> Vec<Case> {
    [false, true]
        .map(|reuse| {
            let (name, story) = match reuse {
                false => (
                    "long run of warm starts",
                    "the actuation wanders, every solve begins where the last one ended: no drift against solves from rest, no growth of memory",
                ),
                true => (
                    "long run with everything used again",
                    "the same, with the preconditioner of the call before, too",
                ),
            };
            Case::new(Section::LongRuns, name, story, move |effort| wander(effort, reuse))
        })
        .into_iter()
        .collect()
}

fn wander(effort: &Effort, reuse: bool) -> Finding {
    let mut body = Body::bar([12, 6, 6], 0.25);
    let edge = body.mesh.element_size();
    let accuracy = ASKED * edge;
    let mut parameters = body.solver.rest_parameters();
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    // A few waves whose strengths wander, pulled back so that they stay muscles.
    let mut strengths = [[0.0; 6]; 3];
    let samples = parameters.actuation.len() / body.mesh.elements().len();
    let corners: Vec<_> = (0..body.mesh.elements().len())
        .map(|e| body.mesh.element_corner(e))
        .collect();
    let mut solution = Solution::default();
    let mut start = body.mesh.nodes().to_vec();
    let (mut finding, mut farthest, mut before) = (Finding::default(), 0.0_f64, None);
    for call in 0..effort.calls {
        for s in strengths.iter_mut().flatten() {
            *s = 0.98 * *s + rng.random_range(-0.02..0.02);
        }
        for (i, b) in parameters.actuation.iter_mut().enumerate() {
            let x = corners[i / samples];
            let waves = [1.0, (1.3 * x.x).sin(), (2.1 * x.y + x.z).cos()];
            *b = std::array::from_fn(|k| (0..3).map(|w| waves[w] * strengths[w][k]).sum());
        }
        let options = SolveOptions {
            reuse,
            ..SolveOptions::new(Stop::Accuracy(accuracy))
        };
        if let Err(error) =
            body.solver
                .solve_into(&parameters, Some(&start), &options, &mut solution)
        {
            finding.broken.push(format!("call {call}: {error}"));
            return finding;
        }
        start.copy_from_slice(&solution.positions);
        finding.iterations += solution.stats.iterations;
        finding.require(
            solution.status == Status::Converged && all_finite(&solution.positions),
            || format!("call {call}: {:?}", solution.status),
        );
        if call % COMPARED == COMPARED - 1 {
            let cold = SolveOptions::new(Stop::Accuracy(accuracy / 10.0));
            let (cold, part) = checked_solve(&mut body, &parameters, None, &cold);
            finding.merge(Finding {
                iterations: 0,
                ..part
            });
            farthest = farthest.max(max_distance(&cold.positions, &solution.positions));
        }
        // What is allocated once is allocated by then.
        if call == effort.calls / 5 {
            before = resident();
        }
    }
    finding.notes.push(format!(
        "{} calls, {:.2} steps each; never farther than {:.2e} edges from a solve from rest (asked {ASKED:e})",
        effort.calls,
        finding.iterations as f64 / effort.calls as f64,
        farthest / edge
    ));
    finding.require(farthest <= 2.0 * accuracy, || {
        format!(
            "drifts {:.1e} edges from a solve from rest",
            farthest / edge
        )
    });
    match (before, resident()) {
        (Some(before), Some(after)) => {
            let grown = after.saturating_sub(before);
            finding.notes.push(format!(
                "memory grew by {} KiB over the last four fifths",
                grown >> 10
            ));
            finding.require(grown <= PAGES, || format!("memory grew by {grown} bytes"));
        }
        _ => finding
            .notes
            .push("this system does not tell the memory of a process".into()),
    }
    finding
}

/// Memory of this process, where the system tells it.
fn resident() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmRSS:"))?;
    let kib: u64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib << 10)
}
