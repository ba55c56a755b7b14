//! Frames that follow one another in time, or whose held parts are moved by keys.

use crate::actuator::{Actuator, Samples};
use crate::body::Body;
use crate::dynamics::Dynamics;
use crate::error::Result;
use crate::evaluate::{Evaluator, ShapeResult};
use crate::scene::Scene;
use crate::shapes::Shape;
use crate::simulate::apply_key;
use crate::simulator::Simulator;
use nalgebra::Vector3;
use pd_solver::Parameters;

/// A performance on its way through time.
pub(super) struct Moving<'a> {
    body: &'a Body,
    scene: &'a Scene,
    rate: f64,
    /// From the second frame on, where there is inertia.
    dynamics: Option<Dynamics>,
}

impl<'a> Moving<'a> {
    /// `None` where every frame is an equilibrium by itself and nothing else moves.
    pub(super) fn new(body: &'a Body, scene: &'a Scene, rate: f64) -> Option<Self> {
        let timed = scene.effects.iter().any(|e| e.kind() == "inertia");
        (timed || scene.motion.is_some()).then_some(Self {
            body,
            scene,
            rate,
            dynamics: None,
        })
    }

    /// The next frame, `number` from 1; the first one is at rest, the others begin at `previous` or where the body is on its way.
    pub(super) fn frame(
        &mut self,
        evaluator: &mut Evaluator,
        net: &impl Actuator,
        (shape, descriptor): (&Shape, Vec<f32>),
        number: usize,
        previous: Option<&[Vector3<f64>]>,
    ) -> Result<ShapeResult> {
        let clock = std::time::Instant::now();
        let output = net.evaluate(&descriptor, &Samples::all(self.body.actuated()))?;
        let options = evaluator.options();
        let simulator = evaluator.simulator();
        let (mut parameters, theta) = simulator.parameters(&output);
        self.apply(number, self.scene, &mut parameters);
        let solution = match &mut self.dynamics {
            Some(dynamics) => dynamics.frame(&mut simulator.solver, &parameters, &options)?,
            None if simulator.solver.time_step_length().is_some() => {
                let scene = self.scene.still();
                let mut still = Simulator::new(self.body, &scene)?;
                let (mut at, _) = still.parameters(&output);
                self.apply(number, &scene, &mut at);
                let solution = still.solver.solve(&at, None, &options)?;
                let start = solution.positions.clone();
                let solver = &simulator.solver;
                self.dynamics = Some(Dynamics::new(solver, start, parameters, self.rate)?);
                solution
            }
            None => simulator.solver.solve(&parameters, previous, &options)?,
        };
        evaluator.result(shape, descriptor, solution, theta, clock)
    }

    fn apply(&self, number: usize, scene: &Scene, parameters: &mut Parameters) {
        if let Some(motion) = &self.scene.motion {
            apply_key(scene, &motion.at(number), parameters);
        }
    }
}
