//! `effects`: what each effect costs, alone and together, and that a list without them costs no more than elasticity written out.

use crate::case::{Case, EDGE, STIFFNESS, random_cotangent};
use crate::error::Result;
use crate::files::{check_writable, write_json};
use crate::lists::{List, lists};
use crate::options::{Name, RepeatArgs, parse_cells, parse_method, parse_positive, use_threads};
use crate::system;
use crate::table::{name, print, row, say, seconds};
use crate::timing::{median, timed};
use clap::Args;
use nalgebra::Vector3;
use pd_solver::bench_support::{ElasticityAlone, evaluate};
use pd_solver::{
    Adjoint, AdjointOptions, AdjointStatus, EmbeddedSurface, Method, Parameters, Solution,
    SolveOptions, Solver, SolverError, Status, Stop,
};
use serde::Serialize;

/// Evaluations in one round, of which the median is taken.
const EVALUATIONS: usize = 11;
/// Pairs of evaluations, with the list of effects and without one.
const PAIRS: usize = 400;

/// Options of `effects`.
#[derive(Args, Debug)]
pub struct EffectsArgs {
    /// Elements along x, y and z.
    #[arg(long, value_name = "NX,NY,NZ", default_value = "32,16,16", allow_hyphen_values = true, value_parser = parse_cells)]
    cells: [usize; 3],
    /// How near its final place each node has to be, in edges of an element.
    #[arg(long, value_name = "X", default_value_t = 1e-3, allow_hyphen_values = true, value_parser = parse_positive)]
    accuracy: f64,
    /// Method of the solves; the solver's default unless given.
    #[arg(long, value_name = "M", default_value_t = Name::default(), value_parser = parse_method)]
    method: Name,
    /// Relative residual of the adjoint's linear solve.
    #[arg(long, value_name = "T", default_value_t = 1e-6, allow_hyphen_values = true, value_parser = parse_positive)]
    adjoint_tolerance: f64,
    #[command(flatten)]
    repeat: RepeatArgs,
}

/// One list of effects.
#[derive(Serialize)]
struct Measured {
    list: &'static str,
    /// Whether the solve is a step in time.
    time_step: bool,
    setup_s: f64,
    solve_s: f64,
    evaluation_s: f64,
    adjoint_s: f64,
    /// Medians of the same over those of the list `none`, each measured right before.
    ratios: Ratios,
    method: Method,
    iterations: usize,
    adjoint_iterations: usize,
    status: Status,
    adjoint_status: AdjointStatus,
    counts: Counts,
    all_setup_s: Vec<f64>,
    all_solve_s: Vec<f64>,
    all_evaluation_s: Vec<f64>,
    all_adjoint_s: Vec<f64>,
}

#[derive(Serialize, Clone, Copy)]
struct Ratios {
    setup: f64,
    solve: f64,
    evaluation: f64,
    adjoint: f64,
}

/// What does not depend on the machine.
#[derive(Serialize, Clone, Copy, Default)]
struct Counts {
    /// Bytes held by effects after building.
    effect_bytes: usize,
    /// Stored entries of the constant matrix, whether or not the method needs it.
    matrix_nonzeros: usize,
    /// Local projections of one evaluation.
    local_projections: u64,
    /// Factorisations in building and one solve.
    factorisations: u64,
    /// Searches of contact in one solve.
    contact_queries: u64,
    /// Evaluations of one solve.
    evaluations: u64,
}

/// The list without effects beside a loop for elasticity alone.
#[derive(Serialize)]
struct Dispatch {
    /// Median seconds of an evaluation through the list of effects.
    listed_s: f64,
    /// Median seconds of the same kernel with nothing around it.
    alone_s: f64,
    /// Ratio of those.
    ratio: f64,
    /// Median of the ratios of the pairs, which other programs on the machine disturb less.
    paired_ratio: f64,
    pairs: usize,
}

#[derive(Serialize)]
struct Report {
    cells: [usize; 3],
    elements: usize,
    nodes: usize,
    accuracy_in_edges: f64,
    adjoint_tolerance: f64,
    rounds: usize,
    threads: usize,
    load: Option<f64>,
    dispatch: Dispatch,
    lists: Vec<Measured>,
    /// Lists that the solver does not take, and why.
    refused: Vec<(&'static str, String)>,
}

/// A list while it is measured.
struct Running {
    list: List,
    solver: Solver,
    parameters: Parameters,
    solution: Solution,
    adjoint: Adjoint,
    counts: Counts,
    /// Seconds of setup, solve, evaluation and adjoint, round by round.
    times: Vec<[f64; 4]>,
    /// The same of the list without effects, measured right before.
    references: Vec<[f64; 4]>,
}

impl Running {
    /// Seconds of one evaluation at the solution, in the thread pool as in a solve.
    fn evaluation(&mut self) -> f64 {
        let (solver, u) = (&mut self.solver, &self.solution.positions);
        let mut gradient = vec![Vector3::zeros(); u.len()];
        rayon::scope(|_| timed(|| evaluate(solver, u, &mut gradient)).0)
    }

    fn all(&self, of: usize) -> Vec<f64> {
        self.times.iter().map(|t| t[of]).collect()
    }

    /// Median over the rounds of the ratio to the list without effects.
    fn ratio(&self, of: usize) -> f64 {
        let pairs = self.times.iter().zip(&self.references);
        median(
            &pairs
                .map(|(own, none)| own[of] / none[of])
                .collect::<Vec<_>>(),
        )
    }
}

/// What all lists are measured with.
struct Bench<'a> {
    case: &'a Case,
    surface: EmbeddedSurface,
    forward: SolveOptions,
    backward: AdjointOptions,
}

/// Measures, prints and writes; whether everything converged.
///
/// # Errors
/// When the box is too large, or the file cannot be written.
pub fn run(args: &EffectsArgs) -> Result<bool> {
    let json = args.repeat.json.as_deref();
    check_writable(json)?;
    use_threads(args.repeat.threads)?;
    let load = system::load();
    let case = Case::solid_box(args.cells, 1.0)?;
    let bench = Bench {
        case: &case,
        surface: EmbeddedSurface::boundary(&case.mesh),
        forward: SolveOptions::new(Stop::Accuracy(args.accuracy * EDGE)).with_method(args.method.0),
        backward: AdjointOptions {
            tolerance: args.adjoint_tolerance,
            ..AdjointOptions::default()
        },
    };
    let (mut running, mut refused) = (Vec::new(), Vec::new());
    for list in lists(&case) {
        match bench.start(list) {
            Ok(started) => running.push(started),
            Err((name, SolverError::Excluded { why, .. })) => refused.push((name, why.into())),
            Err((_, error)) => return Err(error.into()),
        }
    }
    let dispatch = bench.dispatch(&mut running[0])?;
    let clock = std::time::Instant::now();
    // All lists in turn, so that a change of the machine's mood meets all of them.
    let mut rounds = 0;
    while rounds == 0
        || (rounds < args.repeat.runs && clock.elapsed().as_secs_f64() < args.repeat.budget)
    {
        let (none, others) = running.split_first_mut().expect("the list `none`");
        bench.round(none, None)?;
        for list in others {
            bench.round(none, Some(list))?;
        }
        rounds += 1;
        eprintln!(
            "round {rounds} after {:.0} s",
            clock.elapsed().as_secs_f64()
        );
    }
    let report = Report {
        cells: args.cells,
        elements: case.mesh.elements().len(),
        nodes: case.mesh.nodes().len(),
        accuracy_in_edges: args.accuracy,
        adjoint_tolerance: args.adjoint_tolerance,
        rounds,
        threads: rayon::current_num_threads(),
        load,
        dispatch,
        lists: measured(running),
        refused,
    };
    write_json(json, &report)?;
    print_report(&report);
    let converged = |m: &Measured| m.status == Status::Converged && m.adjoint_status.is_converged();
    Ok(report.lists.iter().all(converged))
}

impl Bench<'_> {
    fn build(&self, list: &List) -> std::result::Result<Solver, SolverError> {
        let effects = [&self.case.effects[..], &list.extra].concat();
        if list.extra.is_empty() {
            return Solver::new(&self.case.mesh, &effects);
        }
        Solver::on_surface(&self.case.mesh, &self.surface, &effects)
    }

    /// Builds a list's solver and counts what it does; that is also its warm-up.
    fn start(&self, list: List) -> std::result::Result<Running, (&'static str, SolverError)> {
        let with_name = |error| (list.name, error);
        let mut solver = self.build(&list).map_err(with_name)?;
        let mut parameters = solver.rest_parameters();
        parameters.actuation.copy_from_slice(&self.case.actuation);
        let before = solver.work();
        let solution = solver.solve(&parameters, None, &self.forward);
        let solution = solution.map_err(with_name)?;
        let work = solution.stats.work;
        let mut out = vec![Vector3::zeros(); solution.positions.len()];
        let projections = solver.work().local_projections;
        evaluate(&mut solver, &solution.positions, &mut out);
        let projections = solver.work().local_projections - projections;
        // The matrix is another solver's: this one has it only where its method does.
        let mut other = self.build(&list).map_err(with_name)?;
        let right = vec![Vector3::zeros(); out.len()];
        other.constant_solve(&right, &mut out).map_err(with_name)?;
        Ok(Running {
            counts: Counts {
                effect_bytes: before.effect_bytes,
                matrix_nonzeros: other.work().matrix_nonzeros,
                local_projections: projections,
                factorisations: work.factorisations,
                contact_queries: work.contact_queries,
                evaluations: work.evaluations - before.evaluations,
            },
            list,
            solver,
            parameters,
            solution,
            adjoint: Adjoint::default(),
            times: Vec::new(),
            references: Vec::new(),
        })
    }

    /// Measures a list right after the one without effects, which the ratios are taken with: the machine's speed drifts.
    fn round(&self, none: &mut Running, own: Option<&mut Running>) -> Result<()> {
        let reference = self.once(none)?;
        match own {
            Some(own) => {
                let mut times = self.once(own)?;
                // Single evaluations are short enough to take turns.
                let mut pairs = (Vec::new(), Vec::new());
                for _ in 0..EVALUATIONS {
                    pairs.0.push(none.evaluation());
                    pairs.1.push(own.evaluation());
                }
                times[2] = median(&pairs.1);
                let mut reference = reference;
                reference[2] = median(&pairs.0);
                own.times.push(times);
                own.references.push(reference);
            }
            None => {
                none.times.push(reference);
                none.references.push(reference);
            }
        }
        Ok(())
    }

    /// Seconds of setup, solve, evaluation and adjoint, once each.
    fn once(&self, r: &mut Running) -> Result<[f64; 4]> {
        let (setup, built) = timed(|| self.build(&r.list));
        drop(built?);
        let (solver, parameters) = (&mut r.solver, &r.parameters);
        let (solve, done) =
            timed(|| solver.solve_into(parameters, None, &self.forward, &mut r.solution));
        done?;
        let solution = &r.solution;
        let nodes = solution.positions.len();
        let cotangent = random_cotangent(nodes, solver.prescribed(), 1);
        let options = &self.backward;
        let (adjoint, done) = timed(|| {
            solver.adjoint_into(parameters, solution, &cotangent, options, &mut r.adjoint)
        });
        done?;
        Ok([setup, solve, r.evaluation(), adjoint])
    }

    /// The list without effects and elasticity without a list, one evaluation of each in turn.
    fn dispatch(&self, none: &mut Running) -> Result<Dispatch> {
        let (solver, u) = (&mut none.solver, &none.solution.positions);
        let held = solver.prescribed().to_vec();
        let mut alone = ElasticityAlone::new(&self.case.mesh, STIFFNESS, &held, &none.parameters);
        let mut gradients = [0, 1].map(|_| vec![Vector3::zeros(); u.len()]);
        let [by_list, by_loop] = &mut gradients;
        let (mut listed_s, mut alone_s) = (Vec::new(), Vec::new());
        rayon::scope(|_| {
            for pair in 0..PAIRS {
                // Who comes first changes, so that neither always finds what the other left in the caches.
                for first in [pair % 2 == 0, pair % 2 != 0] {
                    if first {
                        listed_s.push(timed(|| evaluate(solver, u, by_list)).0);
                    } else {
                        alone_s.push(timed(|| alone.evaluate(u, by_loop)).0);
                    }
                }
            }
        });
        assert_eq!(by_list, by_loop, "both do the same work");
        let pairs: Vec<f64> = listed_s.iter().zip(&alone_s).map(|(l, a)| l / a).collect();
        let paired_ratio = median(&pairs);
        let (listed_s, alone_s) = (median(&listed_s), median(&alone_s));
        Ok(Dispatch {
            paired_ratio,
            listed_s,
            alone_s,
            ratio: listed_s / alone_s,
            pairs: PAIRS,
        })
    }
}

fn measured(running: Vec<Running>) -> Vec<Measured> {
    let finish = |r: Running| {
        let [all_setup_s, all_solve_s, all_evaluation_s, all_adjoint_s] =
            [0, 1, 2, 3].map(|of| r.all(of));
        let [setup, solve, evaluation, adjoint] = [0, 1, 2, 3].map(|of| r.ratio(of));
        Measured {
            list: r.list.name,
            time_step: r.list.is_time_step(),
            setup_s: median(&all_setup_s),
            solve_s: median(&all_solve_s),
            evaluation_s: median(&all_evaluation_s),
            adjoint_s: median(&all_adjoint_s),
            ratios: Ratios {
                setup,
                solve,
                evaluation,
                adjoint,
            },
            method: r.solution.stats.method,
            iterations: r.solution.stats.iterations,
            adjoint_iterations: r.adjoint.stats.iterations,
            status: r.solution.status,
            adjoint_status: r.adjoint.status,
            counts: r.counts,
            all_setup_s,
            all_solve_s,
            all_evaluation_s,
            all_adjoint_s,
        }
    };
    running.into_iter().map(finish).collect()
}

fn print_report(report: &Report) {
    let mut times = vec![row([
        "effects",
        "setup s",
        "x",
        "solve s",
        "x",
        "(steps)",
        "evaluation s",
        "x",
        "adjoint s",
        "x",
        "(steps)",
        "status",
    ])];
    let mut counts = vec![row([
        "effects",
        "bytes",
        "non-zeros",
        "projections",
        "factorisations",
        "queries",
        "evaluations",
        "method",
    ])];
    let ratio = |x: f64| format!("{x:.2}");
    for m in &report.lists {
        let (r, c) = (&m.ratios, &m.counts);
        let status = match m.status == Status::Converged {
            true => name(&m.adjoint_status),
            false => name(&m.status),
        };
        times.push(row([
            m.list,
            &seconds(m.setup_s),
            &ratio(r.setup),
            &seconds(m.solve_s),
            &ratio(r.solve),
            &format!("({})", m.iterations),
            &seconds(m.evaluation_s),
            &ratio(r.evaluation),
            &seconds(m.adjoint_s),
            &ratio(r.adjoint),
            &format!("({})", m.adjoint_iterations),
            &status,
        ]));
        let count = |n: u64| n.to_string();
        counts.push(row([
            m.list,
            &count(c.effect_bytes as u64),
            &count(c.matrix_nonzeros as u64),
            &count(c.local_projections),
            &count(c.factorisations),
            &count(c.contact_queries),
            &count(c.evaluations),
            &name(&m.method),
        ]));
    }
    print(&times);
    say("\n");
    print(&counts);
    let d = &report.dispatch;
    say(&format!(
        "\nlists with inertia solve one step in time from rest; all else an equilibrium, to {} of an edge; medians of {} rounds\n\
         one evaluation with no optional effect: {} s, {:.4} of a loop for elasticity alone ({} s), medians of {} pairs; \
         median of their ratios {:.4}\n",
        report.accuracy_in_edges,
        report.rounds,
        seconds(d.listed_s),
        d.ratio,
        seconds(d.alone_s),
        d.pairs,
        d.paired_ratio,
    ));
    for (list, why) in &report.refused {
        say(&format!("{list}: not measured: {why}\n"));
    }
}
