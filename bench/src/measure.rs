//! Setup, forward and backward of one case: times, work, and how good the result is.

use crate::case::{Case, random_cotangent};
use crate::error::Result;
use crate::options::SolveArgs;
use crate::system;
use crate::timing::{again, median, timed};
use nalgebra::Vector3;
use pd_solver::{
    Adjoint, AdjointStats, AdjointStatus, Method, Parameters, Solution, SolveOptions, SolveStats,
    Solver, Status, Stop,
};
use serde::Serialize;

/// How tightly the reference is solved: `|g| <= T |g at rest|`.
const REFERENCE_GRADIENT: f64 = 1e-10;

/// Everything measured on one case. Lengths and positions are in the unit of the mesh.
#[derive(Debug, Serialize)]
pub struct Measurement {
    /// Elements along the axes, of a box.
    pub cells: Option<[usize; 3]>,
    /// Elements.
    pub elements: usize,
    /// Nodes.
    pub nodes: usize,
    /// Samples per element.
    pub samples: usize,
    /// The method asked for.
    pub method: Method,
    /// Asked for `|g| <= T |g at rest|`.
    pub relative_gradient: f64,
    /// Asked for the adjoint's relative residual.
    pub adjoint_tolerance: f64,
    /// Seconds to make the mesh, once.
    pub mesh_s: f64,
    /// Median seconds to build a solver.
    pub setup_s: f64,
    /// Seconds of the first solve from rest.
    pub first_forward_s: f64,
    /// Median seconds of all solves from rest, the first one too.
    pub forward_s: f64,
    /// Median seconds of the adjoint.
    pub backward_s: f64,
    /// Iterations of a solve.
    pub iterations: usize,
    /// Iterations of the adjoint's linear solver.
    pub adjoint_iterations: usize,
    /// Energy at the result.
    pub energy: f64,
    /// `|g| / |g at rest|` at the result.
    pub residual: Option<f64>,
    /// Largest distance of a node from its final place as the solver estimates it.
    pub estimated_error: Option<f64>,
    /// Largest distance of a node from where the reference solve puts it.
    pub true_error: Option<f64>,
    /// Position of the node with the largest x + y + z at rest.
    pub tip: [f64; 3],
    /// Mean position of all nodes.
    pub mean: [f64; 3],
    /// Longest side of the bounding box at rest.
    pub extent: f64,
    /// Peak resident memory of the process in MB (2^20 bytes) until the first setup, solve and adjoint are done.
    pub peak_mb: Option<f64>,
    /// Threads of the pool.
    pub threads: usize,
    /// Load of the machine before, averaged over a minute.
    pub load: Option<f64>,
    /// How the forward solve ended.
    pub status: Status,
    /// How the adjoint ended.
    pub adjoint_status: AdjointStatus,
    /// `|H z - b| / |b|` of the adjoint.
    pub adjoint_residual: f64,
    /// Whether all solves gave the same bits; absent where there was only one.
    pub repeatable: Option<bool>,
    /// A hash of the positions' bits, to compare processes.
    pub positions_hash: String,
    /// How the reference solve ended.
    pub reference: Option<Reference>,
    /// Seconds of every setup.
    pub all_setup_s: Vec<f64>,
    /// Seconds of every solve.
    pub all_forward_s: Vec<f64>,
    /// Seconds of every adjoint.
    pub all_backward_s: Vec<f64>,
    /// What the solver tells of the last solve.
    pub stats: SolveStats,
    /// What the solver tells of the last adjoint.
    pub adjoint_stats: AdjointStats,
}

/// A tight solve that starts from the measured result.
#[derive(Debug, Serialize)]
pub struct Reference {
    /// How it ended; stalled means that floating point allows no more.
    pub status: Status,
    /// `|g| / |g at rest|` there.
    pub residual: Option<f64>,
    /// Energy there.
    pub energy: f64,
    /// Position there of the node with the largest x + y + z at rest.
    pub tip: [f64; 3],
}

impl Measurement {
    /// Whether forward and adjoint met their tolerances.
    pub fn converged(&self) -> bool {
        self.status == Status::Converged && self.adjoint_status.is_converged()
    }
}

/// Measures a case; with `reference` it is also solved tightly, after everything else.
///
/// # Errors
/// When the solver refuses the problem. A solve that does not converge is told in the result.
pub fn measure(case: &Case, args: &SolveArgs, reference: bool) -> Result<Measurement> {
    let load = system::load();
    system::reset_peak();
    let (seconds, built) = timed(|| case.solver());
    let (mut solver, parameters) = built?;
    let rest = solver.rest().to_vec();
    let (mut solution, mut adjoint) = (Solution::default(), Adjoint::default());
    let forward = |solver: &mut Solver, solution: &mut Solution| {
        let (time, done) =
            timed(|| solver.solve_into(&parameters, None, &args.forward(), solution));
        done.map(|()| time)
    };
    let cotangent = random_cotangent(rest.len(), solver.prescribed(), args.seed);
    let mut backward = |solver: &mut Solver, solution: &Solution| {
        let options = args.adjoint();
        let (time, done) = timed(|| {
            solver.adjoint_into(&parameters, solution, &cotangent, &options, &mut adjoint)
        });
        done.map(|()| time)
    };
    let mut all_setup_s = vec![seconds];
    let mut all_forward_s = vec![forward(&mut solver, &mut solution)?];
    let mut all_backward_s = vec![backward(&mut solver, &solution)?];
    // Of one body: setups that follow would find memory in pieces that those before them left.
    let peak_mb = system::peak_megabytes();

    let before = hash(&solution.positions);
    let mut is_same = true;
    while again(&all_forward_s, &args.repeat) {
        all_forward_s.push(forward(&mut solver, &mut solution)?);
        is_same &= hash(&solution.positions) == before;
    }
    let repeatable = (all_forward_s.len() > 1).then_some(is_same);
    while again(&all_backward_s, &args.repeat) {
        all_backward_s.push(backward(&mut solver, &solution)?);
    }
    while again(&all_setup_s, &args.repeat) {
        let (seconds, built) = timed(|| case.solver());
        built?;
        all_setup_s.push(seconds);
    }
    let (true_error, reference) = if reference {
        let (distance, reference) = tight(&mut solver, &parameters, &solution, args)?;
        (Some(distance), Some(reference))
    } else {
        (None, None)
    };

    let stats = solution.stats;
    let nodes = rest.len() as f64;
    let mean = solution.positions.iter().sum::<Vector3<f64>>() / nodes;
    Ok(Measurement {
        cells: case.cells,
        elements: case.mesh.elements().len(),
        nodes: rest.len(),
        samples: case.mesh.quadrature().len(),
        method: args.method.0,
        relative_gradient: args.relative_gradient,
        adjoint_tolerance: args.adjoint_tolerance,
        mesh_s: case.mesh_seconds,
        setup_s: median(&all_setup_s),
        first_forward_s: all_forward_s[0],
        forward_s: median(&all_forward_s),
        backward_s: median(&all_backward_s),
        iterations: stats.iterations,
        adjoint_iterations: adjoint.stats.iterations,
        energy: stats.energy,
        residual: stats.relative_gradient(),
        estimated_error: stats.estimated_error,
        true_error,
        tip: solution.positions[tip(&rest)].into(),
        mean: mean.into(),
        extent: extent(&rest),
        peak_mb,
        threads: rayon::current_num_threads(),
        load,
        status: solution.status,
        adjoint_status: adjoint.status,
        adjoint_residual: adjoint.stats.relative_residual,
        repeatable,
        positions_hash: hash(&solution.positions),
        reference,
        all_setup_s,
        all_forward_s,
        all_backward_s,
        stats,
        adjoint_stats: adjoint.stats,
    })
}

/// Solves on from a solution, tightly: the largest distance that a node still goes, and how that solve ended.
fn tight(
    solver: &mut Solver,
    parameters: &Parameters,
    solution: &Solution,
    args: &SolveArgs,
) -> Result<(f64, Reference)> {
    let stop = Stop::RelativeGradient(REFERENCE_GRADIENT.min(1e-3 * args.relative_gradient));
    let options = SolveOptions::new(stop);
    let exact = solver.solve(parameters, Some(&solution.positions), &options)?;
    let pairs = solution.positions.iter().zip(&exact.positions);
    let distance = pairs.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
    let reference = Reference {
        status: exact.status,
        residual: exact.stats.relative_gradient(),
        energy: exact.stats.energy,
        tip: exact.positions[tip(solver.rest())].into(),
    };
    Ok((distance, reference))
}

/// The node with the largest x + y + z; the first of several.
fn tip(rest: &[Vector3<f64>]) -> usize {
    let mut best = 0;
    for (i, x) in rest.iter().enumerate() {
        if x.sum() > rest[best].sum() {
            best = i;
        }
    }
    best
}

fn extent(rest: &[Vector3<f64>]) -> f64 {
    let low = rest.iter().fold(rest[0], |low, x| low.inf(x));
    let high = rest.iter().fold(rest[0], |high, x| high.sup(x));
    (high - low).max()
}

/// FNV-1a over the bits of all coordinates.
fn hash(positions: &[Vector3<f64>]) -> String {
    let bytes = positions
        .iter()
        .flat_map(|x| [x.x, x.y, x.z])
        .flat_map(|x| x.to_bits().to_le_bytes());
    let hash = bytes.fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
    });
    format!("{hash:016x}")
}
