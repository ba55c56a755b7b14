//! The program `myofield-accuracy`: what accuracy costs in time, and whether what a solve tells of its error is true.

use accuracy::choice::Simulated;
use accuracy::draw;
use accuracy::estimates::{Estimates, estimates};
use accuracy::manufactured::convergence;
use accuracy::recommend::{Recommendation, Wish, front, recommend, snippet};
use accuracy::study::{Plan, Question, Row, Study, answers, words};
use accuracy::subject::Subject;
use accuracy::table::{
    Units, convergence_table, courses_table, estimates_table, study_table, transfer_table, value,
};
use accuracy::training::{Course, courses};
use accuracy::transfer::{TransferPlan, transfer};
use accuracy::{AccuracyError, Result};
use actuation_net::Width;
use clap::{Args, Parser, Subcommand};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use trainer::files::{create_folder, read_json, write_json, write_whole};
use trainer::units::Length;

/// Shows what accuracy costs in time for a scene or a trained run, and recommends settings for a budget or a target.
#[derive(Parser)]
#[command(
    name = "myofield-accuracy",
    bin_name = "cargo xtask accuracy",
    version,
    max_term_width = 100,
    args_conflicts_with_subcommands = true
)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    study: StudyArgs,
}

#[derive(Subcommand)]
enum Command {
    /// Compare the error that solves tell with the error that they have.
    Estimates {
        /// Where to write.
        #[arg(long, value_name = "DIR", default_value = "accuracy/estimates")]
        out: PathBuf,
    },
    /// Train with equilibria, adjoints and points loosened by factors of ten: loss against seconds, and how wrong gradients become.
    Training(TrainingArgs),
    /// One network on every grid: a field on grids that it was not trained on, with and without a branch that knows the spacing.
    Transfer(TransferArgs),
}

#[derive(Args)]
struct TrainingArgs {
    /// Scene file (a network is trained for it by stage 1), or the folder of a trained run.
    #[arg(value_name = "SCENE|RUN", default_value = "data/scenes/starfish.toml")]
    subject: PathBuf,
    /// Folder that the scene's files are relative to (that of the scene file unless given).
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Shapes that are trained (6 unless given, all in a full transfer).
    #[arg(long, value_name = "N", value_parser = at_least_one)]
    shapes: Option<usize>,
    /// Passes over them (10, of a transfer 30 on one grid and 80 over twenty, unless given).
    #[arg(long, value_name = "N", value_parser = at_least_one)]
    passes: Option<usize>,
    /// Where to write (accuracy/NAME-training or -transfer unless given).
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Shapes of a quick training.
const SHAPES: usize = 6;

#[derive(Args)]
struct TransferArgs {
    #[command(flatten)]
    training: TrainingArgs,
    /// The supplement's numbers of samples and all shapes: days on two cores. It may be stopped, and goes on by the same command.
    #[arg(long)]
    full: bool,
}

#[derive(Args)]
struct StudyArgs {
    /// Scene file (networks are trained for it), or the folder of a trained run.
    #[arg(value_name = "SCENE|RUN", default_value = "data/scenes/starfish.toml")]
    subject: PathBuf,
    /// Folder that the scene's files are relative to (that of the scene file unless given).
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Recommend the most accurate settings that take at most so long for a shape.
    #[arg(
        long,
        value_name = "SECONDS",
        conflicts_with = "target",
        allow_hyphen_values = true,
        value_parser = positive
    )]
    budget: Option<f64>,
    /// Recommend the fastest settings whose surface is at most so far from the reference, such as "0.5 mm"; a bare number is in the
    /// scene's unit.
    #[arg(long, value_name = "LENGTH", allow_hyphen_values = true)]
    target: Option<Length>,
    /// Finer grids and more shapes: hours for a large body. It may be stopped, and goes on by the same command.
    #[arg(long)]
    full: bool,
    /// Element sizes, in those of the scene, the largest first.
    #[arg(
        long,
        value_name = "A,B,...",
        value_delimiter = ',',
        allow_hyphen_values = true,
        value_parser = positive
    )]
    sizes: Vec<f64>,
    /// Shapes that are simulated.
    #[arg(long, value_name = "N", value_parser = at_least_one)]
    shapes: Option<usize>,
    /// Only measure the settings of this file, recommended by another study, on this scene.
    #[arg(long, value_name = "recommended.json", conflicts_with_all = ["budget", "target", "sizes"])]
    check: Option<PathBuf>,
    /// Where to write (accuracy/NAME unless given).
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

fn positive(text: &str) -> std::result::Result<f64, String> {
    let value = text
        .trim()
        .parse()
        .ok()
        .filter(|x: &f64| x.is_finite() && *x > 0.0);
    value.ok_or_else(|| "write a number above zero".into())
}

fn at_least_one(text: &str) -> std::result::Result<usize, String> {
    let value = text.trim().parse().ok().filter(|n| *n > 0);
    value.ok_or_else(|| "write a whole number, 1 or more".into())
}

fn main() -> ExitCode {
    trainer::stop_on_signal();
    let cli = Cli::parse();
    let done = match cli.command {
        Some(Command::Estimates { out }) => run_estimates(&out),
        Some(Command::Training(args)) => run_training(&args),
        Some(Command::Transfer(args)) => run_transfer(&args),
        None => run_study(&cli.study),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {}", surface_mesh::printable(&error.to_string()));
            let interrupted = matches!(error, AccuracyError::Stopped);
            ExitCode::from(if interrupted { 130 } else { 1 })
        }
    }
}

fn run_estimates(out: &Path) -> Result<()> {
    let folder = create_folder(out)?;
    let found =
        estimates(|case| eprintln!("{:>12} {} to {:.0e}", "solved", case.name, case.asked))?;
    write_estimates(&found, &folder)?;
    println!("{}", estimates_table(&found));
    println!("written to {}", folder.display());
    Ok(())
}

fn write_estimates(found: &Estimates, folder: &Path) -> Result<()> {
    write_json(&folder.join("estimates.json"), found)?;
    write_whole(
        &folder.join("estimates.md"),
        estimates_table(found).as_bytes(),
    )?;
    draw::write(&draw::scatter(found), folder, "estimates")
}

/// Folder, body and units of a study that trains.
fn subject_of(args: &TrainingArgs, kind: &str, shapes: usize) -> Result<(PathBuf, Subject, Units)> {
    let name = stem(&args.subject);
    let out = args.out.clone();
    let folder = out.unwrap_or_else(|| Path::new("accuracy").join(format!("{name}-{kind}")));
    let folder = create_folder(&folder)?;
    let data = args.data.as_deref();
    let shapes = args.shapes.unwrap_or(shapes);
    let subject = open(&args.subject, data, &[Width::W64], shapes, &folder)?;
    let units = subject.units();
    Ok((folder, subject, units))
}

fn run_transfer(args: &TransferArgs) -> Result<()> {
    let (mut plan, shapes) = match args.full {
        true => (TransferPlan::full(), usize::MAX),
        false => (TransferPlan::quick(), SHAPES),
    };
    let (folder, subject, units) = subject_of(&args.training, "transfer", shapes)?;
    if let Some(passes) = args.training.passes {
        plan.passes = passes;
        plan.conditioned_passes = passes;
    }
    let found = transfer(&subject, plan, &folder, |what| {
        eprintln!("{:>12} {what}", "transfer")
    })?;
    let text = transfer_table(&found, &units);
    write_json(&folder.join("transfer.json"), &found)?;
    write_whole(&folder.join("transfer.md"), text.as_bytes())?;
    draw::write(&draw::resolutions(&found, &units), &folder, "resolutions")?;
    let sheet = draw::transfer_sheet(&found, &subject, &units)?;
    write_whole(&folder.join("transfer.png"), &sheet)?;
    println!("{text}\nwritten to {}", folder.display());
    Ok(())
}

fn run_training(args: &TrainingArgs) -> Result<()> {
    let (folder, subject, units) = subject_of(args, "training", SHAPES)?;
    let told = |course: &Course| {
        eprintln!("{:>12} {}", "trained", course.tightness.name);
    };
    let found = courses(&subject, args.passes.unwrap_or(10), told)?;
    let text = courses_table(&found, &units);
    write_json(&folder.join("training.json"), &found)?;
    write_whole(&folder.join("training.md"), text.as_bytes())?;
    let kinds = [
        ("equilibria", "Accuracy of the equilibria (diagonals)"),
        ("adjoint", "Relative residual of the adjoint"),
        ("%", "Points that the gradient goes through"),
    ];
    for (kind, title) in kinds {
        let file = format!("training-{}", kind.replace('%', "points"));
        draw::write(&draw::courses(&found, kind, title), &folder, &file)?;
    }
    println!("{text}\nwritten to {}", folder.display());
    Ok(())
}

fn stem(path: &Path) -> String {
    path.file_stem()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

/// What a study writes as JSON.
#[derive(Serialize)]
struct Written<'a> {
    scene: &'a str,
    unit: &'a str,
    diagonal: f64,
    order: f64,
    known_answer: &'a accuracy::manufactured::Convergence,
    rows: &'a [Row],
    recommended: &'a [Kept],
}

/// A recommendation in a file that `--check` reads.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Kept {
    /// For what.
    wish: String,
    /// The error that is not to be exceeded, in diagonals.
    target: Option<f64>,
    #[serde(flatten)]
    recommendation: Recommendation,
}

fn run_study(args: &StudyArgs) -> Result<()> {
    let mut plan = match args.full {
        true => Plan::full(),
        false => Plan::quick(),
    };
    if let Some(shapes) = args.shapes {
        plan.shapes = shapes;
    }
    if !args.sizes.is_empty() {
        plan.sizes.clone_from(&args.sizes);
        let least = plan.sizes.iter().copied().fold(f64::INFINITY, f64::min);
        plan.reference_size = plan.reference_size.min(0.6 * least);
    }
    let out = args.out.clone();
    let folder =
        create_folder(&out.unwrap_or_else(|| Path::new("accuracy").join(stem(&args.subject))))?;
    let widths: &[Width] = match args.full {
        true => &[Width::W64, Width::W128, Width::W256],
        false => &[Width::W64],
    };
    let subject = open(
        &args.subject,
        args.data.as_deref(),
        widths,
        plan.shapes,
        &folder,
    )?;
    let units = subject.units();
    if let Some(file) = &args.check {
        return run_check(&subject, &plan, &read_json::<Vec<Kept>>(file)?, &units);
    }
    let target = match &args.target {
        Some(target) => Some(in_unit(target, &units)? / units.diagonal),
        None => None,
    };
    let told = |row: &Row| {
        eprintln!(
            "{:>12} {}: {}, error {:.2e} {}, {:.2} s per shape",
            "measured",
            words(row.question),
            value(row, &units),
            row.error * units.diagonal,
            units.name,
            row.split.simulation()
        );
    };
    let reference_size = plan.reference_size;
    let rows = Study::open(&subject, plan, &folder)?.run(told)?;
    let known = convergence()?;
    let order = order(
        &rows,
        reference_size * subject.scene.mesh.element_size / units.diagonal,
    );
    let kept = wishes(&rows, args.budget, target, &units)?;
    write_json(
        &folder.join("study.json"),
        &Written {
            scene: &subject.scene.name,
            unit: &units.name,
            diagonal: units.diagonal,
            order,
            known_answer: &known,
            rows: &rows,
            recommended: &kept,
        },
    )?;
    write_json(&folder.join("recommended.json"), &kept)?;
    let mut text = study_table(&rows, &units);
    text += &format!(
        "\nOrder by element size: {order:.2} on this body; a case with a known answer:\n\n"
    );
    text += &convergence_table(&known);
    for kept in &kept {
        text += &format!(
            "\n{}: {:.2e} {} from the reference, {:.3} s per shape\n\n```toml\n{}```\n",
            kept.wish,
            kept.recommendation.error * units.diagonal,
            units.name,
            kept.recommendation.seconds,
            snippet(&kept.recommendation.choice, units.diagonal)
        );
    }
    write_whole(&folder.join("study.md"), text.as_bytes())?;
    draw::write(&draw::pareto(&rows, &units), &folder, "cost")?;
    draw::write(&draw::split(&rows), &folder, "split")?;
    draw::write(
        &draw::discretisation(&rows, &known, order),
        &folder,
        "element-size",
    )?;
    println!("{text}");
    println!("written to {}", folder.display());
    Ok(())
}

fn in_unit(length: &Length, units: &Units) -> Result<f64> {
    length.in_unit(&units.name).map_err(|problem| {
        AccuracyError::Trainer(trainer::TrainerError::Option {
            option: "--target",
            text: problem,
            mend: "lengths on the command line are in the scene's unit unless they name their own",
        })
    })
}

fn open(
    subject: &Path,
    data: Option<&Path>,
    widths: &[Width],
    shapes: usize,
    folder: &Path,
) -> Result<Subject> {
    if subject.is_dir() {
        return Subject::of_run(subject, shapes);
    }
    let beside = subject.parent().map(PathBuf::from).unwrap_or_default();
    let data = data.unwrap_or(&beside);
    Subject::of_scene(subject, data, widths, folder, shapes)
}

/// Order p of the error C (h^p - h_ref^p), the reference being off in the same way: the p whose C varies least over the sizes.
fn order(rows: &[Row], reference: f64) -> f64 {
    let sized = answers(rows, Question::Discretisation);
    let points: Vec<(f64, f64)> = sized.map(|r| (r.choice.element_size, r.error)).collect();
    let spread = |p: f64| {
        let logarithms = points
            .iter()
            .map(|(h, e)| (e / (h.powf(p) - reference.powf(p))).ln());
        let logarithms: Vec<f64> = logarithms.collect();
        let mean = logarithms.iter().sum::<f64>() / logarithms.len() as f64;
        logarithms.iter().map(|x| (x - mean).powi(2)).sum::<f64>()
    };
    let tried = (10..400).map(|p| f64::from(p) / 100.0);
    tried
        .min_by(|a, b| spread(*a).total_cmp(&spread(*b)))
        .unwrap_or(f64::NAN)
}

/// What was asked for; without a wish, settings that come within four times, twice and 1.2 times the smallest error.
fn wishes(
    rows: &[Row],
    budget: Option<f64>,
    target: Option<f64>,
    units: &Units,
) -> Result<Vec<Kept>> {
    if let Some(budget) = budget {
        return Ok(vec![Kept {
            wish: format!("At most {budget} s"),
            target: None,
            recommendation: recommend(rows, Wish::Budget(budget), units.diagonal)?,
        }]);
    }
    let best = || front(rows).last().map_or(0.0, |r| r.error);
    let targets = match target {
        Some(target) => vec![target],
        None => [4.0, 2.0, 1.2].map(|times| times * best()).to_vec(),
    };
    let within = targets.into_iter().map(|target| {
        Ok(Kept {
            wish: format!("Within {:.2e} {}", target * units.diagonal, units.name),
            target: Some(target),
            recommendation: recommend(rows, Wish::Target(target), units.diagonal)?,
        })
    });
    within.collect()
}

fn run_check(subject: &Subject, plan: &Plan, kept: &[Kept], units: &Units) -> Result<()> {
    println!(
        "| settings | target ({0}) | error here ({0}) | s per shape | met |\n|---|---|---|---|---|",
        units.name
    );
    for kept in kept {
        let choice = &kept.recommendation.choice;
        let finest = plan.reference_size * subject.scene.mesh.element_size / units.diagonal;
        let by = accuracy::choice::Choice {
            element_size: finest.min(0.6 * choice.element_size),
            samples: 27,
            actuation: trainer::scene::ActuationPer::Sample,
            accuracy: plan.tight,
            ..choice.clone()
        };
        let reference = Simulated::reference(subject, &by, "the reference")?;
        let own = Simulated::new(subject, choice)?;
        let error = own.distance(&reference.surfaces);
        let target = kept.target.unwrap_or(kept.recommendation.error);
        println!(
            "| {}, {:e} | {:.2e} | {:.2e} | {:.3} | {} |",
            choice.words(units.diagonal),
            choice.accuracy,
            target * units.diagonal,
            error * units.diagonal,
            own.split.simulation(),
            if error <= target { "yes" } else { "no" }
        );
    }
    Ok(())
}
