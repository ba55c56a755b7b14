//! From the network's answer to an equilibrium, and back with a cotangent.

use crate::body::Body;
use crate::error::Result;
use crate::hanging::Hanging;
use crate::scene::Scene;
use actuation_net::{JOINT_SIZE, Output, OutputCotangent};
use face_rig::JointParameters;
use nalgebra::Vector3;
use pd_solver::{
    AdjointOptions, AdjointStats, AdjointStatus, Parameters, Solution, SolveOptions, Solver,
};

/// The solver of a scene on a body, and what hangs on the joint there.
pub struct Simulator {
    /// The solver.
    pub solver: Solver,
    /// What hangs on the joint.
    pub hanging: Option<Hanging>,
}

/// Where a body came to rest under one answer of the network.
pub struct Equilibrium {
    /// What the solver was given.
    pub parameters: Parameters,
    /// What the joint does, where something hangs on it.
    pub theta: Option<JointParameters>,
    /// What the solver found; look at its status.
    pub solution: Solution,
}

impl Simulator {
    /// Builds the solver.
    ///
    /// # Errors
    /// When the effects do not fit the body.
    pub fn new(body: &Body, scene: &Scene) -> Result<Self> {
        let solver = Solver::new(&body.mesh, &body.effects(scene)?)?;
        let hanging = Hanging::new(body, &solver);
        Ok(Self { solver, hanging })
    }

    /// The solver's parameters for an answer of the network, and what the joint does.
    pub fn parameters(&self, answer: &Output) -> (Parameters, Option<JointParameters>) {
        let mut parameters = self.solver.rest_parameters();
        set_actuation(&mut parameters, &answer.actuation);
        let hanging = self.hanging.as_ref();
        let theta = hanging.map(|hanging| hanging.drive(&answer.joint, &mut parameters));
        (parameters, theta)
    }

    /// The equilibrium under an answer of the network, from rest or from node positions given.
    ///
    /// # Errors
    /// When something does not fit or is not finite.
    pub fn equilibrium(
        &mut self,
        answer: &Output,
        start: Option<&[Vector3<f64>]>,
        options: &SolveOptions,
    ) -> Result<Equilibrium> {
        let (parameters, theta) = self.parameters(answer);
        let solution = self.solver.solve(&parameters, start, options)?;
        Ok(Equilibrium {
            parameters,
            theta,
            solution,
        })
    }

    /// The cotangent of the network's answer from that of the positions of the nodes; the reason where there is none.
    ///
    /// # Errors
    /// When something does not fit.
    pub fn cotangent(
        &mut self,
        at: &Equilibrium,
        node_bar: &[Vector3<f64>],
        tolerance: f64,
    ) -> Result<std::result::Result<(OutputCotangent, AdjointStats), AdjointStatus>> {
        let options = AdjointOptions {
            tolerance,
            ..AdjointOptions::default()
        };
        let adjoint = self
            .solver
            .adjoint(&at.parameters, &at.solution, node_bar, &options)?;
        let Some(gradient) = adjoint.gradient.filter(|_| adjoint.status.is_converged()) else {
            return Ok(Err(adjoint.status));
        };
        let actuation = gradient.actuation.iter().flatten().map(|&x| x as f32);
        let joint = self.hanging.as_ref().zip(at.theta);
        let bar = OutputCotangent {
            actuation: actuation.collect(),
            joint: joint.map_or([0.0; JOINT_SIZE], |(hanging, theta)| {
                hanging.vjp(theta, &gradient.prescribed)
            }),
        };
        Ok(Ok((bar, adjoint.stats)))
    }
}

/// Puts the network's answer, `[samples, 6]`, into a solver's parameters.
pub fn set_actuation(parameters: &mut Parameters, actuation: &[f32]) {
    let rows = actuation.chunks_exact(6);
    for (out, row) in parameters.actuation.iter_mut().zip(rows) {
        *out = std::array::from_fn(|i| f64::from(row[i]));
    }
}
