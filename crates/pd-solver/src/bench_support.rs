//! What the measurements of this workspace need to see of the inside. No part of the interface: it may change at any time.

use crate::Solver;
use crate::effects::{Effect, Elasticity};
use crate::parameters::Parameters;
use crate::vector::NodalVector;
use hex_mesh::HexMesh;
use nalgebra::Vector3;

/// Energy and gradient at `u` as every step of a solve evaluates them, into memory that is there already, with the parameters of the last call.
///
/// # Panics
/// When arrays do not fit.
pub fn evaluate(solver: &mut Solver, u: &[Vector3<f64>], gradient: &mut NodalVector) -> f64 {
    solver.problem_mut().evaluate(u, gradient)
}

/// What one would write for a body that only has elasticity and held nodes: the same kernel, with no list of effects around it.
pub struct ElasticityAlone {
    elasticity: Elasticity,
    prescribed: Vec<u32>,
}

impl ElasticityAlone {
    /// The body with its held nodes and its actuation.
    pub fn new(
        mesh: &HexMesh,
        stiffness: f64,
        prescribed: &[u32],
        parameters: &Parameters,
    ) -> Self {
        let mut elasticity = Elasticity::from_mesh(mesh, stiffness, None);
        elasticity.set_parameters(parameters);
        Self {
            elasticity,
            prescribed: prescribed.to_vec(),
        }
    }

    /// Energy and gradient at `u`, zero at held nodes.
    ///
    /// # Panics
    /// When arrays do not fit.
    pub fn evaluate(&mut self, u: &[Vector3<f64>], gradient: &mut NodalVector) -> f64 {
        gradient.fill(Vector3::zeros());
        let energy = self.elasticity.energy_gradient(u, gradient);
        for &node in &self.prescribed {
            gradient[node as usize] = Vector3::zeros();
        }
        energy
    }
}
