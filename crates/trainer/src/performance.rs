//! Performances: a body simulated frame by frame, along curves of weights or along a path of codes.

mod files;
mod moving;
mod path;
mod summary;

pub(crate) use files::{PERFORMANCE, evenly};
pub use path::CodePath;
pub use summary::summary;

use crate::body::Body;
use crate::error::{Result, TrainerError};
use crate::evaluate::{Evaluator, ShapeResult};
use crate::files::create_folder;
use crate::frames::{frame_shapes, read_frames, read_units};
use crate::progress::{Phase, stop_requested};
use crate::run::Run;
use crate::scene::Scene;
use crate::shapes::{Shape, ShapeSet, Shapes};
use crate::trained::{Changes, Trained};
use actuation_net::ActuationNet;
use files::{Pictures, write};
use moving::Moving;
use nalgebra::Vector3;
use path::along;
use pd_solver::Status;
use serde::Serialize;
use std::path::PathBuf;

/// Frames per second where nothing else is said.
pub const DEFAULT_FPS: f64 = 24.0;

/// What is performed.
#[derive(Debug, Clone, PartialEq)]
pub enum Source {
    /// A file of frames with weights over shapes ([`crate::frames::read_frames`]): the code of a frame is the descriptor of the linear
    /// blend of its shapes, which is its target too.
    Curves(PathBuf),
    /// A path of codes: from each shape straight to the next. A frame has no target of its own; it is measured against the linear blend of
    /// the two shapes that it lies between.
    Path(CodePath),
}

/// What to perform, and how.
#[derive(Debug, Clone)]
pub struct PerformanceRequest {
    /// What is performed.
    pub source: Source,
    /// A glTF file over the same vertices whose morph targets are named instead of the scene's shapes.
    pub units: Option<PathBuf>,
    /// Frames per second of the animation.
    pub fps: f64,
    /// What differs from training.
    pub changes: Changes,
    /// The evaluation folder; the run's own otherwise. The files go to the folder `performance` in it.
    pub out: Option<PathBuf>,
}

/// Where the solver started.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Start {
    /// From rest.
    Rest,
    /// From the frame before.
    Previous,
    /// From rest, after it had not converged from the frame before.
    RestAfterPrevious,
}

/// One simulated frame.
#[derive(Debug, Clone, Serialize)]
pub struct PerformedFrame {
    /// Number of the frame, from 1.
    pub frame: usize,
    /// Seconds from the start of the animation.
    pub time: f64,
    /// Where the solver started; iterations and seconds count all attempts.
    pub start: Start,
    /// The frame as a simulated shape. Its nodes and target are not kept.
    #[serde(flatten)]
    pub result: ShapeResult,
}

/// What [`perform`] made.
#[derive(Debug)]
pub struct Performance {
    /// All frames.
    pub frames: Vec<PerformedFrame>,
    /// What was performed.
    pub source: Source,
    /// Frames per second.
    pub fps: f64,
    /// Length of the diagonal of the neutral surface's bounding box.
    pub diagonal: f64,
    /// The length unit.
    pub unit: String,
    /// Where the files are.
    pub folder: PathBuf,
}

/// Simulates a performance, each frame from the one before, and writes `performance/` into the evaluation folder: `animation.glb`,
/// `frame-0001.png` and on, `contact-sheet.png` and `performance.json`.
///
/// # Errors
/// When the run is not finished or damaged, the frames or the path cannot be used, there are more frames than one GLB file holds, the
/// user stops, or the output cannot be written.
pub fn perform(run: &Run, request: &PerformanceRequest) -> Result<Performance> {
    if !(0.01..=1000.0).contains(&request.fps) {
        return Err(TrainerError::Option {
            option: "--fps",
            text: request.fps.to_string(),
            mend: "give a number from 0.01 to 1000",
        });
    }
    let trained = Trained::load(run, &request.changes)?;
    let Trained {
        scene,
        inputs,
        body,
        shapes,
        net,
    } = &trained;
    let units = read_units(request.units.as_deref(), inputs)?;
    let wanted = match &request.source {
        Source::Curves(path) => {
            let frames = read_frames(path, &units)?;
            check_count(frames.len(), body)?;
            with_descriptors(frame_shapes(&frames, &units, ShapeSet::Blend), shapes)?
        }
        Source::Path(path) => {
            check_count(path.frame_count(), body)?;
            along(path, &units, shapes)?
        }
    };
    let evaluation = request.out.clone().unwrap_or(run.evaluation_folder());
    let folder = create_folder(&evaluation.join(PERFORMANCE))?;
    let performance = Performance {
        frames: simulate(scene, body, net, wanted, request.fps)?,
        source: request.source.clone(),
        fps: request.fps,
        diagonal: body.diagonal,
        unit: scene.unit.clone(),
        folder,
    };
    let pictures = Pictures::draw(scene, body, &performance.frames)?;
    write(scene, body, &performance, &pictures)?;
    Ok(performance)
}

/// A shape and the code that is simulated for it.
type Wanted = (Shape, Vec<f32>);

fn with_descriptors(targets: Vec<Shape>, shapes: &Shapes) -> Result<Vec<Wanted>> {
    let described = targets.into_iter().map(|shape| {
        let descriptor = shapes.descriptor(&shape.positions)?;
        Ok((shape, descriptor))
    });
    described.collect()
}

/// Refuses more frames than the animation can hold, before they are simulated.
fn check_count(frames: usize, body: &Body) -> Result<()> {
    let vertices = body.surface.vertex_count();
    // A target holds at most a vector for every vertex, and some JSON; the weights are a number for every frame and target.
    let bytes = |n: u64| n * (12 * vertices as u64 + 512) + 4 * n * n;
    let room = u64::from(u32::MAX) - 64 * vertices as u64 - 4096;
    // So many frames never fit, and their square does not overflow.
    let fits = |n: usize| n <= u16::MAX as usize && bytes(n as u64) <= room;
    if fits(frames) {
        return Ok(());
    }
    let (mut most, mut over) = (0, u16::MAX as usize + 1);
    while over - most > 1 {
        let middle = (most + over) / 2;
        if fits(middle) {
            most = middle;
        } else {
            over = middle;
        }
    }
    Err(TrainerError::TooManyFrames {
        frames,
        vertices,
        most,
    })
}

/// Simulates frames one after another, each from the one before; from rest where there is none that converged, or where that start fails.
fn simulate(
    scene: &Scene,
    body: &Body,
    net: &ActuationNet,
    wanted: Vec<Wanted>,
    fps: f64,
) -> Result<Vec<PerformedFrame>> {
    let mut evaluator = Evaluator::new(body, scene)?;
    let mut moving = Moving::new(body, scene, fps);
    let mut phase = Phase::new("performance", wanted.len() as u64, 0);
    let mut frames: Vec<PerformedFrame> = Vec::with_capacity(wanted.len());
    let mut nodes: Option<Vec<Vector3<f64>>> = None;
    for (i, (shape, descriptor)) in wanted.into_iter().enumerate() {
        if stop_requested() {
            return Err(TrainerError::EvaluationStopped);
        }
        let (start, mut result) = match nodes.take() {
            previous if let Some(moving) = &mut moving => {
                let start = previous.as_ref().map_or(Start::Rest, |_| Start::Previous);
                let wanted = (&shape, descriptor);
                (
                    start,
                    moving.frame(&mut evaluator, net, wanted, i + 1, previous.as_deref())?,
                )
            }
            None => (Start::Rest, evaluator.shape(net, &shape, descriptor, None)?),
            Some(previous) => {
                let warm = evaluator.shape(net, &shape, descriptor, Some(&previous))?;
                if warm.status == Status::Converged {
                    (Start::Previous, warm)
                } else {
                    let code = warm.descriptor.clone();
                    better(warm, evaluator.shape(net, &shape, code, None)?)
                }
            }
        };
        let reached = std::mem::take(&mut result.nodes);
        nodes = (result.status == Status::Converged).then_some(reached);
        result.target = Vec::new();
        phase.step(|| format!("{} {:.3} %", result.name, result.mean_error_percent));
        frames.push(PerformedFrame {
            frame: i + 1,
            time: i as f64 / fps,
            start,
            result,
        });
    }
    phase.finish(&format!("{} frames simulated", frames.len()));
    Ok(frames)
}

/// Of an attempt from the frame before that did not converge and one from rest: the second one, unless it failed too and lies higher.
fn better(warm: ShapeResult, mut cold: ShapeResult) -> (Start, ShapeResult) {
    let (iterations, seconds) = (warm.iterations, warm.seconds);
    if cold.status != Status::Converged && warm.energy <= cold.energy {
        let mut warm = warm;
        warm.iterations += cold.iterations;
        warm.seconds += cold.seconds;
        return (Start::Previous, warm);
    }
    cold.iterations += iterations;
    cold.seconds += seconds;
    (Start::RestAfterPrevious, cold)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;

    #[test]
    fn too_many_frames_are_refused_before_they_are_simulated() {
        let body = fixture::body(&fixture::scene(""));
        assert!(check_count(1000, &body).is_ok());
        let TrainerError::TooManyFrames { most, .. } = check_count(usize::MAX, &body).unwrap_err()
        else {
            panic!("another error");
        };
        assert!(most > 20_000 && check_count(most, &body).is_ok());
        assert!(check_count(most + 1, &body).is_err());
    }

    #[test]
    fn of_two_attempts_the_better_one_is_kept() {
        let attempt = |status, energy| ShapeResult {
            status,
            energy,
            ..fixture::result("long", ShapeSet::Blend)
        };
        let (open, done) = (Status::IterationLimit, Status::Converged);
        for (warm, cold, start) in [
            ((open, 1.0), (done, 2.0), Start::RestAfterPrevious),
            ((open, 1.0), (open, 2.0), Start::Previous),
            ((open, 2.0), (open, 1.0), Start::RestAfterPrevious),
            ((open, f64::NAN), (open, 1.0), Start::RestAfterPrevious),
        ] {
            let (found, kept) = better(attempt(warm.0, warm.1), attempt(cold.0, cold.1));
            assert_eq!((found, kept.iterations), (start, 14));
            assert!((kept.seconds - 0.2).abs() < 1e-12);
        }
    }
}
