//! Training from a scene to a finished run, resumable at any step.

use crate::body::Body;
use crate::checkpoint::{Checkpoint, RunningMean, Stage, StageError};
use crate::error::{Result, TrainerError};
use crate::evaluate::{self, Evaluator, ShapeResult};
use crate::failures::Failures;
use crate::files::create_folder;
use crate::focus::Focus;
use crate::progress::{Phase, note, stop_requested};
use crate::rig::Rig;
use crate::run::{Metrics, Run};
use crate::scene::Scene;
use crate::shapes::{Shape, Shapes};
use crate::stage1::{self, Pulled, Regression};
use crate::stage2::{self, Outcome, Step, ThroughSimulator};
use crate::table::mean_of;
use actuation_net::{ActuationNet, AdamState, NetworkConfig};
use serde_json::json;
use std::path::Path;
use std::time::Instant;
use surface_mesh::{MorphTarget, MorphedSurface};

/// What a finished training shows.
pub struct Trained {
    /// All shapes, simulated after training.
    pub results: Vec<ShapeResult>,
    /// Errors of the training shapes after stage 1.
    pub stage1: Vec<StageError>,
    /// Seconds of training, all sessions together.
    pub seconds: f64,
    /// Steps that were dropped because they failed, in both stages.
    pub dropped: u64,
    /// Length of the bounding box's diagonal.
    pub diagonal: f64,
}

/// The network that a scene asks for.
pub fn network_config(scene: &Scene, shapes: &Shapes) -> NetworkConfig {
    NetworkConfig {
        descriptor: shapes.descriptor_size(),
        width: scene.network.width,
        latent: scene.network.latent,
        omega: scene.network.omega,
        resolution: None,
    }
}

/// Checks what a training run will need before a folder is made for it: that the surface can be meshed, that the scene's shapes,
/// effects and network fit it, and that there is something to train on.
///
/// # Errors
/// When something does not fit; `path` is the scene file.
pub fn check(scene: &Scene, path: &Path, inputs: &MorphedSurface, rig: &Rig) -> Result<()> {
    let is_held_out = |target: &MorphTarget| scene.shapes.held_out.contains(&target.name);
    if inputs.targets.iter().all(is_held_out) {
        return Err(TrainerError::SceneValue {
            path: path.to_path_buf(),
            key: "shapes.held_out",
            value: "every shape".into(),
            mend: "leave at least one shape to train on",
        });
    }
    let surface = inputs.surface.clone();
    let body = Body::of_scene(scene, surface, rig, scene.mesh.element_size)?;
    let shapes = Shapes::new(scene, inputs, rig.jaw.as_ref(), &body.vertex_weights)?;
    network_config(scene, &shapes).validate()?;
    if scene.effects.iter().any(|e| e.kind() == "inertia") {
        return Err(TrainerError::SceneValue {
            path: path.to_path_buf(),
            key: "effects",
            value: "with `inertia`".into(),
            mend: "training finds shapes at rest: give inertia to `eval --dynamics --effects FILE`, or `simulate` the scene",
        });
    }
    body.solver(scene)?;
    Ok(())
}

/// Trains a run from where it stands to its end, evaluates it, and writes everything into its folder.
///
/// # Errors
/// When something does not fit, training diverges, the output cannot be written, or the user stops; the last checkpoint then
/// holds the state.
pub fn train(run: &Run) -> Result<Trained> {
    finish(run).map_err(|error| error.of_unfinished(run.folder()))
}

fn finish(run: &Run) -> Result<Trained> {
    let scene = run.scene()?;
    let inputs = run.inputs()?;
    let rig = run.rig()?;
    let surface = inputs.surface.clone();
    let body = Body::of_scene(&scene, surface, &rig, scene.mesh.element_size)?;
    eprintln!(
        "{:>12} {}",
        "body",
        body.report.to_string().replace('\n', "\n             ")
    );
    tell_bones(&body, &rig, &scene.unit);
    let shapes = Shapes::new(&scene, &inputs, rig.jaw.as_ref(), &body.vertex_weights)?;
    let config = network_config(&scene, &shapes);
    let mut state = if run.checkpoint_path().exists() {
        Checkpoint::read(run, &config)?
    } else {
        let net = ActuationNet::new(&config, scene.seed)?;
        Checkpoint {
            stage: Stage::One,
            step: 0,
            dropped: 0,
            metrics_length: 0,
            seconds: 0.0,
            epoch_loss: RunningMean::default(),
            stage1_errors: Vec::new(),
            adam: AdamState::new(net.parameter_count()),
            net,
            warm: Vec::new(),
        }
    };
    let training = shapes.training();
    check_fit(&state, run, &body, training.len())?;
    if state.stage == Stage::Done && state.step < stage2::steps(&scene.stage2, training.len()) {
        note(
            "the run was at its end, but its scene.toml asks for more epochs by now: stage 2 goes on",
        );
        state.stage = Stage::Two;
    }
    let metrics = Metrics::open(run, state.metrics_length)?;
    let mut session = Session {
        run,
        scene: &scene,
        body: &body,
        state,
        metrics,
        started: Instant::now(),
        last_checkpoint: Instant::now(),
        failures: Failures::default(),
    };
    let descriptors = training.iter().map(|s| shapes.descriptor(&s.positions));
    let descriptors: Vec<Vec<f32>> = descriptors.collect::<Result<_>>()?;
    if session.state.stage != Stage::Done {
        // Stage 2 without superpositions has no use for them.
        let is_pulled = session.state.stage == Stage::One || scene.stage2.blend_weight > 0.0;
        let pulled = match is_pulled {
            true => stage1::pull(&body, &scene, &training, || session.check_stop())?,
            false => Vec::new(),
        };
        let regression = Regression {
            points: &body.samples,
            descriptors: &descriptors,
            targets: &pulled,
            basis: &shapes.basis_in_training(),
            focus: &Focus::new(&pulled, scene.stage1.focus, scene.stage1.balance),
            settings: &scene.stage1,
            seed: scene.seed,
        };
        if session.state.stage == Stage::One {
            session.stage1(&regression, &training, &descriptors)?;
        }
        session.stage2(&regression, &training, &descriptors)?;
    }
    let state = session.state;
    let results = evaluate::simulate(&scene, &body, &shapes, &state.net, &shapes.all);
    let results = results.map_err(|error| match error {
        TrainerError::EvaluationStopped => interrupted(run),
        other => other,
    })?;
    let folder = create_folder(&run.evaluation_folder())?;
    evaluate::write(&folder, &scene, &body, &results)?;
    crate::sheets::write_losses(run)?;
    Ok(Trained {
        results,
        stage1: state.stage1_errors,
        seconds: state.seconds,
        dropped: state.dropped,
        diagonal: body.diagonal,
    })
}

/// Says what the bones hold and where the jaw turns.
fn tell_bones(body: &Body, rig: &Rig, unit: &str) {
    if rig.bones.is_empty() {
        return;
    }
    let names: Vec<&str> = rig.bones.iter().map(|b| b.name.as_str()).collect();
    let (fixed, moved) = (body.fixed_nodes.len(), body.moved_nodes.len());
    eprintln!(
        "{:>12} {}: {fixed} nodes held, {moved} nodes on the joint",
        "bones",
        names.join(", ")
    );
    let on_bone = body.vertices_on_bone();
    if let Some(&first) = on_bone.first() {
        let place = body.surface.vertices()[first];
        note(&format!(
            "{} of {} vertices of the surface cannot move by themselves, as vertex {first} at ({:.3}, {:.3}, {:.3}): bones hold all that is under \
             them. Smaller elements put flesh between",
            on_bone.len(),
            body.surface.vertex_count(),
            place.x,
            place.y,
            place.z
        ));
    }
    if let Some(jaw) = &rig.jaw {
        let [x, y, z] = jaw.pivot;
        eprintln!(
            "{:>12} turns about ({x:.3}, {y:.3}, {z:.3}) {unit}; {} motions known, which the joint follows to {:.3} degrees and {:.4} {unit}",
            "jaw",
            jaw.shapes.len(),
            jaw.residual_angle.to_degrees(),
            jaw.residual_max
        );
    }
}

/// A checkpoint knows its network; whether its positions are those of this body and these shapes shows here.
fn check_fit(state: &Checkpoint, run: &Run, body: &Body, shapes: usize) -> Result<()> {
    let nodes = body.mesh.nodes().len();
    let is_new = state.stage == Stage::One && state.warm.is_empty();
    if is_new || state.warm.len() == shapes && state.warm.iter().all(|x| x.len() == nodes) {
        return Ok(());
    }
    let held = state.warm.first().map_or(0, Vec::len);
    Err(TrainerError::Checkpoint {
        path: run.checkpoint_path(),
        problem: format!(
            "holds {} shapes of {held} nodes, but the run's scene has {shapes} of {nodes}: undo what was changed in scene.toml, or train \
             the changed scene into a new folder",
            state.warm.len()
        ),
    })
}

fn interrupted(run: &Run) -> TrainerError {
    TrainerError::Interrupted {
        run: run.folder().to_path_buf(),
    }
}

/// One process working on a run.
struct Session<'a> {
    run: &'a Run,
    scene: &'a Scene,
    body: &'a Body,
    state: Checkpoint,
    metrics: Metrics,
    started: Instant,
    last_checkpoint: Instant,
    failures: Failures,
}

impl Session<'_> {
    fn save(&mut self) -> Result<()> {
        // First: a checkpoint must not know of lines that a power cut takes away.
        self.metrics.sync()?;
        self.state.metrics_length = self.metrics.length();
        self.state.seconds += self.started.elapsed().as_secs_f64();
        self.started = Instant::now();
        self.last_checkpoint = Instant::now();
        self.state.write(self.run)
    }

    /// Ends the work when the user wants to stop and there is nothing to save yet.
    fn check_stop(&self) -> Result<()> {
        match stop_requested() {
            true => Err(interrupted(self.run)),
            false => Ok(()),
        }
    }

    /// Saves now and then, and when the user wants to stop; not while steps fail, see [`Session::drop_step`].
    fn between_steps(&mut self) -> Result<()> {
        let is_good = self.failures.count() == 0;
        if stop_requested() {
            if is_good {
                self.save()?;
            }
            return Err(interrupted(self.run));
        }
        if is_good && self.last_checkpoint.elapsed().as_secs_f64() >= self.scene.checkpoint_seconds
        {
            self.save()?;
        }
        Ok(())
    }

    /// Tells of a step that failed and changed nothing but the count of steps; too many in a row end training.
    ///
    /// Before the first of them the state is saved, and then not until one comes through: what is resumed is the last good state, the
    /// failed steps are tried and counted again, and a run that was killed among them ends as one undisturbed.
    fn drop_step(&mut self, stage: u8, reason: &str) -> Result<()> {
        if self.failures.count() == 0 {
            self.save()?;
        }
        let step = self.state.step;
        let line = json!({ "stage": stage, "step": step, "dropped": reason });
        self.metrics.append(&line)?;
        note(&format!("stage {stage}, step {step} is dropped: {reason}"));
        self.state.dropped += 1;
        match self.failures.add() {
            None => Ok(()),
            Some(count) => Err(TrainerError::Diverged {
                count,
                stage,
                reason: reason.to_string(),
                checkpoint: self.run.checkpoint_path(),
            }),
        }
    }

    fn stage1(
        &mut self,
        regression: &Regression,
        training: &[&Shape],
        descriptors: &[Vec<f32>],
    ) -> Result<()> {
        if self.state.warm.is_empty() {
            let nodes = regression.targets.iter().map(|p| p.nodes.clone());
            self.state.warm = nodes.collect();
            self.save()?;
        }
        self.regress(regression)?;
        self.measure_stage1(training, descriptors, regression.targets)?;
        self.state.stage = Stage::Two;
        self.state.step = 0;
        self.state.adam = AdamState::new(self.state.net.parameter_count());
        self.save()
    }

    fn regress(&mut self, regression: &Regression) -> Result<()> {
        let shapes = regression.descriptors.len();
        let steps = stage1::steps(regression.settings, shapes);
        let per_epoch = shapes.div_ceil(regression.settings.batch) as u64;
        let mut phase = Phase::new("stage 1", steps, self.state.step);
        while self.state.step < steps {
            let step = self.state.step;
            match regression.step(&mut self.state.net, &mut self.state.adam, step) {
                Ok(loss) => {
                    self.failures.end();
                    self.state.epoch_loss.add(loss);
                    phase.step(|| format!("loss {loss:.2e}"));
                }
                Err(reason) => {
                    self.drop_step(1, &reason)?;
                    phase.step(|| "dropped".to_string());
                }
            }
            self.state.step += 1;
            if self.state.step.is_multiple_of(per_epoch)
                && let Some(loss) = self.state.epoch_loss.take()
            {
                let epoch = self.state.step / per_epoch;
                let line = json!({ "stage": 1, "epoch": epoch, "loss": loss });
                self.metrics.append(&line)?;
            }
            self.between_steps()?;
        }
        // A run that is resumed behind this does not know of them.
        self.failures.end();
        phase.finish(&format!("{steps} steps"));
        Ok(())
    }

    /// Simulates the training shapes with what stage 1 learned: the errors that stage 2 has to beat, and its first starts.
    fn measure_stage1(
        &mut self,
        training: &[&Shape],
        descriptors: &[Vec<f32>],
        pulled: &[Pulled],
    ) -> Result<()> {
        let mut evaluator = Evaluator::new(self.body, self.scene)?;
        let mut phase = Phase::new("check", training.len() as u64, 0);
        self.state.stage1_errors.clear();
        let mut warm = Vec::new();
        for ((shape, descriptor), pulled) in training.iter().zip(descriptors).zip(pulled) {
            let start = Some(pulled.nodes.as_slice());
            let result = evaluator.shape(&self.state.net, shape, descriptor.clone(), start)?;
            phase.step(|| format!("{} {:.3} %", shape.name, result.mean_error_percent));
            self.state.stage1_errors.push(StageError {
                name: shape.name.clone(),
                mean: result.mean_error,
                max: result.max_error,
            });
            warm.push(result.nodes);
            self.between_steps()?;
        }
        self.state.warm = warm;
        let mean = mean_of(self.state.stage1_errors.iter().map(|e| e.mean));
        phase.finish(&format!(
            "after stage 1 the mean error is {:.3} % of the diagonal",
            100.0 * mean / self.body.diagonal
        ));
        Ok(())
    }

    fn stage2(
        &mut self,
        regression: &Regression,
        training: &[&Shape],
        descriptors: &[Vec<f32>],
    ) -> Result<()> {
        let steps = stage2::steps(&self.scene.stage2, training.len());
        let mut simulator = ThroughSimulator::new(self.body, self.scene, training, descriptors)?
            .with_blends(regression);
        let percent = 100.0 / self.body.diagonal;
        let mut phase = Phase::new("stage 2", steps, self.state.step);
        while self.state.step < steps {
            let state = &mut self.state;
            let step = state.step;
            match simulator.step(&mut state.net, &mut state.adam, &mut state.warm, step)? {
                Outcome::Stepped(done) => {
                    self.failures.end();
                    let line = stage2_line(step, &done, training, percent);
                    self.metrics.append(&line)?;
                    phase.step(|| {
                        let error = done.mean_error * percent;
                        format!("loss {:.2e}, error {error:.3} %", done.loss)
                    });
                }
                Outcome::Dropped(reason) => {
                    self.drop_step(2, &reason)?;
                    phase.step(|| "dropped".to_string());
                }
            }
            self.state.step += 1;
            self.between_steps()?;
        }
        phase.finish(&format!("{steps} steps, {} dropped", self.state.dropped));
        self.state.net.save(self.run.model_path())?;
        self.state.stage = Stage::Done;
        self.save()
    }
}

/// What the metrics keep of a step of stage 2.
fn stage2_line(step: u64, done: &Step, training: &[&Shape], percent: f64) -> serde_json::Value {
    json!({
        "stage": 2, "step": step, "epoch": (step + 1) as f64 / training.len() as f64,
        "shape": training[done.shape].name, "loss": done.loss,
        "mean_error": done.mean_error,
        "mean_error_percent": done.mean_error * percent,
        "iterations": done.forward.iterations,
        "adjoint_iterations": done.adjoint.iterations,
        "negative_curvature": done.adjoint.negative_curvature,
        "forward_seconds": done.forward.seconds,
        "adjoint_seconds": done.adjoint.seconds,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;

    /// A user who finds a run wanting raises its epochs.
    #[test]
    fn a_run_at_its_end_goes_on_when_more_epochs_are_asked_for() {
        let folder = tempfile::tempdir().unwrap();
        let (inputs, rig) = (fixture::inputs(), crate::rig::Rig::default());
        let run = Run::create(folder.path(), fixture::SCENE, &inputs, &rig, None).unwrap();
        train(&run).unwrap();
        let steps = || {
            let text = std::fs::read_to_string(run.metrics_path()).unwrap();
            text.lines().filter(|l| l.contains("\"stage\":2")).count()
        };
        let before = steps();
        let mut scene = run.scene().unwrap();
        let per_epoch = before / scene.stage2.epochs;
        scene.stage2.epochs += 2;
        let text = toml::to_string(&scene).unwrap();
        std::fs::write(folder.path().join("scene.toml"), text).unwrap();
        train(&run).unwrap();
        assert_eq!(steps(), before + 2 * per_epoch);
    }

    /// A basis of its own leaves the network's size as it is: nothing but the positions tells that the scene was changed.
    #[test]
    fn a_run_whose_scene_was_changed_is_not_resumed() {
        let folder = tempfile::tempdir().unwrap();
        let run = Run::create(
            folder.path(),
            fixture::SCENE,
            &fixture::inputs(),
            &crate::rig::Rig::default(),
            None,
        )
        .unwrap();
        assert_eq!(train(&run).unwrap().results.len(), 3);
        for (from, to, expected) in [
            ("[mesh]", "held_out = [\"both\"]\n[mesh]", "holds 3 shapes"),
            (
                "element_size = 0.4",
                "element_size = 0.3",
                "train the changed scene",
            ),
        ] {
            let text = fixture::SCENE.replace(from, to);
            std::fs::write(folder.path().join("scene.toml"), text).unwrap();
            let message = train(&run).err().map(|e| e.to_string()).unwrap_or_default();
            assert!(message.contains(expected), "{message}");
        }
        std::fs::write(folder.path().join("scene.toml"), fixture::SCENE).unwrap();
        train(&run).unwrap();
    }
}
