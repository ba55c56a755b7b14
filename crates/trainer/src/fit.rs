//! Fits latent code and joint to targets that no descriptor reaches: unseen units, scans.
//!
//! The network's weights stay as they are. The search starts from what the encoder and the bone network answer, and goes down the loss on
//! the surface by exact gradients through equilibrium and network.

mod files;
mod muscles;
mod scan;
mod search;
mod target;
#[cfg(test)]
mod tests;

pub use files::fit_table;
pub use scan::{LeftOut, Scan};
pub use target::{FitError, Target};

use crate::body::Body;
use crate::error::{Result, TrainerError};
use crate::evaluate::more_shapes;
use crate::files::create_folder;
use crate::progress::Phase;
use crate::run::Run;
use crate::scene::Scene;
use crate::shapes::Shapes;
use crate::trained::{Changes, Trained};
use actuation_net::ActuationNet;
use face_rig::JointParameters;
use muscles::{Muscles, State};
use nalgebra::Vector3;
use pd_solver::Status;
use search::{Found, minimise};
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;

/// Steps of the search where nothing else is said.
pub const DEFAULT_STEPS: usize = 30;
/// Reach of a scan where nothing else is said, as a share of the bounding-box diagonal.
const REACH: f64 = 0.05;
/// The shape that no muscle makes.
const NEUTRAL: &str = "neutral";

/// What is fitted to.
#[derive(Debug, Clone, PartialEq)]
pub enum FitSource {
    /// Shapes over the body's vertices, as `eval --shapes` reads them.
    Shapes {
        /// A glTF file of morph targets, or a file of frames.
        file: PathBuf,
        /// What frames weigh, instead of the scene's shapes.
        units: Option<PathBuf>,
    },
    /// Surfaces of any topology in the frame and unit of the neutral surface.
    Scans {
        /// OBJ, glTF or GLB files.
        files: Vec<PathBuf>,
        /// Distance beyond which vertices are left out, scene unit; 5 % of the bounding-box diagonal unless given.
        reach: Option<f64>,
    },
}

/// What to fit, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct FitRequest {
    /// What is fitted to.
    pub source: FitSource,
    /// Limit of the search's steps.
    pub steps: usize,
    /// What differs from training.
    pub changes: Changes,
    /// Where to write; the run's evaluation folder otherwise.
    pub out: Option<PathBuf>,
}

/// One fitted target.
#[derive(Serialize)]
pub struct Fitted {
    /// Name of the shape, or of the scan's file.
    pub name: String,
    /// The shape whose descriptor the search started from: the target itself, or for a scan the training shape nearest to it.
    pub start: String,
    /// Errors of that start, over the vertices that count at the end.
    pub before: FitError,
    /// Errors of the fitted shape.
    pub after: FitError,
    /// Loss of that start, over the same vertices.
    pub loss_before: f64,
    /// Loss of the fitted shape, at most that of the start.
    pub loss_after: f64,
    /// What a scan leaves out at the end, as shares of what all vertices count.
    pub left_out: Option<LeftOut>,
    /// Steps that lowered the loss.
    pub steps: usize,
    /// Equilibria found or tried, with those of the start and of the end.
    pub simulations: usize,
    /// Linear solves: of adjoints and for Gauss-Newton matrices.
    pub linear_solves: usize,
    /// Seconds for everything.
    pub seconds: f64,
    /// How the last equilibrium ended, which starts from rest.
    pub status: Status,
    /// Elements with at least one sample turned inside out.
    pub inverted_elements: usize,
    /// The fitted code: what `ActuationNet::evaluate_latent` takes.
    pub latent: Vec<f32>,
    /// The fitted joint: two angles in radians, a translation; where something hangs on it.
    pub joint: Option<JointParameters>,
    /// What each vertex counts at the end.
    #[serde(skip)]
    pub weights: Vec<f64>,
    /// The target.
    #[serde(skip)]
    pub target: Target,
    /// Vertices of the start.
    #[serde(skip)]
    pub surface_before: Vec<Vector3<f64>>,
    /// Vertices of the fitted shape.
    #[serde(skip)]
    pub surface: Vec<Vector3<f64>>,
}

/// What [`fit`] made.
pub struct Fit {
    /// All targets, in the order of the files.
    pub shapes: Vec<Fitted>,
    /// The length unit.
    pub unit: String,
    /// Where the files are.
    pub folder: PathBuf,
}

/// Fits latent code and joint of a trained run to shapes or scans, and writes `fit.json`, `fit.glb` and the sheets `fit-sheet-1.png` and
/// on.
///
/// # Errors
/// When the run is not finished or damaged, a file does not fit, a search cannot start, the user stops, or the output cannot be
/// written.
pub fn fit(run: &Run, request: &FitRequest) -> Result<Fit> {
    if request.steps == 0 {
        return Err(TrainerError::Option {
            option: "--fit-steps",
            text: "0".into(),
            mend: "give at least 1",
        });
    }
    let trained = Trained::load(run, &request.changes)?;
    let Trained {
        scene, body, net, ..
    } = &trained;
    // All files are read and judged before the first simulation.
    let mut begun = Vec::new();
    for target in targets(&trained, &request.source)? {
        let start = start(&target, body, &trained.shapes)?;
        begun.push((target, start));
    }
    let folder = create_folder(&request.out.clone().unwrap_or(run.evaluation_folder()))?;
    let unit = code_unit(&trained.shapes, net)?;
    let mut phase = Phase::new("fit", begun.len() as u64, 0);
    let mut shapes = Vec::with_capacity(begun.len());
    for (target, start) in begun {
        let fitted = fit_one(scene, body, net, (target, start), unit, request.steps)?;
        phase.step(|| {
            let (before, after) = (fitted.before.mean, fitted.after.mean);
            format!("{} {before:.5} -> {after:.5} {}", fitted.name, scene.unit)
        });
        shapes.push(fitted);
    }
    phase.finish(&format!("{} fitted", shapes.len()));
    let fit = Fit {
        shapes,
        unit: scene.unit.clone(),
        folder,
    };
    files::write(scene, body, &fit, request.steps)?;
    Ok(fit)
}

fn targets(trained: &Trained, source: &FitSource) -> Result<Vec<Target>> {
    let Trained {
        scene,
        inputs,
        body,
        shapes,
        ..
    } = trained;
    match source {
        FitSource::Shapes { file, units } => {
            let units = units.as_deref();
            let wanted = more_shapes(Some(file), units, scene, shapes, inputs)?;
            Ok(wanted.into_iter().map(Target::Shape).collect())
        }
        FitSource::Scans { files, reach } => {
            let reach = reach.unwrap_or(REACH * body.diagonal);
            if !(reach.is_finite() && reach > 0.0) {
                return Err(TrainerError::Option {
                    option: "--scan-reach",
                    text: reach.to_string(),
                    mend: "give a finite length above zero",
                });
            }
            let scans = files.iter().map(|path| {
                let scan = Scan::read(path, body, &scene.unit, reach)?;
                Ok(Target::Scan(Box::new(scan)))
            });
            scans.collect()
        }
    }
}

/// The descriptor that a search starts from, and the shape that it describes.
struct Start {
    descriptor: Vec<f32>,
    shape: String,
}

fn start(target: &Target, body: &Body, shapes: &Shapes) -> Result<Start> {
    let scan = match target {
        Target::Shape(shape) => {
            return Ok(Start {
                descriptor: shapes.descriptor(&shape.positions)?,
                shape: shape.name.clone(),
            });
        }
        Target::Scan(scan) => scan,
    };
    let training = shapes.training();
    let training = training.iter().map(|s| (s.name.as_str(), &*s.positions));
    let rest = (NEUTRAL, body.surface.vertices());
    let mut least: Option<(f64, _, _)> = None;
    for (name, x) in std::iter::once(rest).chain(training) {
        let matches = scan.matches(body, x);
        let value = scan.misfit(&matches);
        if least.as_ref().is_none_or(|least| value < least.0) {
            least = Some((value, (name, x), matches.left_out));
        }
    }
    let (_, (name, x), left_out) = least.expect("neutral is always there");
    scan.check_found(&left_out)?;
    Ok(Start {
        descriptor: shapes.descriptor(x)?,
        shape: name.into(),
    })
}

/// Root mean square distance of the training shapes' codes from the neutral one: what a large step of a code is.
fn code_unit(shapes: &Shapes, net: &ActuationNet) -> Result<f64> {
    let neutral = net.latent(&vec![0.0; shapes.descriptor_size()])?;
    let training = shapes.training();
    let mut sum = 0.0;
    for shape in &training {
        let latent = net.latent(&shapes.descriptor(&shape.positions)?)?;
        let squares = latent.iter().zip(&neutral).map(|(a, b)| (a - b).powi(2));
        sum += f64::from(squares.sum::<f32>());
    }
    let unit = (sum / training.len() as f64).sqrt();
    // An encoder that tells no shapes apart has no scale of its own.
    Ok(if unit > 0.0 { unit } else { 1.0 })
}

/// Fits one target.
fn fit_one(
    scene: &Scene,
    body: &Body,
    net: &ActuationNet,
    (target, start): (Target, Start),
    unit: f64,
    steps: usize,
) -> Result<Fitted> {
    let clock = Instant::now();
    let latent = net.latent(&start.descriptor)?;
    let answer = net.evaluate_latent(&latent, &[])?;
    let mut muscles = Muscles::new(body, scene, net, &target, unit)?;
    let x = muscles.variables(&latent, &answer.joint);
    let refused = |status| TrainerError::FitStart {
        shape: target.name(),
        status,
    };
    let first = muscles.state(&x, None)?;
    let first = first.ok_or_else(|| refused(Status::NotFinite))?;
    let status = first.equilibrium.solution.status;
    if status != Status::Converged {
        return Err(refused(status));
    }
    let before = target.measure(body, &first.surface).distances;
    let surface_before = first.surface.clone();
    let nodes_before = first.equilibrium.solution.positions.clone();
    let start_loss = |weights: &[f64]| {
        let aim = target.aim(body, &surface_before);
        let loss = aim.loss(&scene.loss, Some(weights));
        loss.nodes(&nodes_before).0
    };
    let original = x.clone();
    let Found {
        x,
        place: last,
        steps,
    } = minimise(&mut muscles, x, first, steps)?;
    let (last, steps) = match steps {
        0 => (last, 0),
        // What is reported is what anybody gets from the code alone, from rest: a body with several equilibria may have another one
        // there than the search found.
        _ => match muscles.state(&x, None)? {
            Some(state) if is_better(&state, start_loss) => (state, steps),
            _ => {
                let first = muscles.state(&original, None)?;
                (first.ok_or_else(|| refused(Status::NotFinite))?, 0)
            }
        },
    };
    let after = target.measure(body, &last.surface);
    let (simulations, linear_solves) = (muscles.simulations, muscles.linear_solves);
    Ok(Fitted {
        name: target.name(),
        start: start.shape,
        before: FitError::of(&before, &after.weights),
        after: FitError::of(&after.distances, &after.weights),
        loss_before: start_loss(&last.weights),
        loss_after: last.value,
        left_out: after.left_out,
        weights: after.weights,
        steps,
        simulations,
        linear_solves,
        seconds: clock.elapsed().as_secs_f64(),
        status: last.equilibrium.solution.status,
        inverted_elements: body.inverted_elements(&last.equilibrium.solution.positions),
        latent: last.latent,
        joint: last.equilibrium.theta,
        surface_before,
        surface: last.surface,
        target,
    })
}

/// Whether a state is an equilibrium, and no worse than the start over the vertices that count in it.
fn is_better(state: &State, start_loss: impl Fn(&[f64]) -> f64) -> bool {
    let converged = state.equilibrium.solution.status == Status::Converged;
    converged && state.value <= start_loss(&state.weights)
}
