//! From the network's answer to an equilibrium, and back with a cotangent.

use crate::body::Body;
use crate::error::Result;
use crate::hanging::Hanging;
use crate::scene::Scene;
use actuation_net::{ACTUATION_SIZE, JOINT_SIZE, Output, OutputCotangent};
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
    /// Rows of the network's answer.
    rows: usize,
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
        let solver = body.solver(scene)?;
        let hanging = Hanging::new(body, &scene.effects, &solver);
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
            rows: answer.actuation.len() / ACTUATION_SIZE,
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
        let shared = gradient.actuation.len() / at.rows;
        let actuation = gradient.actuation.chunks_exact(shared).flat_map(|samples| {
            let sum = |i: usize| samples.iter().map(|row| row[i]).sum::<f64>();
            std::array::from_fn::<_, ACTUATION_SIZE, _>(|i| sum(i) as f32)
        });
        let joint = self.hanging.as_ref().zip(at.theta);
        let bar = OutputCotangent {
            actuation: actuation.collect(),
            joint: joint.map_or([0.0; JOINT_SIZE], |(hanging, theta)| {
                hanging.vjp(theta, &gradient)
            }),
        };
        Ok(Ok((bar, adjoint.stats)))
    }
}

/// Puts the network's answer, `[n, 6]`, into a solver's parameters: for each sample, or for each element, whose samples then share it.
pub fn set_actuation(parameters: &mut Parameters, actuation: &[f32]) {
    let rows = actuation.chunks_exact(ACTUATION_SIZE);
    let shared = parameters.actuation.len() / rows.len();
    for (out, row) in parameters.actuation.chunks_exact_mut(shared).zip(rows) {
        out.fill(std::array::from_fn(|i| f64::from(row[i])));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;
    use crate::rig::Rig;
    use pd_solver::Stop;

    /// An element whose samples share one actuation: asked for once, and its cotangent is the slope through re-solved equilibria.
    #[test]
    fn elements_with_one_actuation_have_the_gradient_of_it() {
        let text = fixture::SCENE.replace("[mesh]", "[mesh]\nactuation = \"element\"");
        let scene = Scene::parse(&text, std::path::Path::new("ball.toml")).unwrap();
        let surface = fixture::inputs().surface;
        let body = Body::of_scene(&scene, surface, &Rig::default(), 0.4).unwrap();
        let elements = body.mesh.elements().len();
        assert_eq!(body.actuated().count(), elements);
        assert_eq!(body.samples.count(), 8 * elements);

        let mut simulator = Simulator::new(&body, &scene).unwrap();
        let rows = 0..elements * ACTUATION_SIZE;
        let answer = Output {
            actuation: rows.map(|i| 0.2 * (i as f32).sin()).collect(),
            joint: [0.0; JOINT_SIZE],
        };
        let options = SolveOptions::new(Stop::Accuracy(1e-9));
        let at = simulator.equilibrium(&answer, None, &options).unwrap();
        let nodes = 0..body.mesh.nodes().len();
        let bar = nodes.map(|n| Vector3::new(1.0, (n as f64).cos(), -0.5));
        let bar: Vec<Vector3<f64>> = bar.collect();
        let cotangent = simulator.cotangent(&at, &bar, 1e-9).unwrap();
        let (cotangent, _) = cotangent.unwrap();
        assert_eq!(cotangent.actuation.len(), elements * ACTUATION_SIZE);
        for entry in [1, 6 * (elements / 2), 6 * elements - 2] {
            let mut at = |step: f32| {
                let mut moved = answer.clone();
                moved.actuation[entry] += step;
                let step = f64::from(moved.actuation[entry] - answer.actuation[entry]);
                let reached = simulator.equilibrium(&moved, None, &options).unwrap();
                let positions = &reached.solution.positions;
                let value: f64 = positions.iter().zip(&bar).map(|(x, b)| x.dot(b)).sum();
                (step, value)
            };
            let ((up, high), (down, low)) = (at(1e-3), at(-1e-3));
            let slope = (high - low) / (up - down);
            let own = f64::from(cotangent.actuation[entry]);
            assert!(
                (slope - own).abs() < 1e-4 * (1.0 + own.abs()),
                "{slope} {own}"
            );
        }
    }
}
