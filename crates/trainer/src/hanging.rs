//! The nodes that hang on the jaw joint, between the network's answer and a solver's parameters.

use crate::body::Body;
use actuation_net::JOINT_SIZE;
use face_rig::{Joint, JointParameters};
use nalgebra::Vector3;
use pd_solver::{Parameters, Solver};

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
    /// Length of one unit of slide.
    unit: f64,
}

impl Hanging {
    /// The hanging nodes of a body among the prescribed ones of a solver; `None` where nothing hangs.
    pub fn new(body: &Body, solver: &Solver) -> Option<Self> {
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
        Some(Self {
            joint,
            rest: places.iter().map(rest).collect(),
            places,
            unit: SLIDE * body.diagonal,
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

    /// Moves the hanging nodes.
    pub fn place(&self, theta: JointParameters, parameters: &mut Parameters) {
        let moved = self.joint.positions(theta, &self.rest);
        for (&place, x) in self.places.iter().zip(moved) {
            parameters.prescribed[place] = x;
        }
    }

    /// The cotangent of the network's answer from that of the prescribed positions.
    pub fn vjp(
        &self,
        theta: JointParameters,
        prescribed_bar: &[Vector3<f64>],
    ) -> [f32; JOINT_SIZE] {
        let bars: Vec<_> = self.places.iter().map(|&i| prescribed_bar[i]).collect();
        let theta_bar = self.joint.vjp(theta, &self.rest, &bars);
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
