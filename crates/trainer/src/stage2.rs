//! Stage 2: through the simulator. Network, equilibrium, loss on the surface, and the exact gradient back.

use crate::actuator::{Actuator, Reverse, Samples};
use crate::body::Body;
use crate::draw;
use crate::error::Result;
use crate::loss::{Loss, distances};
use crate::scene::{Scene, Stage2};
use crate::shapes::Shape;
use crate::simulator::Simulator;
use crate::stage1::Regression;
use actuation_net::{Adam, AdamState};
use nalgebra::Vector3;
use pd_solver::{AdjointStats, SolveOptions, SolveStats, Status, Stop};

/// Superpositions learned along with one step.
const BLENDS_PER_STEP: usize = 2;

/// What one step through the simulator did.
pub struct Step {
    /// Which training shape.
    pub shape: usize,
    /// Loss before the step.
    pub loss: f64,
    /// Mean distance from the target, in scene units, before the step.
    pub mean_error: f64,
    /// Work of the forward solve.
    pub forward: SolveStats,
    /// Work of the adjoint.
    pub adjoint: AdjointStats,
}

/// What came of a step.
pub enum Outcome {
    /// The parameters moved.
    Stepped(Box<Step>),
    /// Nothing changed, for this reason.
    Dropped(String),
}

/// Everything that stays the same between steps.
pub struct ThroughSimulator<'a> {
    /// The body.
    pub body: &'a Body,
    /// The scene.
    pub scene: &'a Scene,
    /// Training shapes.
    pub shapes: &'a [&'a Shape],
    /// Their descriptors.
    pub descriptors: &'a [Vec<f32>],
    /// The solver and what hangs on the joint.
    pub simulator: Simulator,
    /// Superpositions that are learned along, where the scene wants it.
    pub blends: Option<&'a Regression<'a>>,
}

/// Steps of the whole stage.
pub fn steps(settings: &Stage2, shapes: usize) -> u64 {
    (settings.epochs * shapes) as u64
}

impl ThroughSimulator<'_> {
    /// Does step number `step`: one shape, started from where it was at its last visit.
    ///
    /// # Errors
    /// When something does not fit; numbers that fail drop the step instead.
    pub fn step(
        &mut self,
        net: &mut impl Actuator,
        adam: &mut AdamState,
        warm: &mut [Vec<Vector3<f64>>],
        step: u64,
    ) -> Result<Outcome> {
        let settings = &self.scene.stage2;
        let count = self.shapes.len() as u64;
        let order = draw::order(
            &mut draw::generator(self.scene.seed, 3, step / count),
            self.shapes.len(),
        );
        let shape = order[(step % count) as usize];
        let samples = Samples::all(&self.body.points);
        let traced = match net.trace(&self.descriptors[shape], &samples) {
            Ok(traced) => traced,
            Err(error) => return Ok(Outcome::Dropped(error.to_string())),
        };
        let options = SolveOptions::new(Stop::Accuracy(settings.accuracy * self.body.diagonal));
        let start = Some(warm[shape].as_slice());
        let reached = self
            .simulator
            .equilibrium(traced.output(), start, &options)?;
        let solution = &reached.solution;
        if solution.status != Status::Converged {
            let reason = format!(
                "{}: the equilibrium is {:?}",
                self.shapes[shape].name, solution.status
            );
            return Ok(Outcome::Dropped(reason));
        }
        let target = &self.shapes[shape].positions;
        let loss = Loss::new(self.body, target, &self.scene.loss);
        let (mut value, node_bar) = loss.nodes(&solution.positions);
        let tolerance = settings.adjoint_tolerance;
        let cotangent = self.simulator.cotangent(&reached, &node_bar, tolerance)?;
        let (mut bar, adjoint) = match cotangent {
            Ok(done) => done,
            Err(status) => {
                let reason = format!("{}: the adjoint is {status:?}", self.shapes[shape].name);
                return Ok(Outcome::Dropped(reason));
            }
        };
        let hanging = self.simulator.hanging.as_ref().zip(reached.theta);
        if let Some(((hanging, theta), wanted)) = hanging.zip(self.shapes[shape].joint) {
            let (more, known) = hanging.misfit(theta, wanted, self.scene.loss.jaw_weight);
            value += more;
            bar.joint.iter_mut().zip(known).for_each(|(a, b)| *a += b);
        }
        let mut gradient = traced.backward(&bar.actuation, &bar.joint);
        if let Some(blends) = &self.blends {
            let mut generator = draw::generator(self.scene.seed, 5, step);
            let weight = settings.blend_weight / BLENDS_PER_STEP as f64;
            let (count, gradient) = (BLENDS_PER_STEP, &mut gradient);
            let added = blends.add_superpositions(net, count, &mut generator, weight, gradient);
            if let Err(error) = added {
                return Ok(Outcome::Dropped(error.to_string()));
            }
        }
        let lr = draw::decayed(
            settings.learning_rate,
            step,
            steps(settings, self.shapes.len()),
        );
        let adam_settings = Adam {
            lr,
            ..Adam::default()
        };
        if let Err(error) = adam_settings.step(adam, net.parameters_mut(), &gradient) {
            return Ok(Outcome::Dropped(error.to_string()));
        }
        let solution = reached.solution;
        let surface = self.body.surface_positions(&solution.positions);
        let (mean_error, _, _) = distances(&surface, target);
        warm[shape] = solution.positions;
        Ok(Outcome::Stepped(Box::new(Step {
            shape,
            loss: value,
            mean_error,
            forward: solution.stats,
            adjoint,
        })))
    }
}
