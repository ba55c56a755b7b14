//! Weight of the body: a constant force per node.

use super::{CoarseView, Effect};
use crate::constant::ConstantMatrix;
use crate::spec::Parameters;
use crate::vector::NodalVector;
use hex_mesh::HexMesh;
use nalgebra::Vector3;

/// Energy `-sum_n m_n acceleration . u_n`, with the mass of every element shared by its eight nodes, which is the exact
/// integral of a constant density over trilinear elements.
pub(crate) struct Gravity {
    masses: Vec<f64>,
    acceleration: Vector3<f64>,
    slot: usize,
}

impl Gravity {
    /// `slot` is this effect's place in [`Parameters::acceleration`].
    pub(crate) fn new(
        mesh: &HexMesh,
        density: f64,
        acceleration: Vector3<f64>,
        slot: usize,
    ) -> Self {
        let share = density * mesh.element_volume() / 8.0;
        let incidence = mesh.node_elements();
        let masses = (0..mesh.nodes().len())
            .map(|node| incidence.at(node).len() as f64 * share)
            .collect();
        Self {
            masses,
            acceleration,
            slot,
        }
    }
}

impl Effect for Gravity {
    fn add_constant(&self, _matrix: &mut ConstantMatrix) {}

    fn set_parameters(&mut self, parameters: &Parameters) {
        self.acceleration = parameters.acceleration[self.slot];
    }

    fn energy_gradient(&mut self, u: &[Vector3<f64>], gradient: &mut NodalVector) -> f64 {
        let mut energy = 0.0;
        for ((mass, u), g) in self.masses.iter().zip(u).zip(gradient) {
            energy -= mass * self.acceleration.dot(u);
            *g -= self.acceleration * *mass;
        }
        energy
    }

    fn linearise(&mut self, _u: &[Vector3<f64>]) {}

    fn hessian_product(&mut self, _x: &[Vector3<f64>], _out: &mut NodalVector) {}

    fn parameter_vjp(&mut self, _u: &[Vector3<f64>], z: &[Vector3<f64>], out: &mut Parameters) {
        let weighted = self.masses.iter().zip(z).map(|(mass, z)| z * *mass);
        out.acceleration[self.slot] += weighted.sum::<Vector3<f64>>();
    }

    fn coarsen(&self, view: &CoarseView) -> Box<dyn Effect> {
        Box::new(Self {
            masses: view.transfer.restrict_scalars(&self.masses),
            acceleration: self.acceleration,
            slot: self.slot,
        })
    }

    fn bytes(&self) -> usize {
        std::mem::size_of_val(self.masses.as_slice())
    }
}
