//! The nodes that hang on the jaw joint, between the network's answer and a solver's parameters.

use crate::body::Body;
use crate::loss;
use actuation_net::JOINT_SIZE;
use face_rig::{Joint, JointParameters};
use nalgebra::Vector3;
use pd_solver::{EffectSpec, Parameters, Solver};
use std::ops::Range;

/// What one unit of the network's answer slides the joint by, as a share of the bounding-box diagonal; its angles are in radians. Angles
/// and slides are then about as large as each other, whatever the unit of length.
const SLIDE: f64 = 0.1;

/// Prescribed nodes that the joint moves.
#[derive(Debug, Clone)]
pub struct Hanging {
    joint: Joint,
    /// Places among the prescribed nodes of the solver.
    places: Vec<usize>,
    rest: Vec<Vector3<f64>>,
    /// Obstacles that the joint moves: where they are in the solver's parameters, and their vertices at rest.
    obstacles: Vec<(Range<usize>, Vec<Vector3<f64>>)>,
    /// Length of one unit of slide.
    unit: f64,
    /// Length that counts as 1 in the loss on the surface.
    loss_unit: f64,
}

impl Hanging {
    /// The hanging nodes of a body among the prescribed ones of a solver with these effects, by name; `None` where nothing hangs.
    pub fn new(body: &Body, effects: &[EffectSpec], solver: &Solver) -> Option<Self> {
        let joint = body.joint?;
        let mut hangs = vec![false; body.mesh.nodes().len()];
        body.moved_nodes
            .iter()
            .for_each(|&n| hangs[n as usize] = true);
        let prescribed = solver.prescribed();
        let places: Vec<usize> = (0..prescribed.len())
            .filter(|&i| hangs[prescribed[i] as usize])
            .collect();
        let rest = |&i: &usize| body.mesh.nodes()[prescribed[i] as usize];
        let all = solver.rest_parameters().obstacles;
        let moved = body.props.moved_places(effects).into_iter();
        Some(Self {
            joint,
            obstacles: moved.map(|at| (at.clone(), all[at].to_vec())).collect(),
            rest: places.iter().map(rest).collect(),
            places,
            unit: SLIDE * body.diagonal,
            loss_unit: loss::UNIT * body.diagonal,
        })
    }

    /// The joint's parameters (radians, scene units) for the network's answer.
    pub fn parameters(&self, answer: &[f32; JOINT_SIZE]) -> JointParameters {
        std::array::from_fn(|k| f64::from(answer[k]) * self.factor(k))
    }

    /// What the network has to answer for the joint's parameters.
    pub fn answer(&self, theta: &JointParameters) -> [f32; JOINT_SIZE] {
        std::array::from_fn(|k| (theta[k] / self.factor(k)) as f32)
    }

    fn factor(&self, k: usize) -> f64 {
        if k < 2 { 1.0 } else { self.unit }
    }

    /// Moves the hanging nodes as the network answers; returns the joint's parameters.
    pub fn drive(
        &self,
        answer: &[f32; JOINT_SIZE],
        parameters: &mut Parameters,
    ) -> JointParameters {
        let theta = self.parameters(answer);
        self.place(theta, parameters);
        theta
    }

    /// Moves the hanging nodes, and the obstacles that move.
    pub fn place(&self, theta: JointParameters, parameters: &mut Parameters) {
        let moved = self.joint.positions(theta, &self.rest);
        for (&place, x) in self.places.iter().zip(moved) {
            parameters.prescribed[place] = x;
        }
        for (at, rest) in &self.obstacles {
            let moved = self.joint.positions(theta, rest);
            parameters.obstacles[at.clone()].copy_from_slice(&moved);
        }
    }

    /// The cotangent of the network's answer from that of the solver's parameters.
    pub fn vjp(&self, theta: JointParameters, bar: &Parameters) -> [f32; JOINT_SIZE] {
        let nodes: Vec<_> = self.places.iter().map(|&i| bar.prescribed[i]).collect();
        let mut sum = self.joint.vjp(theta, &self.rest, &nodes);
        for (at, rest) in &self.obstacles {
            let own = self.joint.vjp(theta, rest, &bar.obstacles[at.clone()]);
            sum.iter_mut().zip(own).for_each(|(sum, own)| *sum += own);
        }
        self.in_units(&sum)
    }

    /// `weight` times the mean squared distance of the hanging nodes under one motion from where they are under another, in the unit
    /// of the loss on the surface, and the cotangent of the network's answer for the first.
    pub fn misfit(
        &self,
        own: JointParameters,
        wanted: JointParameters,
        weight: f64,
    ) -> (f64, [f32; JOINT_SIZE]) {
        let off: Vec<_> = (self.joint.positions(own, &self.rest).into_iter())
            .zip(self.joint.positions(wanted, &self.rest))
            .map(|(a, b)| a - b)
            .collect();
        let scale = weight / (off.len().max(1) as f64 * self.loss_unit.powi(2));
        let value = off.iter().map(Vector3::norm_squared).sum::<f64>() * scale;
        let bars: Vec<_> = off.iter().map(|d| d * (2.0 * scale)).collect();
        let bar = self.joint.vjp(own, &self.rest, &bars);
        (value, self.in_units(&bar))
    }

    /// The cotangent of the network's answer from that of the joint's parameters.
    fn in_units(&self, theta_bar: &JointParameters) -> [f32; JOINT_SIZE] {
        std::array::from_fn(|k| (theta_bar[k] * self.factor(k)) as f32)
    }

    /// Mean distance of the hanging nodes under one motion from where they are under another.
    pub fn mean_distance(&self, a: JointParameters, b: JointParameters) -> f64 {
        let (a, b) = (
            self.joint.positions(a, &self.rest),
            self.joint.positions(b, &self.rest),
        );
        let sum: f64 = a.iter().zip(&b).map(|(a, b)| (a - b).norm()).sum();
        sum / a.len().max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;
    use crate::rig::Rig;

    /// The cotangent of the answer is the slope of a loss on the prescribed positions.
    #[test]
    fn the_cotangent_is_the_slope() {
        let scene = fixture::scene("");
        let surface = fixture::inputs().surface;
        let body = Body::of_scene(&scene, surface, &fixture::rig(), 0.2).unwrap();
        let solver = Solver::new(&body.mesh, &body.effects(&scene).unwrap()).unwrap();
        let hanging = Hanging::new(&body, &scene.effects, &solver).unwrap();
        assert!(hanging.places.len() > 8);
        let rest = solver.rest_parameters();
        let bar: Vec<Vector3<f64>> = (0..rest.prescribed.len())
            .map(|i| Vector3::new((i as f64).sin(), (i as f64).cos(), 0.3))
            .collect();
        let answer = [0.2, -0.1, 0.5, -0.3, 0.4];
        let loss = |answer: &[f32; JOINT_SIZE]| {
            let mut parameters = rest.clone();
            hanging.place(hanging.parameters(answer), &mut parameters);
            let pairs = parameters.prescribed.iter().zip(&bar);
            pairs.map(|(x, b)| x.dot(b)).sum::<f64>()
        };
        let mut parameters_bar = rest.clone();
        parameters_bar.prescribed.clone_from(&bar);
        let exact = hanging.vjp(hanging.parameters(&answer), &parameters_bar);
        fixture::assert_joint_slope(&exact, &answer, loss);
        let theta = hanging.parameters(&answer);
        let again = hanging.answer(&theta);
        assert!(answer.iter().zip(again).all(|(a, b)| (a - b).abs() < 1e-6));
        assert!(hanging.mean_distance(theta, theta) == 0.0);
        assert!(hanging.mean_distance(theta, Joint::REST) > 0.01);
    }

    /// The misfit is the mean of squares it says, its cotangent the slope, and both vanish where the motions agree.
    #[test]
    fn the_misfit_counts_as_the_surface_does() {
        let scene = fixture::scene("");
        let body = Body::of_scene(&scene, fixture::inputs().surface, &fixture::rig(), 0.2).unwrap();
        let solver = Solver::new(&body.mesh, &body.effects(&scene).unwrap()).unwrap();
        let hanging = Hanging::new(&body, &scene.effects, &solver).unwrap();
        let slid = [0.0, 0.0, 0.03, 0.0, 0.04];
        let (value, _) = hanging.misfit(slid, Joint::REST, 2.0);
        let expected = 2.0 * (0.05 / (0.01 * body.diagonal)).powi(2);
        assert!((value - expected).abs() < 1e-9 * expected);
        let (zero, bar) = hanging.misfit(slid, slid, 2.0);
        assert_eq!((zero, bar), (0.0, [0.0; JOINT_SIZE]));
        let answer = [0.2_f32, -0.1, 0.5, -0.3, 0.4];
        let of = |answer: &[f32; JOINT_SIZE]| hanging.misfit(hanging.parameters(answer), slid, 2.0);
        let (_, exact) = of(&answer);
        fixture::assert_joint_slope(&exact, &answer, |answer| of(answer).0);
    }

    #[test]
    fn nothing_hangs_without_a_joint() {
        let scene = fixture::scene("");
        let body = fixture::body(&scene);
        let solver = Solver::new(&body.mesh, &scene.effects).unwrap();
        assert!(Hanging::new(&body, &scene.effects, &solver).is_none());
    }

    #[test]
    fn a_bone_outside_of_the_body_is_refused() {
        let mut rig = fixture::rig();
        let far = rig.bones[0]
            .surface
            .vertices()
            .iter()
            .map(|x| x * 1.0 + Vector3::repeat(9.0));
        rig.bones[0].surface = rig.bones[0].surface.with_vertices(far.collect()).unwrap();
        let scene = fixture::scene("");
        let refused = Body::of_scene(&scene, fixture::inputs().surface, &rig, 0.2);
        let message = refused.err().map(|e| e.to_string()).unwrap_or_default();
        assert!(
            message.contains("the bone `mandible`, 1.559 across, holds no node"),
            "{message}"
        );
    }

    #[test]
    fn parts_of_the_loss_count_what_the_scene_says() {
        let surface = fixture::inputs().surface;
        let body = |parts: &str| {
            let scene = fixture::scene(parts);
            Body::of_scene(&scene, surface.clone(), &Rig::default(), 0.4)
        };
        let half = "[[loss.weights]]\nregion = { type = \"half_space\", normal = [1, 0, 0], offset = 0.5 }\nweight = 0\n";
        let weighed = body(half).unwrap();
        for (x, weight) in surface.vertices().iter().zip(&weighed.vertex_weights) {
            assert_eq!(*weight == 0.0, x.x > 0.5 - 1e-9, "{x}");
        }
        assert!((weighed.vertex_weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        for (parts, expected) in [
            ("[[loss.weights]]\nweight = 0\n", "needs either"),
            (
                "[[loss.weights]]\nvertices = [0, 9999]\nweight = 0\n",
                "the surface has 0 to 161",
            ),
            (
                "[[loss.weights]]\nvertices = [0, 161]\nweight = 0\n",
                "leaves no vertex",
            ),
            (
                "[[loss.weights]]\nvertices = [0, 1]\nweight = -1\n",
                "the weight -1",
            ),
            (
                "[[loss.weights]]\nregion = { type = \"sphere\", center = [9, 9, 9], radius = 1 }\nweight = 2\n",
                "selects no vertex",
            ),
        ] {
            let message = body(parts).err().map(|e| e.to_string()).unwrap_or_default();
            assert!(message.contains(expected), "{message}");
        }
    }
}
