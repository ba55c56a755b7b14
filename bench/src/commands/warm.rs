//! `warm`: a solve that starts from the equilibrium of a slightly different actuation, of the box or of a body inside a surface.

use crate::case::Case;
use crate::error::Result;
use crate::files::{check_writable, write_json};
use crate::options::{
    Name, SolveArgs, SurfaceArgs, parse_cells, parse_finite, parse_positive, use_threads,
};
use crate::system;
use crate::table::{print, row, say, seconds};
use crate::timing::{again, median, timed};
use clap::Args;
use pd_solver::{Solution, SolveOptions, Status, Stop};
use serde::Serialize;

/// Options of `warm`.
#[derive(Args, Debug)]
pub struct WarmArgs {
    /// Elements of a box along x, y and z.
    #[arg(long, value_name = "NX,NY,NZ", default_value = "32,16,16", conflicts_with = "surface", allow_hyphen_values = true, value_parser = parse_cells)]
    cells: [usize; 3],
    #[command(flatten)]
    body: SurfaceArgs,
    /// How much the actuation grows between the two equilibria, as a share of itself.
    #[arg(long, value_name = "X", default_value_t = 0.01, allow_hyphen_values = true, value_parser = parse_finite)]
    change: f64,
    /// Stop both where no node is farther than this from its place, instead of by the gradient.
    #[arg(long, value_name = "LENGTH", allow_hyphen_values = true, value_parser = parse_positive)]
    accuracy: Option<f64>,
    #[command(flatten)]
    solve: SolveArgs,
}

#[derive(Serialize)]
struct Report {
    /// Elements along the axes, of a box.
    cells: Option<[usize; 3]>,
    elements: usize,
    method: String,
    change: f64,
    relative_gradient: f64,
    /// Instead of the gradient, where given.
    accuracy: Option<f64>,
    /// Median seconds of a solve for the changed actuation from rest.
    cold_s: f64,
    /// Median seconds of the same solve from the equilibrium before the change.
    warm_s: f64,
    /// Warm over cold.
    share: f64,
    cold_iterations: usize,
    warm_iterations: usize,
    cold_energy: f64,
    warm_energy: f64,
    /// Largest distance of a node between the two results.
    distance: f64,
    threads: usize,
    load: Option<f64>,
    cold_status: Status,
    warm_status: Status,
    all_cold_s: Vec<f64>,
    all_warm_s: Vec<f64>,
}

/// Measures, prints and writes; whether everything converged.
///
/// # Errors
/// When the box is too large, the surface cannot be used, or the file cannot be written.
pub fn run(args: &WarmArgs) -> Result<bool> {
    let json = args.solve.repeat.json.as_deref();
    check_writable(json)?;
    use_threads(args.solve.repeat.threads)?;
    let load = system::load();
    let case = match args.body.case(args.solve.seed)? {
        Some(case) => case,
        None => Case::solid_box(args.cells, 1.0)?,
    };
    let (mut solver, before) = case.solver()?;
    let mut after = before.clone();
    let grown = after.actuation.iter_mut().flatten();
    grown.for_each(|b| *b *= 1.0 + args.change);
    let mut options = args.solve.forward();
    if let Some(length) = args.accuracy {
        options.stop = Stop::Accuracy(length);
    }
    let mut start = Solution::default();
    let (mut cold, mut warm) = (Solution::default(), Solution::default());
    let reuse = SolveOptions {
        reuse: true,
        ..options
    };
    let (mut all_cold_s, mut all_warm_s) = (Vec::new(), Vec::new());
    // One after the other, so that a change of the machine's mood meets both.
    loop {
        let (seconds, done) = timed(|| solver.solve_into(&after, None, &options, &mut cold));
        done?;
        all_cold_s.push(seconds);
        solver.solve_into(&before, None, &options, &mut start)?;
        let from = Some(&start.positions[..]);
        let (seconds, done) = timed(|| solver.solve_into(&after, from, &reuse, &mut warm));
        done?;
        all_warm_s.push(seconds);
        if !again(&all_cold_s, &args.solve.repeat) {
            break;
        }
    }
    let pairs = cold.positions.iter().zip(&warm.positions);
    let (cold_s, warm_s) = (median(&all_cold_s), median(&all_warm_s));
    let report = Report {
        cells: case.cells,
        elements: case.mesh.elements().len(),
        method: Name::to_string(&args.solve.method),
        change: args.change,
        relative_gradient: args.solve.relative_gradient,
        accuracy: args.accuracy,
        cold_s,
        warm_s,
        share: warm_s / cold_s,
        cold_iterations: cold.stats.iterations,
        warm_iterations: warm.stats.iterations,
        cold_energy: cold.stats.energy,
        warm_energy: warm.stats.energy,
        distance: pairs.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max),
        threads: rayon::current_num_threads(),
        load,
        cold_status: cold.status,
        warm_status: warm.status,
        all_cold_s,
        all_warm_s,
    };
    write_json(json, &report)?;
    print_report(&report);
    let statuses = [start.status, cold.status, warm.status];
    Ok(statuses.iter().all(|&status| status == Status::Converged))
}

fn print_report(r: &Report) {
    let count = |n: usize| n.to_string();
    let energy = |e: f64| format!("{e:.9}");
    print(&[
        row(["start", "seconds", "iterations", "energy"]),
        row([
            "rest",
            &seconds(r.cold_s),
            &count(r.cold_iterations),
            &energy(r.cold_energy),
        ]),
        row([
            "before",
            &seconds(r.warm_s),
            &count(r.warm_iterations),
            &energy(r.warm_energy),
        ]),
    ]);
    say(&format!(
        "actuation changed by {} %: {:.3} of a cold solve; results {:.2e} apart\n",
        100.0 * r.change,
        r.share,
        r.distance
    ));
}
