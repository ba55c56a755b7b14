//! Inertia: what a step in time adds to the energy.
//!
//! Backward Euler minimises `E(u) + sum_n m_n / (2 h^2) |u_n - y_n|^2` with `y = x + h v`, from where the body is and how it moves. The
//! implicit midpoint rule does the same with half the step to the middle of the step, and goes on from there as far again.

use super::build::Stepping;
use super::{CoarseView, Effect, FormVisitor};
use crate::constant::ConstantMatrix;
use crate::parameters::Parameters;
use crate::vector::NodalVector;
use hex_mesh::HexMesh;
use nalgebra::Vector3;

/// Energy `sum_n k_n / 2 |u_n - y_n|^2`.
pub(crate) struct Inertia {
    /// Mass over the square of the step that is solved for.
    stiffness: Vec<f64>,
    targets: Vec<Vector3<f64>>,
}

impl Inertia {
    pub(crate) fn new(mesh: &HexMesh, stepping: &Stepping) -> Self {
        let step = stepping.solved_step();
        let masses = stepping.masses.iter();
        Self {
            stiffness: masses.map(|m| m / (step * step)).collect(),
            targets: mesh.nodes().to_vec(),
        }
    }
}

impl Effect for Inertia {
    fn add_constant(&self, matrix: &mut ConstantMatrix) {
        for (n, k) in self.stiffness.iter().enumerate() {
            matrix.add_outer(&[n as u32], &[1.0], *k);
        }
    }

    fn set_parameters(&mut self, parameters: &Parameters) {
        self.targets.copy_from_slice(&parameters.inertia);
    }

    fn energy_gradient(&mut self, u: &[Vector3<f64>], gradient: &mut NodalVector) -> f64 {
        let mut energy = 0.0;
        let nodes = self.stiffness.iter().zip(&self.targets).zip(u);
        for (((k, target), u), g) in nodes.zip(gradient) {
            let away = u - target;
            energy += 0.5 * k * away.norm_squared();
            *g += away * *k;
        }
        energy
    }

    fn linearise(&mut self, _u: &[Vector3<f64>]) {}

    fn hessian_product(&mut self, x: &[Vector3<f64>], out: &mut NodalVector) {
        for ((k, x), out) in self.stiffness.iter().zip(x).zip(out) {
            *out += x * *k;
        }
    }

    fn parameter_vjp(&mut self, _u: &[Vector3<f64>], z: &[Vector3<f64>], out: &mut Parameters) {
        for ((k, z), out) in self.stiffness.iter().zip(z).zip(&mut out.inertia) {
            *out += z * *k;
        }
    }

    /// A step starts where the body is: what a coarse body would do says nothing.
    fn coarsen(&self, _view: &CoarseView) -> Option<Box<dyn Effect>> {
        None
    }

    fn for_each_form(&self, f: FormVisitor) {
        for (n, k) in self.stiffness.iter().enumerate() {
            f(&[n as u32], &[1.0], *k);
        }
    }

    fn largest_diagonal(&self) -> f64 {
        self.stiffness.iter().copied().fold(0.0, f64::max)
    }

    fn bytes(&self) -> usize {
        size_of_val(self.stiffness.as_slice()) + size_of_val(self.targets.as_slice())
    }
}
