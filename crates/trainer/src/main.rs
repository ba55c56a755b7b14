//! The program `myofield`: train, evaluate and simulate neural muscle fields.

use clap::{Args, Parser, Subcommand};
use pd_solver::{Method, Status, Stop};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use surface_mesh::printable;
use trainer::compare::{CompareRequest, compare, markdown};
use trainer::dial::with_accuracy;
use trainer::evaluate::{EvaluationRequest, evaluate, parse_weights};
use trainer::fit::{DEFAULT_STEPS, FitRequest, FitSource, fit, fit_table};
use trainer::grid;
use trainer::performance::{CodePath, DEFAULT_FPS, PerformanceRequest, Source, perform, summary};
use trainer::rig::Rig;
use trainer::run::{Run, newest_folder, next_folder};
use trainer::scene::Scene;
use trainer::shapes::load_shapes;
use trainer::simulate::{SimulateRequest, simulate, variant_line};
use trainer::solve::{BodySource, SolveRequest, solve};
use trainer::table::{accuracy_reached, table};
use trainer::train::{check, train};
use trainer::trained::Changes;
use trainer::units::Length;
use trainer::{TrainerError, stop_on_signal};

/// Trains a neural muscle field that drives a soft body through physics, and simulates it.
#[derive(Parser)]
#[command(name = "myofield", version, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Train a scene (the starfish unless another is given) into a run folder.
    Train(TrainArgs),
    /// Simulate and measure the shapes of a trained run, and others.
    Eval(EvalArgs),
    /// Set the trained field beside linear blendshapes and an explicit decoder, on the same frames, in a table.
    Compare(CompareArgs),
    /// Simulate a scene that moves by itself: muscles, shapes, held parts and loads by keys in time; beside it without some of its effects.
    Simulate(SimulateArgs),
    /// Find one equilibrium, and the gradient of a loss, on arrays in .npy files.
    Solve(SolveArgs),
}

#[derive(Args)]
struct TrainArgs {
    /// Scene file.
    #[arg(default_value = "data/scenes/starfish.toml")]
    scene: PathBuf,
    /// Go on with the newest run of this scene, or with the one in --out, by the scene and shapes that the run keeps.
    #[arg(long)]
    resume: bool,
    /// Run folder (runs/NAME, or the next number behind it, unless given).
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Folder that the scene's files are relative to (that of the scene file unless given).
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// How far any node may be from its place, such as "0.05 mm", instead of what the scene says; a bare number is in the scene's unit.
    #[arg(
        long,
        value_name = "LENGTH",
        allow_hyphen_values = true,
        conflicts_with = "resume"
    )]
    accuracy: Option<Length>,
    /// Choose the size of the elements too, so that the grid alone is no farther off than the accuracy, in the mean over the surface.
    #[arg(long, conflicts_with = "resume")]
    fit_grid: bool,
}

#[derive(Args)]
struct EvalArgs {
    /// Run folder.
    run: PathBuf,
    /// Shapes that were not trained: a glTF or GLB file over the same vertices, or a JSON or CSV file of frames with weights over
    /// the scene's shapes.
    #[arg(long, value_name = "FILE", group = "fit_targets")]
    shapes: Option<PathBuf>,
    /// A blend of shapes, such as "curl=0.5,lift=0.5"; may be given several times.
    #[arg(long, value_name = "LIST")]
    weights: Vec<String>,
    /// Only a performance: simulate a CSV or JSON file of weights, frame by frame, into an animation and pictures.
    #[arg(long, value_name = "FILE", group = "performance", conflicts_with_all = ["shapes", "weights"])]
    curves: Option<PathBuf>,
    /// Only a performance, from shape A to shape B (or `neutral`) in N frames through the codes between; A:B:C:N goes on.
    #[arg(long, value_name = "A:B:N", group = "performance", conflicts_with_all = ["shapes", "weights"])]
    blend: Option<String>,
    /// A glTF or GLB file over the same vertices whose morph targets are what frames weigh, instead of the scene's shapes.
    #[arg(long, value_name = "FILE")]
    units: Option<PathBuf>,
    /// Only a fit: adjust latent code and joint by gradients through the simulator, until they reach the shapes of --shapes or the
    /// surfaces of --scan as nearly as the network allows.
    #[arg(long, requires = "fit_targets", conflicts_with_all = ["curves", "blend", "weights"])]
    fit: bool,
    /// A surface to fit, of any topology (OBJ, glTF, GLB), in the frame and unit of the neutral surface; may be given several times.
    #[arg(
        long,
        value_name = "FILE",
        group = "fit_targets",
        requires = "fit",
        conflicts_with_all = ["shapes", "units"]
    )]
    scan: Vec<PathBuf>,
    /// Vertices farther from a scan than this are left out (5 % of the bounding-box diagonal unless given).
    #[arg(
        long,
        value_name = "LENGTH",
        requires = "scan",
        conflicts_with = "shapes",
        allow_hyphen_values = true
    )]
    scan_reach: Option<f64>,
    /// Steps of the fit at most (30 unless given).
    #[arg(
        long,
        value_name = "N",
        requires = "fit",
        allow_negative_numbers = true
    )]
    fit_steps: Option<usize>,
    /// Frames per second of a performance (24 unless given).
    #[arg(
        long,
        value_name = "RATE",
        requires = "performance",
        allow_hyphen_values = true
    )]
    fps: Option<f64>,
    #[command(flatten)]
    changes: ChangeArgs,
    /// Where to write (RUN/evaluation unless given).
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// What may differ from training.
#[derive(Args)]
struct ChangeArgs {
    /// Another element size than that of training.
    #[arg(long, value_name = "H", allow_hyphen_values = true)]
    element_size: Option<f64>,
    /// How far any node may be from its place, such as "0.05 mm"; a bare number is in the scene's unit.
    #[arg(long, value_name = "LENGTH", allow_hyphen_values = true)]
    accuracy: Option<Length>,
    /// A TOML file of more effects, such as contact, pressure or weight, and of a motion whose keys move what is held and scale loads.
    #[arg(long, value_name = "FILE.toml")]
    effects: Option<PathBuf>,
    /// Frames of a performance follow one another in time: needs an `inertia` among the effects, whose time step divides a frame.
    #[arg(long, requires = "performance")]
    dynamics: bool,
}

impl From<ChangeArgs> for Changes {
    fn from(args: ChangeArgs) -> Self {
        Self {
            element_size: args.element_size,
            accuracy: args.accuracy,
            effects: args.effects,
            dynamics: args.dynamics,
        }
    }
}

#[derive(Args)]
struct CompareArgs {
    /// Run folder.
    run: PathBuf,
    /// Frames beside those of the run: a glTF or GLB file over the same vertices, or a JSON or CSV file of frames with weights over
    /// the scene's shapes.
    #[arg(long, value_name = "FILE")]
    shapes: Option<PathBuf>,
    /// A glTF or GLB file over the same vertices whose morph targets are what frames weigh, instead of the scene's shapes.
    #[arg(long, value_name = "FILE")]
    units: Option<PathBuf>,
    /// Width of the decoder's hidden layers (that of the decoder that is kept, or 64, unless given).
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    width: Option<usize>,
    /// Train the decoder for about so long (as many steps as the field unless given).
    #[arg(long, value_name = "S", allow_hyphen_values = true)]
    seconds: Option<f64>,
    /// Train the decoder anew, even if one is kept that fits.
    #[arg(long)]
    retrain: bool,
    /// Where to write, and where the decoder is kept (RUN/comparison unless given).
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

#[derive(Args)]
struct SimulateArgs {
    /// Scene file with a motion.
    scene: PathBuf,
    /// Folder that the scene's files are relative to (that of the scene file unless given).
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// A kind of effect to be left out in the row beside, instead of those that the scene names; may be given several times.
    #[arg(long, value_name = "KIND")]
    without: Vec<String>,
    /// Another element size than that of the scene.
    #[arg(long, value_name = "H", allow_hyphen_values = true)]
    element_size: Option<f64>,
    /// Where to write (simulations/NAME unless given).
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

#[derive(Args)]
struct SolveArgs {
    /// A solid box of NX x NY x NZ cubes with a corner at the origin.
    #[arg(
        long,
        value_name = "NX,NY,NZ",
        value_parser = parse_cells,
        required_unless_present = "surface",
        requires = "size"
    )]
    cells: Option<[usize; 3]>,
    /// Edge length of the cubes of --cells.
    #[arg(long, value_name = "H", allow_hyphen_values = true)]
    size: Option<f64>,
    /// The inside of a closed surface (OBJ, glTF, GLB).
    #[arg(
        long,
        value_name = "FILE",
        conflicts_with = "cells",
        requires = "element_size"
    )]
    surface: Option<PathBuf>,
    /// Edge length of the elements of --surface.
    #[arg(long, value_name = "H", allow_hyphen_values = true)]
    element_size: Option<f64>,
    /// Samples per element: 1, 8 or 27.
    #[arg(long, default_value_t = 8, allow_negative_numbers = true)]
    samples: usize,
    /// Nodes held at rest: x=0, y=max, z>0.9 and the like; may be given several times.
    #[arg(long, value_name = "SELECTION", allow_hyphen_values = true)]
    fix: Vec<String>,
    /// Actuation b: float64 [elements, samples, 6], entries 11, 12, 13, 22, 23, 33 of A = I + sym(b); zero unless given.
    #[arg(long, value_name = "FILE.npy")]
    actuation: Option<PathBuf>,
    /// Stop when no node is estimated to be farther than this from its final place.
    #[arg(
        long,
        value_name = "LENGTH",
        allow_hyphen_values = true,
        conflicts_with = "rel_grad"
    )]
    accuracy: Option<f64>,
    /// Stop when |g| <= T |g at rest| over the free nodes.
    #[arg(long, value_name = "T", allow_hyphen_values = true)]
    rel_grad: Option<f64>,
    /// automatic, multigrid, lbfgs, newton, anderson or local-global.
    #[arg(long, default_value = "automatic", value_parser = parse_method)]
    method: Method,
    /// Limit of iterations.
    #[arg(long, default_value_t = 2000, allow_negative_numbers = true)]
    max_iterations: usize,
    /// Energy per volume for a unit misfit.
    #[arg(long, default_value_t = 1.0, allow_hyphen_values = true)]
    stiffness: f64,
    /// Gradient of a loss by the positions: float64 [nodes, 3]; writes actuation_grad.npy.
    #[arg(long, value_name = "FILE.npy")]
    cotangent: Option<PathBuf>,
    /// Folder of the output.
    #[arg(long, value_name = "DIR", default_value = "solve")]
    out: PathBuf,
}

/// Where runs go that were not told where.
const RUNS: &str = "runs";

fn parse_cells(text: &str) -> Result<[usize; 3], String> {
    let counts: Result<Vec<usize>, _> = text.split(',').map(|n| n.trim().parse()).collect();
    let counts = counts.ok().and_then(|c| <[usize; 3]>::try_from(c).ok());
    counts.ok_or_else(|| "write three whole numbers, such as 32,16,16".into())
}

fn parse_method(text: &str) -> Result<Method, String> {
    serde_json::from_value(text.into())
        .map_err(|_| "use automatic, multigrid, lbfgs, newton, anderson or local-global".into())
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    // A solve has no step to stop after: a signal ends it at once, and its files are whole or absent anyway.
    if !matches!(cli.command, Command::Solve(_)) {
        stop_on_signal();
    }
    let done = match cli.command {
        Command::Train(args) => run_train(&args).map(|()| true),
        Command::Eval(args) => run_eval(args).map(|()| true),
        Command::Compare(args) => run_compare(args).map(|()| true),
        Command::Simulate(args) => run_simulate(args),
        Command::Solve(args) => run_solve(args),
    };
    match done {
        Ok(true) => ExitCode::SUCCESS,
        // The files are there, and say that the tolerance was not met.
        Ok(false) => ExitCode::from(3),
        Err(error) => {
            let mend = error.mend().map(|mend| format!("; {mend}"));
            let text = format!("{error}{}", mend.unwrap_or_default());
            eprintln!("error: {}", printable(&text));
            let interrupted = matches!(
                error,
                TrainerError::Interrupted { .. }
                    | TrainerError::EvaluationStopped
                    | TrainerError::GridStopped
                    | TrainerError::ComparisonStopped
            );
            ExitCode::from(if interrupted { 130 } else { 1 })
        }
    }
}

fn run_train(args: &TrainArgs) -> trainer::Result<()> {
    let run = if args.resume {
        let folder = match &args.out {
            Some(folder) => folder.clone(),
            None => newest_folder(Path::new(RUNS), &Scene::read(&args.scene)?.0.name),
        };
        Run::open(&folder)?
    } else {
        let (mut scene, mut text) = Scene::read(&args.scene)?;
        if let Some(accuracy) = &args.accuracy {
            scene.set_accuracy(accuracy)?;
            text = with_accuracy(&text, accuracy);
        }
        let beside = args.scene.parent().map(PathBuf::from).unwrap_or_default();
        let data = args.data.as_ref().unwrap_or(&beside);
        let inputs = load_shapes(&scene, data)?;
        let rig = Rig::load(&scene, data)?;
        check(&scene, &args.scene, &inputs.shapes, &rig)?;
        if args.fit_grid {
            (scene, text) = grid::fitted(&args.scene, (scene, text), &inputs.shapes, &rig)?;
        }
        let basis = inputs.choose_basis(&scene)?;
        if let Some(basis) = &basis {
            let summary = basis.summary(&scene.unit);
            eprintln!("{:>12} {}", "descriptor", printable(&summary));
        }
        let folder = args.out.clone();
        let folder = folder.unwrap_or_else(|| next_folder(Path::new(RUNS), &scene.name));
        Run::create(&folder, &text, &inputs.shapes, &rig, basis.as_ref())?
    };
    let scene = run.scene()?;
    eprintln!(
        "{:>12} {} into {}",
        "training",
        scene.name,
        run.folder().display()
    );
    let trained = train(&run)?;
    println!(
        "\n{}",
        table(
            &trained.results,
            &trained.stage1,
            trained.diagonal,
            &scene.unit
        )
    );
    println!("{}", accuracy_reached(&trained.results, &scene.unit));
    let folder = run.folder().display();
    println!(
        "trained in {:.0} s ({} steps dropped)",
        trained.seconds, trained.dropped
    );
    println!(
        "pictures  {folder}/evaluation/sheet-1.png and on, {folder}/loss-1.png, {folder}/loss-2.png"
    );
    println!("meshes    {folder}/evaluation/shapes.glb (every simulated shape as a morph target)");
    println!(
        "try       cargo xtask eval {folder} --weights \"{}\"",
        example_weights(&trained.results)
    );
    Ok(())
}

fn example_weights(results: &[trainer::evaluate::ShapeResult]) -> String {
    let names = results
        .iter()
        .take(2)
        .map(|r| format!("{}=0.5", printable(&r.name)));
    names.collect::<Vec<_>>().join(",")
}

fn run_eval(args: EvalArgs) -> trainer::Result<()> {
    let source = match (&args.curves, &args.blend) {
        (Some(file), _) => Some(Source::Curves(file.clone())),
        (_, Some(path)) => Some(Source::Path(CodePath::parse(path)?)),
        _ => None,
    };
    let run = Run::open(&args.run)?;
    if let Some(source) = source {
        return run_performance(&run, source, args);
    }
    if args.fit {
        return run_fit(&run, args);
    }
    let scene = run.scene()?;
    let blends = args.weights.iter().map(|w| parse_weights(w));
    let request = EvaluationRequest {
        shapes: args.shapes,
        units: args.units,
        blends: blends.collect::<trainer::Result<_>>()?,
        changes: args.changes.into(),
        out: args.out,
    };
    let (results, folder) = evaluate(&run, &request)?;
    let diagonal = run.inputs()?.surface.diagonal();
    println!("\n{}", table(&results, &[], diagonal, &scene.unit));
    println!("{}", accuracy_reached(&results, &scene.unit));
    println!("written to {}", folder.display());
    Ok(())
}

fn run_fit(run: &Run, args: EvalArgs) -> trainer::Result<()> {
    let source = match args.shapes {
        Some(file) => FitSource::Shapes {
            file,
            units: args.units,
        },
        None => FitSource::Scans {
            files: args.scan,
            reach: args.scan_reach,
        },
    };
    let request = FitRequest {
        source,
        steps: args.fit_steps.unwrap_or(DEFAULT_STEPS),
        changes: args.changes.into(),
        out: args.out,
    };
    let fitted = fit(run, &request)?;
    println!("\n{}", fit_table(&fitted));
    let folder = fitted.folder.display();
    println!("numbers   {folder}/fit.json (with the fitted codes and joints)");
    println!("pictures  {folder}/fit-sheet-1.png and on");
    println!("meshes    {folder}/fit.glb (every fitted shape as a morph target)");
    Ok(())
}

fn run_performance(run: &Run, source: Source, args: EvalArgs) -> trainer::Result<()> {
    let request = PerformanceRequest {
        source,
        units: args.units,
        fps: args.fps.unwrap_or(DEFAULT_FPS),
        changes: args.changes.into(),
        out: args.out,
    };
    let performance = perform(run, &request)?;
    let (diagonal, unit) = (performance.diagonal, &performance.unit);
    let results: Vec<_> = performance.frames.iter().map(|f| &f.result).collect();
    println!("\n{}", table(&results, &[], diagonal, unit));
    println!("{}", accuracy_reached(&results, unit));
    println!("{}", summary(&performance));
    let folder = performance.folder.display();
    println!("written to {folder}");
    println!("animation  {folder}/animation.glb (a morph target for every frame)");
    println!("pictures   {folder}/contact-sheet.png, {folder}/frame-0001.png and on");
    Ok(())
}

fn run_compare(args: CompareArgs) -> trainer::Result<()> {
    let run = Run::open(&args.run)?;
    let request = CompareRequest {
        shapes: args.shapes,
        units: args.units,
        width: args.width,
        seconds: args.seconds,
        retrain: args.retrain,
        out: args.out,
    };
    let (comparison, folder) = compare(&run, &request)?;
    let folder = folder.display();
    println!("\n{}", markdown(&comparison));
    println!("written to {folder}/comparison.md and comparison.json");
    println!("pictures   {folder}/comparison.png (target, field, linear blendshapes, decoder)");
    println!("decoder    {folder}/decoder.safetensors (used again unless --retrain is given)");
    Ok(())
}

fn run_simulate(args: SimulateArgs) -> trainer::Result<bool> {
    let request = SimulateRequest {
        scene: args.scene,
        data: args.data,
        without: (!args.without.is_empty()).then_some(args.without),
        element_size: args.element_size,
        out: args.out,
    };
    let simulated = simulate(&request)?;
    for variant in &simulated.variants {
        println!("{}", variant_line(variant));
    }
    let folder = simulated.folder.display();
    println!("picture    {folder}/sheet.png");
    println!("animation  {folder}/animation.glb (a morph target for every frame)");
    println!("numbers    {folder}/simulation.json");
    let mut frames = simulated.variants.iter().flat_map(|v| &v.frames);
    Ok(frames.all(|f| f.status == Status::Converged))
}

fn run_solve(args: SolveArgs) -> trainer::Result<bool> {
    let body = match (args.cells, args.size, args.surface, args.element_size) {
        (Some(cells), Some(size), _, _) => BodySource::Cells { cells, size },
        (_, _, Some(path), Some(element_size)) => BodySource::Surface { path, element_size },
        _ => unreachable!("clap requires one of the two pairs"),
    };
    let stop = match (args.accuracy, args.rel_grad) {
        (Some(length), _) => Some(Stop::Accuracy(length)),
        (_, Some(t)) => Some(Stop::RelativeGradient(t)),
        _ => None,
    };
    let request = SolveRequest {
        body,
        samples: args.samples,
        fix: args.fix,
        actuation: args.actuation,
        stop,
        method: args.method,
        max_iterations: args.max_iterations,
        stiffness: args.stiffness,
        cotangent: args.cotangent,
        out: args.out,
    };
    Ok(solve(&request)?.converged)
}
