//! Evaluation of a trained network: simulate shapes, measure them, draw them.

use crate::actuator::{Actuator, Samples};
use crate::body::Body;
use crate::error::{Result, TrainerError};
use crate::files::{create_folder, write_json};
use crate::frames::{frame_shapes, is_frames_file, is_json, read_frames, read_units};
use crate::loss::distances;
use crate::progress::{Phase, stop_requested};
use crate::run::Run;
use crate::scene::Scene;
use crate::shapes::{Shape, ShapeSet, Shapes, difference, read_matching};
use crate::simulator::{Equilibrium, Simulator};
use crate::trained::{Changes, Trained};
use actuation_net::Output;
use face_rig::JointParameters;
use nalgebra::Vector3;
use pd_solver::{Solution, SolveOptions, Status, Stop};
use serde::Serialize;
use std::path::{Path, PathBuf};
use surface_mesh::{MorphTarget, MorphedSurface, write_glb};

/// One simulated shape and how far it is from its target.
#[derive(Debug, Clone, Serialize)]
pub struct ShapeResult {
    /// Name of the shape.
    pub name: String,
    /// What it is for.
    pub set: ShapeSet,
    /// Mean distance of the surface's vertices from the target. A blend's target is the linear blend of its shapes.
    pub mean_error: f64,
    /// Largest distance.
    pub max_error: f64,
    /// Mean distance in percent of the bounding-box diagonal.
    pub mean_error_percent: f64,
    /// Largest distance in percent of the bounding-box diagonal.
    pub max_error_percent: f64,
    /// Energy of the equilibrium.
    pub energy: f64,
    /// Steps of the solver.
    pub iterations: usize,
    /// How the solver ended.
    pub status: Status,
    /// Seconds for network, equilibrium and surface.
    pub seconds: f64,
    /// Estimated largest distance of a node from its final place; absent where no step was needed.
    pub estimated_error: Option<f64>,
    /// Elements with at least one sample turned inside out.
    pub inverted_elements: usize,
    /// Mean distance over the vertices that the loss does not leave out, each weighted by what it counts.
    pub weighted_error: f64,
    /// Distance that 99 of 100 of those vertices do not exceed.
    pub error_p99: f64,
    /// What the joint does: two angles in radians, a translation; where something hangs on it.
    pub joint: Option<JointParameters>,
    /// Mean distance of the nodes that hang on the joint from where they should be, where that is known.
    pub jaw_error: Option<f64>,
    /// Weights that describe the shape to the network.
    pub descriptor: Vec<f32>,
    /// Where the surface's vertices should be.
    #[serde(skip)]
    pub target: Vec<Vector3<f64>>,
    /// Positions of the surface's vertices.
    #[serde(skip)]
    pub surface: Vec<Vector3<f64>>,
    /// Positions of the nodes.
    #[serde(skip)]
    pub nodes: Vec<Vector3<f64>>,
}

/// What `metrics.json` holds.
#[derive(Debug, Serialize)]
pub struct Metrics<'a> {
    /// Name of the scene.
    pub scene: &'a str,
    /// Length of the diagonal of the neutral surface's bounding box.
    pub bbox_diagonal: f64,
    /// The length unit.
    pub unit: &'a str,
    /// Edge length of an element.
    pub element_size: f64,
    /// Elements of the body.
    pub elements: usize,
    /// One entry per shape.
    pub shapes: &'a [ShapeResult],
}

/// Simulates shapes one after another.
pub struct Evaluator<'a> {
    body: &'a Body,
    scene: &'a Scene,
    simulator: Simulator,
}

impl<'a> Evaluator<'a> {
    /// Builds the solver of the scene on a body.
    ///
    /// # Errors
    /// When the effects do not fit the body.
    pub fn new(body: &'a Body, scene: &'a Scene) -> Result<Self> {
        Ok(Self {
            body,
            scene,
            simulator: Simulator::new(body, scene)?,
        })
    }

    /// The equilibrium of an answer of the network, to the accuracy of the scene's evaluation.
    ///
    /// # Errors
    /// When something does not fit or is not finite.
    pub fn equilibrium(
        &mut self,
        answer: &Output,
        start: Option<&[Vector3<f64>]>,
    ) -> Result<Equilibrium> {
        let options = self.options().measuring_error();
        self.simulator.equilibrium(answer, start, &options)
    }

    /// How shapes are simulated: to the accuracy of the scene's evaluation.
    pub(crate) fn options(&self) -> SolveOptions {
        let accuracy = self.scene.evaluation_accuracy(self.body.diagonal);
        SolveOptions::new(Stop::Accuracy(accuracy)).with_method(self.scene.evaluation.method)
    }

    /// The solver and what hangs on the joint.
    pub fn simulator(&mut self) -> &mut Simulator {
        &mut self.simulator
    }

    /// Simulates one shape from its descriptor, from rest or from node positions given.
    ///
    /// # Errors
    /// When the network's answer is not finite or something does not fit.
    pub fn shape(
        &mut self,
        net: &impl Actuator,
        shape: &Shape,
        descriptor: Vec<f32>,
        start: Option<&[Vector3<f64>]>,
    ) -> Result<ShapeResult> {
        let clock = std::time::Instant::now();
        let output = net.evaluate(&descriptor, &Samples::all(self.body.actuated()))?;
        let Equilibrium {
            theta, solution, ..
        } = self.equilibrium(&output, start)?;
        self.result(shape, descriptor, solution, theta, clock)
    }

    /// Measures what the solver found for a shape; `clock` was started before the network was asked.
    ///
    /// # Errors
    /// When the surface has another number of vertices than the shape.
    pub(crate) fn result(
        &self,
        shape: &Shape,
        descriptor: Vec<f32>,
        solution: Solution,
        theta: Option<JointParameters>,
        clock: std::time::Instant,
    ) -> Result<ShapeResult> {
        let surface = self.body.surface_positions(&solution.positions);
        let seconds = clock.elapsed().as_secs_f64();
        let (mean_error, max_error, all) = distances(&surface, &shape.positions);
        let (weighted_error, error_p99) = weighted(&all, &self.body.vertex_weights);
        let jaw = self.simulator.hanging.as_ref().zip(theta).zip(shape.joint);
        let percent = 100.0 / self.body.diagonal;
        Ok(ShapeResult {
            name: shape.name.clone(),
            set: shape.set,
            mean_error,
            max_error,
            mean_error_percent: mean_error * percent,
            max_error_percent: max_error * percent,
            energy: solution.stats.energy,
            iterations: solution.stats.iterations,
            status: solution.status,
            seconds,
            weighted_error,
            error_p99,
            joint: theta,
            jaw_error: jaw.map(|((hanging, own), wanted)| hanging.mean_distance(own, wanted)),
            estimated_error: solution.stats.estimated_error,
            inverted_elements: self.body.inverted_elements(&solution.positions),
            descriptor,
            target: shape.positions.clone(),
            surface,
            nodes: solution.positions,
        })
    }
}

/// Weighted mean of distances, and the distance that 99 % of the vertices with a weight do not exceed.
pub(crate) fn weighted(distances: &[f64], weights: &[f64]) -> (f64, f64) {
    let mean = distances.iter().zip(weights).map(|(d, w)| d * w).sum();
    let counted = distances.iter().zip(weights).filter(|(_, w)| **w > 0.0);
    let mut counted: Vec<f64> = counted.map(|(d, _)| *d).collect();
    counted.sort_unstable_by(f64::total_cmp);
    let last = (0.99 * counted.len() as f64).ceil() as usize;
    (
        mean,
        counted.get(last.saturating_sub(1)).copied().unwrap_or(0.0),
    )
}

/// What to evaluate.
#[derive(Debug, Default)]
pub struct EvaluationRequest {
    /// Held-out shapes: a glTF file over the same vertices, or a file of frames with weights over the scene's shapes.
    pub shapes: Option<PathBuf>,
    /// A glTF file over the same vertices whose morph targets those frames weigh instead.
    pub units: Option<PathBuf>,
    /// Blends of shapes by name and weight.
    pub blends: Vec<Vec<(String, f64)>>,
    /// What differs from training.
    pub changes: Changes,
    /// Where to write; the run's own folder otherwise.
    pub out: Option<PathBuf>,
}

/// Evaluates a trained run and writes `metrics.json`, `shapes.glb` and the sheets. Returns the results and the folder.
///
/// # Errors
/// When the run is not finished or damaged, a file does not fit, or the output cannot be written.
pub fn evaluate(run: &Run, request: &EvaluationRequest) -> Result<(Vec<ShapeResult>, PathBuf)> {
    let Trained {
        scene,
        inputs,
        body,
        shapes,
        net,
    } = Trained::load(run, &request.changes)?;
    let mut wanted: Vec<Shape> = shapes.all.clone();
    let more = (request.shapes.as_deref(), request.units.as_deref());
    wanted.extend(more_shapes(more.0, more.1, &scene, &shapes, &inputs)?);
    for weights in &request.blends {
        wanted.push(shapes.blend(weights, &inputs)?);
    }
    let folder = create_folder(&request.out.clone().unwrap_or(run.evaluation_folder()))?;
    let results = simulate(&scene, &body, &shapes, &net, &wanted)?;
    write(&folder, &scene, &body, &results)?;
    Ok((results, folder))
}

fn units_without_frames(units: &Path) -> TrainerError {
    TrainerError::Option {
        option: "--units",
        text: units.display().to_string(),
        mend: "it names the shapes that frames weigh: give it with --curves, or with --shapes and a .json or .csv file of frames",
    }
}

/// The shapes that `--shapes` and `--units` name, with what the jaw does in them where a file of frames says so; none without
/// `--shapes`.
///
/// # Errors
/// When `units` stands without frames, a file cannot be read, does not match the surface or holds nothing.
pub(crate) fn more_shapes(
    file: Option<&Path>,
    units: Option<&Path>,
    scene: &Scene,
    shapes: &Shapes,
    inputs: &MorphedSurface,
) -> Result<Vec<Shape>> {
    let path = match (file, units) {
        (Some(path), _) => path,
        (None, Some(units)) => return Err(units_without_frames(units)),
        (None, None) => return Ok(Vec::new()),
    };
    let mut held_out = held_out(path, units, inputs)?;
    if let Some(jaw) = shapes.jaw().filter(|_| is_json(path)) {
        let motions = jaw.motions(path, &scene.unit)?;
        for shape in &mut held_out {
            shape.joint = motions.get(&shape.name).copied();
        }
    }
    Ok(held_out)
}

fn held_out(path: &Path, units: Option<&Path>, inputs: &MorphedSurface) -> Result<Vec<Shape>> {
    if is_frames_file(path) {
        let units = read_units(units, inputs)?;
        let frames = read_frames(path, &units)?;
        return Ok(frame_shapes(&frames, &units, ShapeSet::HeldOut));
    }
    if let Some(units) = units {
        return Err(units_without_frames(units));
    }
    let rest = inputs.surface.vertices();
    let targets = read_matching(path, &inputs.surface)?;
    let shapes = targets.into_iter().map(|target| Shape {
        name: target.name,
        set: ShapeSet::HeldOut,
        positions: rest
            .iter()
            .zip(&target.deltas)
            .map(|(x, d)| x + d)
            .collect(),
        joint: None,
    });
    Ok(shapes.collect())
}

/// Simulates all shapes from rest.
///
/// # Errors
/// As [`Evaluator::shape`]; and when the user stops.
pub fn simulate(
    scene: &Scene,
    body: &Body,
    shapes: &Shapes,
    net: &impl Actuator,
    wanted: &[Shape],
) -> Result<Vec<ShapeResult>> {
    let mut evaluator = Evaluator::new(body, scene)?;
    let mut phase = Phase::new("evaluation", wanted.len() as u64, 0);
    let mut results = Vec::with_capacity(wanted.len());
    for shape in wanted {
        if stop_requested() {
            return Err(TrainerError::EvaluationStopped);
        }
        let descriptor = shapes.descriptor(&shape.positions)?;
        let result = evaluator.shape(net, shape, descriptor, None)?;
        phase.step(|| format!("{} {:.3} %", result.name, result.mean_error_percent));
        results.push(result);
    }
    phase.finish(&format!("{} shapes simulated", results.len()));
    Ok(results)
}

/// Writes everything an evaluation shows.
///
/// # Errors
/// When a file cannot be written.
pub fn write(folder: &Path, scene: &Scene, body: &Body, results: &[ShapeResult]) -> Result<()> {
    let metrics = Metrics {
        scene: &scene.name,
        bbox_diagonal: body.diagonal,
        unit: &scene.unit,
        element_size: body.mesh.element_size(),
        elements: body.mesh.elements().len(),
        shapes: results,
    };
    let rest = body.surface.vertices();
    let targets = results.iter().map(|r| MorphTarget {
        name: r.name.clone(),
        deltas: difference(&r.surface, rest),
    });
    let simulated = MorphedSurface::new(body.surface.clone(), targets.collect())?;
    write_glb(folder.join("shapes.glb"), &simulated)?;
    crate::sheets::write(folder, scene, body, results)?;
    write_json(&folder.join("metrics.json"), &metrics)
}

/// Reads `a=0.5,b=0.5`.
///
/// # Errors
/// When it does not parse or a weight is not finite.
pub fn parse_weights(text: &str) -> Result<Vec<(String, f64)>> {
    let wrong = || TrainerError::WeightList {
        text: text.to_string(),
    };
    let entries = text.split(',').map(|entry| {
        let (name, weight) = entry.split_once('=').ok_or_else(wrong)?;
        let weight: f64 = weight.trim().parse().map_err(|_| wrong())?;
        let name = name.trim();
        if name.is_empty() || !weight.is_finite() {
            return Err(wrong());
        }
        Ok((name.to_string(), weight))
    });
    entries.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weight_lists() {
        let weights = parse_weights("curl=0.5, lift = 1").unwrap();
        assert_eq!(
            weights,
            [("curl".to_string(), 0.5), ("lift".to_string(), 1.0)]
        );
        for bad in [
            "",
            "curl",
            "curl=",
            "curl=x",
            "=1",
            "curl=nan",
            "curl=1,,lift=1",
        ] {
            assert!(parse_weights(bad).is_err(), "{bad}");
        }
    }
}
