//! Stage 2: through the simulator. Network, equilibrium, loss on the surface, and the exact gradient back.

use crate::actuator::{Actuator, Reverse, Samples};
use crate::body::Body;
use crate::draw;
use crate::error::Result;
use crate::hanging::Hanging;
use crate::loss::{Loss, distances};
use crate::scene::{Scene, Stage2};
use crate::shapes::Shape;
use crate::stage1::Regression;
use actuation_net::{Adam, AdamState, JOINT_SIZE};
use nalgebra::Vector3;
use pd_solver::{
    AdjointOptions, AdjointStats, Parameters, SolveOptions, SolveStats, Solver, Status, Stop,
};

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
    /// The solver.
    pub solver: Solver,
    /// What hangs on the joint.
    pub hanging: Option<Hanging>,
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
        let mut parameters = self.solver.rest_parameters();
        set_actuation(&mut parameters, &traced.output().actuation);
        let hanging = self.hanging.as_ref();
        let theta = hanging.map(|hanging| hanging.drive(&traced.output().joint, &mut parameters));
        let options = SolveOptions::new(Stop::Accuracy(settings.accuracy * self.body.diagonal));
        let solution = self
            .solver
            .solve(&parameters, Some(&warm[shape]), &options)?;
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
        let options = AdjointOptions {
            tolerance: settings.adjoint_tolerance,
            ..AdjointOptions::default()
        };
        let adjoint = self
            .solver
            .adjoint(&parameters, &solution, &node_bar, &options)?;
        let Some(gradient) = adjoint.gradient.filter(|_| adjoint.status.is_converged()) else {
            let reason = format!(
                "{}: the adjoint is {:?}",
                self.shapes[shape].name, adjoint.status
            );
            return Ok(Outcome::Dropped(reason));
        };
        let actuation_bar: Vec<f32> = gradient
            .actuation
            .iter()
            .flatten()
            .map(|&x| x as f32)
            .collect();
        let mut joint_bar = [0.0; JOINT_SIZE];
        if let Some((hanging, theta)) = hanging.zip(theta) {
            let through_body = hanging.vjp(theta, &gradient.prescribed);
            joint_bar = through_body;
            if let Some(wanted) = self.shapes[shape].joint {
                let weight = self.scene.loss.jaw_weight;
                let (more, known) = hanging.misfit(theta, wanted, weight);
                value += more;
                joint_bar
                    .iter_mut()
                    .zip(known)
                    .for_each(|(bar, b)| *bar += b);
            }
        }
        let mut gradient = traced.backward(&actuation_bar, &joint_bar);
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
        let reached = self.body.surface_positions(&solution.positions);
        let (mean_error, _, _) = distances(&reached, target);
        warm[shape] = solution.positions;
        Ok(Outcome::Stepped(Box::new(Step {
            shape,
            loss: value,
            mean_error,
            forward: solution.stats,
            adjoint: adjoint.stats,
        })))
    }
}

/// Puts the network's answer, `[samples, 6]`, into a solver's parameters.
pub fn set_actuation(parameters: &mut Parameters, actuation: &[f32]) {
    let rows = actuation.chunks_exact(6);
    for (out, row) in parameters.actuation.iter_mut().zip(rows) {
        *out = std::array::from_fn(|i| f64::from(row[i]));
    }
}
