//! Scenes simulated without a network: muscles, shapes, held parts and loads move by keys in time, and the effects do the rest.

mod files;
mod touch;

use crate::body::Body;
use crate::dynamics::Dynamics;
use crate::error::{Result, TrainerError, suggestion};
use crate::geometry::{Geometry, GeometryMeasure};
use crate::motion::{Key, MotionSettings};
use crate::progress::{Phase, stop_requested};
use crate::rig::Rig;
use crate::scene::Scene;
use crate::shapes::{Shapes, load_neutral, load_shapes};
use crate::simulator::{Simulator, set_actuation};
use crate::stage1::pull;
use face_rig::JointParameters;
use hex_mesh::NodeRegion;
use nalgebra::Vector3;
use pd_solver::{EffectSpec, Parameters, SolveOptions, Status, Stop};
use serde::Serialize;
use std::path::{Path, PathBuf};
pub use touch::Touch;
use touch::{Obstacles, Watch};

/// What to simulate.
#[derive(Debug, Clone)]
pub struct SimulateRequest {
    /// The scene file, with a `[motion]`.
    pub scene: PathBuf,
    /// Folder that its files are relative to; that of the scene file unless given.
    pub data: Option<PathBuf>,
    /// Kinds of effects to be left out beside, instead of `motion.without`.
    pub without: Option<Vec<String>>,
    /// Another element size than that of the scene.
    pub element_size: Option<f64>,
    /// Where to write; `simulations/NAME` unless given.
    pub out: Option<PathBuf>,
}

/// One simulated frame.
#[derive(Debug, Clone, Serialize)]
pub struct SimulatedFrame {
    /// Number of the frame, from 1.
    pub frame: usize,
    /// Seconds from the start.
    pub time: f64,
    /// How the solver ended.
    pub status: Status,
    /// Steps of the solver, over all steps in time.
    pub iterations: usize,
    /// Seconds of the solver.
    pub seconds: f64,
    /// Energy at the end.
    pub energy: f64,
    /// Estimated largest distance of a node from its final place; absent where no step was needed.
    pub estimated_error: Option<f64>,
    /// What the surface does not keep.
    #[serde(flatten)]
    pub geometry: Geometry,
    /// Where it touches itself or others; absent without contact.
    pub touch: Option<Touch>,
    /// Pairs of a triangle of the surface and one of an obstacle that pass through each other and did not at rest; absent without obstacles
    /// that are surfaces. Where contact is left out, of the obstacles that it would know.
    pub obstacle_pairs: Option<usize>,
    /// Elements with a sample turned inside out.
    pub inverted_elements: usize,
    /// Largest distance of a vertex from rest.
    pub moved: f64,
    /// Kinetic energy; absent without inertia.
    pub kinetic_energy: Option<f64>,
    /// Vertices of the surface.
    #[serde(skip)]
    pub surface: Vec<Vector3<f64>>,
    /// Vertices of what may be touched.
    #[serde(skip)]
    pub obstacles: Vec<Vector3<f64>>,
}

/// The frames of one list of effects.
#[derive(Debug, Clone, Serialize)]
pub struct Variant {
    /// Kinds of effects left out.
    pub without: Vec<String>,
    /// Searches of contact for what is near.
    pub contact_queries: u64,
    /// Triangles that pass through others at rest, so that contact of the surface with itself leaves them and what touches them out.
    pub left_out: usize,
    /// All frames.
    pub frames: Vec<SimulatedFrame>,
}

/// What became of a list of effects, in a line.
pub fn variant_line(variant: &Variant) -> String {
    let frames = &variant.frames;
    let what = match variant.without.is_empty() {
        true => "all effects".to_string(),
        false => format!("without {}", variant.without.join(", ")),
    };
    let seconds: f64 = frames.iter().map(|f| f.seconds).sum();
    let volumes = frames.iter().map(|f| f.geometry.volume_change_percent);
    let (low, high) = volumes.fold((0.0f64, 0.0f64), |(l, h), v| (l.min(v), h.max(v)));
    let crossing = frames.iter().map(|f| f.geometry.crossing_pairs).max();
    let open = { frames.iter() }
        .filter(|f| f.status != Status::Converged)
        .count();
    let mut line = format!(
        "{what}: {} frames in {seconds:.1} s, volume {low:+.1} to {high:+.1} %, at most {} pairs of triangles crossed",
        frames.len(),
        crossing.unwrap_or(0)
    );
    let touched = { frames.iter() }
        .filter_map(|f| f.touch)
        .map(|t| t.crossing_pairs)
        .max();
    if let Some(crossed) = touched {
        line += &format!(", {crossed} where contact acts");
        if variant.left_out > 0 {
            let count = variant.left_out;
            line += &format!(
                " (not on what touches the {count} triangles that cross others at rest: `separate = true` under [mesh] moves them apart)"
            );
        }
    }
    if let Some(pairs) = frames.iter().filter_map(|f| f.obstacle_pairs).max() {
        line += &format!(", {pairs} with obstacles");
    }
    if open > 0 {
        line += &format!(", {open} frames NOT CONVERGED");
    }
    line
}

/// What [`simulate`] made.
#[derive(Debug)]
pub struct Simulated {
    /// All effects first; then, where some are left out beside, without those.
    pub variants: Vec<Variant>,
    /// The length unit.
    pub unit: String,
    /// Triangles over [`SimulatedFrame::obstacles`].
    pub obstacle_triangles: Vec<[u32; 3]>,
    /// Where the files are.
    pub folder: PathBuf,
}

/// Simulates a scene frame by frame, and beside it without some of its effects; writes `sheet.png`, `animation.glb` and `simulation.json`.
///
/// # Errors
/// When the scene has no `[motion]`, a file or an effect does not fit, the user stops, or the output cannot be written.
pub fn simulate(request: &SimulateRequest) -> Result<Simulated> {
    let (mut scene, _) = Scene::read(&request.scene)?;
    let Some(mut motion) = scene.motion.clone() else {
        return Err(TrainerError::SceneValue {
            path: request.scene.clone(),
            key: "motion",
            value: "missing".into(),
            mend: "say what moves, such as [motion] frames = 1; a scene without it can be trained",
        });
    };
    if let Some(without) = &request.without {
        motion.without.clone_from(without);
        if let Some((key, value, mend)) = motion.problem(&scene.effects) {
            let path = request.scene.clone();
            return Err(TrainerError::SceneValue {
                path,
                key,
                value,
                mend,
            });
        }
    }
    if let Some(size) = request.element_size {
        if !(size.is_finite() && size > 0.0) {
            return Err(TrainerError::Option {
                option: "--element-size",
                text: size.to_string(),
                mend: "give a finite number above zero",
            });
        }
        scene.mesh.element_size = size;
    }
    let beside = request
        .scene
        .parent()
        .map(PathBuf::from)
        .unwrap_or_default();
    let data = request.data.as_ref().unwrap_or(&beside);
    let stage = Stage::new(&request.scene, &scene, &motion, data)?;
    let folder = request.out.clone();
    let folder = folder.unwrap_or_else(|| Path::new("simulations").join(&scene.name));
    let folder = crate::files::create_folder(&folder)?;
    let mut variants = vec![stage.run(&scene, &motion, Vec::new())?];
    if !motion.without.is_empty() {
        let without = motion.without.clone();
        variants.push(stage.run(&scene.without(&without), &motion, without)?);
    }
    let obstacles = Obstacles::of(&stage.body.effects(&scene)?);
    obstacles.meet(&stage.body.surface, &mut variants);
    let simulated = Simulated {
        variants,
        obstacle_triangles: obstacles.triangles,
        unit: scene.unit.clone(),
        folder,
    };
    files::write(&scene, &motion, &stage.body, &simulated)?;
    Ok(simulated)
}

/// What one weight moves.
struct Mover {
    name: String,
    /// Actuation b of every row that the body asks for, at weight 1.
    actuation: Vec<f32>,
    joint: Option<JointParameters>,
}

/// A body and what moves it, whatever its effects.
struct Stage {
    body: Body,
    movers: Vec<Mover>,
}

impl Stage {
    fn new(path: &Path, scene: &Scene, motion: &MotionSettings, data: &Path) -> Result<Self> {
        let is_muscle = |name: &str| motion.muscles.iter().any(|m| m.name == name);
        let shapes: Vec<&str> = { motion.weighed().into_iter() }
            .filter(|name| !is_muscle(name))
            .collect();
        let rig = Rig::load(scene, data)?;
        let size = scene.mesh.element_size;
        if shapes.is_empty() {
            let body = Body::of_scene(scene, load_neutral(scene, data)?, &rig, size)?;
            let movers = muscles(motion, &body)?;
            return Ok(Self { body, movers });
        }
        if matches!(scene.surface, crate::scene::SurfaceSource::Solid(_)) {
            return Err(unknown(
                path,
                shapes[0],
                &names(motion.muscles.iter().map(|m| &m.name)),
            ));
        }
        let inputs = load_shapes(scene, data)?.shapes;
        let body = Body::of_scene(scene, inputs.surface.clone(), &rig, size)?;
        let all = Shapes::new(scene, &inputs, rig.jaw.as_ref(), &body.vertex_weights)?;
        let mut wanted = Vec::new();
        for name in &shapes {
            let Some(shape) = all.all.iter().find(|s| s.name == *name) else {
                let muscles = motion.muscles.iter().map(|m| &m.name);
                let known = names(muscles.chain(all.all.iter().map(|s| &s.name)));
                return Err(unknown(path, name, &known));
            };
            wanted.push(shape);
        }
        let mut movers = muscles(motion, &body)?;
        let pulled = pull(&body, scene, &wanted, || match stop_requested() {
            true => Err(TrainerError::EvaluationStopped),
            false => Ok(()),
        })?;
        for (shape, pulled) in wanted.into_iter().zip(pulled) {
            movers.push(Mover {
                name: shape.name.clone(),
                actuation: pulled.actuation,
                joint: shape.joint,
            });
        }
        Ok(Self { body, movers })
    }

    /// All frames under the effects of the scene.
    fn run(&self, scene: &Scene, motion: &MotionSettings, without: Vec<String>) -> Result<Variant> {
        let body = &self.body;
        let accuracy = scene.evaluation_accuracy(body.diagonal);
        let options =
            SolveOptions::new(Stop::Accuracy(accuracy)).with_method(scene.evaluation.method);
        let mut simulator = Simulator::new(body, scene)?;
        let first = self.parameters(scene, motion, 1, &simulator);
        let measure = GeometryMeasure::new(&body.surface);
        let watch = Watch::new(scene, body, &mut simulator.solver)?;
        let mut dynamics = None;
        if simulator.solver.time_step_length().is_some() {
            let mut start = body.mesh.nodes().to_vec();
            if motion.settled {
                let still_scene = scene.still();
                let mut still = Simulator::new(body, &still_scene)?;
                let at = self.parameters(&still_scene, motion, 1, &still);
                start = still.solver.solve(&at, None, &options)?.positions;
            } else {
                for (&node, x) in simulator.solver.prescribed().iter().zip(&first.prescribed) {
                    start[node as usize] = *x;
                }
            }
            dynamics = Some(Dynamics::new(
                &simulator.solver,
                start,
                first.clone(),
                motion.rate,
            )?);
        }
        let label = match without.is_empty() {
            true => "simulated".to_string(),
            false => format!("without {}", without.join(", ")),
        };
        let mut phase = Phase::new("simulation", motion.frames as u64, 0);
        let mut frames: Vec<SimulatedFrame> = Vec::with_capacity(motion.frames);
        let mut last: Option<Vec<Vector3<f64>>> = None;
        for frame in 1..=motion.frames {
            if stop_requested() {
                return Err(TrainerError::EvaluationStopped);
            }
            let parameters = self.parameters(scene, motion, frame, &simulator);
            let solution = match &mut dynamics {
                Some(dynamics) if frame == 1 => pd_solver::Solution {
                    positions: dynamics.state().positions.clone(),
                    status: Status::Converged,
                    ..pd_solver::Solution::default()
                },
                Some(dynamics) => dynamics.frame(&mut simulator.solver, &parameters, &options)?,
                None => simulator
                    .solver
                    .solve(&parameters, last.as_deref(), &options)?,
            };
            let surface = body.surface_positions(&solution.positions);
            let away = surface.iter().zip(body.surface.vertices());
            let momenta = dynamics
                .as_ref()
                .and_then(|d| simulator.solver.momenta(d.state()));
            let energy = solution.stats.energy;
            let (geometry, crossing) = measure.with_crossings(&surface)?;
            let touch = match &watch {
                Some(watch) => {
                    let nodes = &solution.positions;
                    Some(watch.look(&mut simulator.solver, nodes, &crossing)?)
                }
                None => None,
            };
            frames.push(SimulatedFrame {
                frame,
                time: (frame - 1) as f64 / motion.rate,
                status: solution.status,
                iterations: solution.stats.iterations,
                seconds: solution.stats.seconds,
                energy: if energy.is_finite() { energy } else { 0.0 },
                estimated_error: solution.stats.estimated_error,
                geometry,
                touch,
                obstacle_pairs: None,
                inverted_elements: body.inverted_elements(&solution.positions),
                moved: away.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max),
                kinetic_energy: momenta.map(|m| m.kinetic_energy),
                surface,
                obstacles: parameters.obstacles,
            });
            phase.step(|| format!("frame {frame}"));
            last = Some(solution.positions);
        }
        phase.finish(&format!("{} frames {label}", frames.len()));
        Ok(Variant {
            without,
            contact_queries: simulator.solver.work().contact_queries,
            left_out: watch.map_or(0, |w| w.left_out),
            frames,
        })
    }

    /// The solver's parameters at a frame.
    fn parameters(
        &self,
        scene: &Scene,
        motion: &MotionSettings,
        frame: usize,
        simulator: &Simulator,
    ) -> Parameters {
        let key = motion.at(frame);
        let solver = &simulator.solver;
        let mut parameters = solver.rest_parameters();
        let mut actuation = vec![0.0; 6 * self.body.samples.count()];
        let mut theta: JointParameters = [0.0; 5];
        for mover in &self.movers {
            let weight = key.weights.get(&mover.name).copied().unwrap_or(0.0);
            if weight == 0.0 {
                continue;
            }
            let all = actuation.iter_mut().zip(&mover.actuation);
            all.for_each(|(sum, b)| *sum += weight as f32 * b);
            for (sum, joint) in theta.iter_mut().zip(mover.joint.iter().flatten()) {
                *sum += weight * joint;
            }
        }
        set_actuation(&mut parameters, &actuation);
        if let Some(hanging) = &simulator.hanging {
            hanging.place(theta, &mut parameters);
        }
        apply_key(scene, &key, &mut parameters);
        parameters
    }
}

/// Moves what is held and what is touched, and scales the loads of each kind of effect.
pub(crate) fn apply_key(scene: &Scene, key: &Key, parameters: &mut Parameters) {
    for x in &mut parameters.prescribed {
        *x = key.held.apply(x);
    }
    for x in &mut parameters.obstacles {
        *x = key.obstacles.apply(x);
    }
    let mut weights = parameters.acceleration.iter_mut();
    let mut forces = parameters.forces.iter_mut();
    let mut pressures = parameters.pressures.iter_mut();
    for effect in &scene.effects {
        let factor = key.loads.get(effect.kind()).copied().unwrap_or(1.0);
        match effect {
            EffectSpec::Gravity { .. } => weights.next().into_iter().for_each(|g| *g *= factor),
            EffectSpec::Force { .. } | EffectSpec::Wind { .. } => {
                forces.next().into_iter().for_each(|f| *f *= factor);
            }
            EffectSpec::Pressure { .. } => pressures.next().into_iter().for_each(|p| *p *= factor),
            _ => {}
        }
    }
}

fn muscles(motion: &MotionSettings, body: &Body) -> Result<Vec<Mover>> {
    let points = body.mesh.sample_positions();
    let mut movers = Vec::new();
    for muscle in &motion.muscles {
        let inside = match &muscle.region {
            Some(region) => selected(region, &points, body, &muscle.name)?,
            None => vec![true; points.len()],
        };
        let b = muscle.b.map(|b| b as f32);
        let rows = inside
            .into_iter()
            .map(|inside| if inside { b } else { [0.0; 6] });
        movers.push(Mover {
            name: muscle.name.clone(),
            actuation: rows.flatten().collect(),
            joint: None,
        });
    }
    Ok(movers)
}

/// Which points a region holds; none at all is an error.
fn selected(
    region: &NodeRegion,
    points: &[Vector3<f64>],
    body: &Body,
    name: &str,
) -> Result<Vec<bool>> {
    let mesh_error = |source| TrainerError::Mesh {
        name: format!("motion: `{name}`"),
        source,
    };
    let inside = region
        .contains(points, body.mesh.element_size())
        .map_err(mesh_error)?;
    match inside.contains(&true) {
        true => Ok(inside),
        false => Err(TrainerError::EmptyPart {
            name: name.to_string(),
        }),
    }
}

fn names<'a>(all: impl Iterator<Item = &'a String>) -> String {
    all.map(String::as_str).collect::<Vec<_>>().join(", ")
}

fn unknown(path: &Path, name: &str, known: &str) -> TrainerError {
    TrainerError::UnknownMover {
        path: path.to_path_buf(),
        name: name.to_string(),
        hint: suggestion(name, known),
        known: known.to_string(),
    }
}

#[cfg(test)]
mod tests;
