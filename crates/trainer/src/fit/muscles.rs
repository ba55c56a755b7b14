//! The loss as a function of latent code and joint: network, equilibrium, surface, and the way back.

use super::search::Objective;
use super::target::Target;
use crate::body::Body;
use crate::error::{Result, TrainerError};
use crate::evaluate::Evaluator;
use crate::progress::stop_requested;
use crate::scene::{LossSettings, Scene};
use crate::simulator::Equilibrium;
use actuation_net::{ActuationNet, JOINT_SIZE, LatentTrace, Output};
use nalgebra::{DMatrix, DVector, Vector3};
use pd_solver::{Adjoint, AdjointOptions, Status};

/// Relative residual of the adjoint that gives the gradient.
const GRADIENT_TOLERANCE: f64 = 1e-4;
/// Relative residual of the linear solves behind the Gauss-Newton matrix, which only has to be about right.
const CURVATURE_TOLERANCE: f64 = 1e-2;
/// Linear solves that share one linearisation: their results are held at once.
const BATCH: usize = 8;
/// By how much a number of the code is varied for it, in units of the code.
const LATENT_VARIATION: f64 = 1e-2;
/// By how much a number of the joint's answer is varied: radians, or tenths of the diagonal.
const JOINT_VARIATION: f64 = 1e-3;

/// A body whose muscles and joint are moved directly.
pub struct Muscles<'a> {
    body: &'a Body,
    net: &'a ActuationNet,
    settings: &'a LossSettings,
    evaluator: Evaluator<'a>,
    target: &'a Target,
    has_joint: bool,
    /// What a variable of the code counts as 1.
    unit: f64,
    /// Equilibria found or tried.
    pub simulations: usize,
    /// Linear solves: of adjoints and for Gauss-Newton matrices.
    pub linear_solves: usize,
}

/// A state of the body.
pub struct State<'a> {
    /// The latent code.
    pub latent: Vec<f32>,
    /// The joint, in the numbers of the network's answer.
    pub joint: [f32; JOINT_SIZE],
    /// Where the body came to rest.
    pub equilibrium: Equilibrium,
    /// Positions of the surface's vertices.
    pub surface: Vec<Vector3<f64>>,
    /// The loss over the vertices that count here.
    pub value: f64,
    /// The loss over those that count where the search comes from: what counts does not change within a step.
    value_of_step: f64,
    /// What each vertex counts here.
    pub weights: Vec<f64>,
    node_bar: Vec<Vector3<f64>>,
    /// Until the gradient is taken.
    trace: Option<LatentTrace<'a>>,
}

impl<'a> Muscles<'a> {
    /// The muscles of a trained body that are to reach a target; `unit` is the size of differences between codes, which the search takes
    /// as 1.
    ///
    /// # Errors
    /// When the effects do not fit the body.
    pub fn new(
        body: &'a Body,
        scene: &'a Scene,
        net: &'a ActuationNet,
        target: &'a Target,
        unit: f64,
    ) -> Result<Self> {
        let mut evaluator = Evaluator::new(body, scene)?;
        Ok(Self {
            has_joint: evaluator.simulator().hanging.is_some(),
            unit,
            body,
            net,
            settings: &scene.loss,
            evaluator,
            target,
            simulations: 0,
            linear_solves: 0,
        })
    }

    /// The variables of a code and a joint: the joint has a part where something hangs on it.
    pub fn variables(&self, latent: &[f32], joint: &[f32; JOINT_SIZE]) -> DVector<f64> {
        let latent = latent.iter().map(|z| f64::from(*z) / self.unit);
        self.with_joint(latent, joint)
    }

    /// Numbers for the code and, where something hangs on it, for the joint.
    fn with_joint(
        &self,
        latent: impl Iterator<Item = f64>,
        joint: &[f32; JOINT_SIZE],
    ) -> DVector<f64> {
        let joint = self.has_joint.then_some(joint).into_iter().flatten();
        let all = latent.chain(joint.map(|x| f64::from(*x)));
        DVector::from_vec(all.collect())
    }

    /// Simulates from rest, or near another state. The result says how the solver ended; `None` where the network's answer is not finite.
    ///
    /// # Errors
    /// When something does not fit, and when the user stops.
    pub fn state(
        &mut self,
        x: &DVector<f64>,
        near: Option<&State<'a>>,
    ) -> Result<Option<State<'a>>> {
        if stop_requested() {
            return Err(TrainerError::EvaluationStopped);
        }
        let latent_size = self.net.config().latent;
        let latent: Vec<f32> = (x.iter().take(latent_size))
            .map(|x| (self.unit * x) as f32)
            .collect();
        let mut joint = [0.0; JOINT_SIZE];
        let own = x.iter().skip(latent_size);
        joint.iter_mut().zip(own).for_each(|(j, x)| *j = *x as f32);
        if !latent.iter().chain(&joint).all(|x| x.is_finite()) {
            return Ok(None);
        }
        let trace = match self
            .net
            .trace_latent(&latent, &self.body.actuated().coordinates)
        {
            Ok(trace) => trace,
            Err(actuation_net::Error::NonFiniteOutput { .. }) => return Ok(None),
            Err(error) => return Err(error.into()),
        };
        let actuation = trace.output().actuation.clone();
        let answer = Output { actuation, joint };
        self.simulations += 1;
        let start = near.map(|state| state.equilibrium.solution.positions.as_slice());
        let equilibrium = self.evaluator.equilibrium(&answer, start)?;
        let surface = self.body.surface_positions(&equilibrium.solution.positions);
        let aim = self.target.aim(self.body, &surface);
        let nodes = &equilibrium.solution.positions;
        let (value, node_bar) = aim.loss(self.settings, None).nodes(nodes);
        let value_of_step = near.map_or(value, |near| {
            let held = Some(near.weights.as_slice());
            aim.loss(self.settings, held).nodes(nodes).0
        });
        let weights = aim.weights().to_vec();
        Ok(Some(State {
            latent,
            joint,
            equilibrium,
            surface,
            value,
            value_of_step,
            weights,
            node_bar,
            trace: Some(trace),
        }))
    }

    /// The solver's parameters with one variable a little larger, and how much larger it is.
    fn varied(&mut self, state: &State, k: usize) -> Result<(pd_solver::Parameters, f64)> {
        let latent = &state.latent;
        let mut parameters = state.equilibrium.parameters.clone();
        if k < latent.len() {
            let mut moved = latent.clone();
            moved[k] += (LATENT_VARIATION * self.unit) as f32;
            let h = f64::from(moved[k] - latent[k]) / self.unit;
            let answer = self
                .net
                .evaluate_latent(&moved, &self.body.actuated().coordinates)?;
            crate::simulator::set_actuation(&mut parameters, &answer.actuation);
            return Ok((parameters, h));
        }
        let mut joint = state.joint;
        let place = k - latent.len();
        joint[place] += JOINT_VARIATION as f32;
        let h = f64::from(joint[place] - state.joint[place]);
        if let Some(hanging) = &self.evaluator.simulator().hanging {
            hanging.drive(&joint, &mut parameters);
        }
        Ok((parameters, h))
    }

    /// What one unit of each variable does to the surface's vertices, to first order: one linear solve each.
    ///
    /// At the equilibrium the gradient g(u, p) of the energy is zero at the free nodes, so H du = -(g(u, p + dp) - g(u, p)).
    fn effects(&mut self, state: &State) -> Result<Option<Vec<Vec<Vector3<f64>>>>> {
        let equilibrium = &state.equilibrium;
        let nodes = &equilibrium.solution.positions;
        let prescribed = self.evaluator.simulator().solver.prescribed().to_vec();
        let count = state.latent.len() + if self.has_joint { JOINT_SIZE } else { 0 };
        let solver = &mut self.evaluator.simulator().solver;
        let (_, at_rest) = solver.energy_gradient(&equilibrium.parameters, nodes)?;
        let options = AdjointOptions {
            tolerance: CURVATURE_TOLERANCE,
            ..AdjointOptions::default()
        };
        let mut effects = Vec::with_capacity(count);
        for first in (0..count).step_by(BATCH) {
            if stop_requested() {
                return Err(TrainerError::EvaluationStopped);
            }
            let batch = first..count.min(first + BATCH);
            let (mut forces, mut moves) = (Vec::new(), Vec::new());
            for k in batch {
                let (parameters, h) = self.varied(state, k)?;
                let mut moved = nodes.clone();
                for (&node, x) in prescribed.iter().zip(&parameters.prescribed) {
                    moved[node as usize] = *x;
                }
                let solver = &mut self.evaluator.simulator().solver;
                let (_, gradient) = solver.energy_gradient(&parameters, &moved)?;
                let force = gradient.iter().zip(&at_rest).map(|(a, b)| (b - a) / h);
                forces.push(force.collect::<Vec<_>>());
                let own = moved.iter().zip(nodes).map(|(a, b)| (a - b) / h);
                moves.push(own.collect::<Vec<_>>());
            }
            let mut solved = vec![Adjoint::default(); forces.len()];
            let views: Vec<&[Vector3<f64>]> = forces.iter().map(Vec::as_slice).collect();
            let solver = &mut self.evaluator.simulator().solver;
            solver.adjoints_into(
                &equilibrium.parameters,
                &equilibrium.solution,
                &views,
                &options,
                &mut solved,
            )?;
            self.linear_solves += solved.len();
            for (solved, moved) in solved.into_iter().zip(moves) {
                if !solved.status.is_converged() {
                    return Ok(None);
                }
                let free = moved.iter().zip(&solved.multiplier).map(|(a, b)| a + b);
                // The surface depends linearly on the nodes, but for its constant part.
                let displaced = free.zip(nodes).map(|(d, x)| x + d);
                let surface = self.body.surface_positions(&displaced.collect::<Vec<_>>());
                let effect = surface.iter().zip(&state.surface).map(|(a, b)| a - b);
                effects.push(effect.collect());
            }
        }
        Ok(Some(effects))
    }
}

impl<'a> Objective for Muscles<'a> {
    type Place = State<'a>;

    fn evaluate(&mut self, x: &DVector<f64>, near: &State<'a>) -> Result<Option<State<'a>>> {
        let state = self.state(x, Some(near))?;
        Ok(state.filter(|s| s.equilibrium.solution.status == Status::Converged))
    }

    fn value(&self, state: &State<'a>) -> f64 {
        state.value
    }

    fn lowered(&self, from: &State<'a>, to: &State<'a>) -> f64 {
        from.value - to.value_of_step
    }

    fn gradient(&mut self, state: &mut State<'a>) -> Result<Option<DVector<f64>>> {
        let Some(trace) = state.trace.take() else {
            return Ok(None);
        };
        let simulator = self.evaluator.simulator();
        let cotangent =
            simulator.cotangent(&state.equilibrium, &state.node_bar, GRADIENT_TOLERANCE)?;
        self.linear_solves += 1;
        let Ok((bar, _)) = cotangent else {
            return Ok(None);
        };
        // The joint is a variable of its own: nothing goes back through the bone network.
        let latent_bar = trace.backward(&bar.actuation, &[0.0; JOINT_SIZE]);
        let unit = self.unit;
        let latent_bar = latent_bar.iter().map(|z| f64::from(*z) * unit);
        let gradient = self.with_joint(latent_bar, &bar.joint);
        Ok(gradient.iter().all(|x| x.is_finite()).then_some(gradient))
    }

    fn curvature(&mut self, state: &State<'a>) -> Result<Option<DMatrix<f64>>> {
        let effects = self.effects(state)?;
        let matrix = effects.map(|effects| {
            let aim = self.target.aim(self.body, &state.surface);
            let loss = aim.loss(self.settings, None);
            loss.gauss_newton(&state.surface, &effects)
        });
        Ok(matrix)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;
    use crate::shapes::{Shape, ShapeSet};
    use actuation_net::{NetworkConfig, Width};

    /// A network in which the code matters before any training: what starts small is enlarged.
    fn lively_net() -> ActuationNet {
        let mut config = NetworkConfig::new(2, Width::W64);
        config.latent = 4;
        let mut net = ActuationNet::new(&config, 3).unwrap();
        let mut parameters = net.parameters();
        for tensor in net.parameter_layout().to_vec() {
            let small = ["modulation", "head"];
            if small.iter().any(|part| tensor.name.contains(part)) {
                parameters[tensor.range].iter_mut().for_each(|p| *p *= 30.0);
            }
        }
        net.set_parameters(&parameters).unwrap();
        net
    }

    /// Of code and joint, through network, equilibrium and surface: gradient and effects are the slopes of re-solved equilibria.
    #[test]
    fn gradient_and_effects_are_the_slopes() {
        let scene = fixture::scene("[loss]\nnormal_weight = 1\n[evaluation]\naccuracy = 1e-9\n");
        let inputs = fixture::inputs();
        let surface = inputs.surface.clone();
        let body = Body::of_scene(&scene, surface, &fixture::rig(), 0.3).unwrap();
        let net = lively_net();
        let target = Target::Shape(Shape {
            name: "both".into(),
            set: ShapeSet::HeldOut,
            positions: inputs.shape(2),
            joint: None,
        });
        let mut muscles = Muscles::new(&body, &scene, &net, &target, 0.5).unwrap();
        let x = muscles.variables(&[0.3, -0.2, 0.4, 0.1], &[0.1, -0.05, 0.2, -0.1, 0.15]);
        assert_eq!(x.len(), 9);
        let mut state = muscles.state(&x, None).unwrap().unwrap();
        assert_eq!(state.equilibrium.solution.status, Status::Converged);
        let gradient = muscles.gradient(&mut state).unwrap().unwrap();
        let effects = muscles.effects(&state).unwrap().unwrap();
        let h = 0.01;
        for k in 0..x.len() {
            let mut at = |t: f64| {
                let mut moved = x.clone();
                moved[k] += t;
                let moved = muscles.evaluate(&moved, &state).unwrap().unwrap();
                (moved.value, moved.surface)
            };
            let ((up, above), (down, below)) = (at(h), at(-h));
            let slope = (up - down) / (2.0 * h);
            let error = (slope - gradient[k]).abs();
            assert!(
                error < 5e-3 * gradient.amax(),
                "{k}: {slope} {}",
                gradient[k]
            );
            // Effects are made by loose solves and one-sided differences: they only have to be about right.
            let (mut off, mut size) = (0.0, 0.0);
            for ((a, b), effect) in above.iter().zip(&below).zip(&effects[k]) {
                off += ((a - b) / (2.0 * h) - effect).norm_squared();
                size += effect.norm_squared();
            }
            assert!(
                size > 0.0 && off < 0.1_f64.powi(2) * size,
                "{k}: {off:e} {size:e}"
            );
        }
    }
}
