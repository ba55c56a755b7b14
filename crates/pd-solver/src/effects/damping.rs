//! Friction inside the flesh: what a step in time adds to the energy for the rate of strain in it.

use super::build::Stepping;
use super::mean_strain::MeanStrain;
use super::{CoarseView, Effect};
use crate::constant::ConstantMatrix;
use crate::parameters::Parameters;
use crate::vector::NodalVector;
use hex_mesh::HexMesh;
use nalgebra::{Matrix3, Vector3};

/// Energy `c V / (2 h) |E - E_before|^2` per element, with the Green strain `E = (F^T F - I) / 2` of its mean deformation gradient: rotations
/// have no part in it, so that momentum is kept, linear and angular.
pub(crate) struct Damping {
    mean: MeanStrain,
    /// Viscosity times volume over the step.
    weight: f64,
    /// `F^T F` before the step, and F there.
    before: Vec<Matrix3<f64>>,
    linearised: Vec<Matrix3<f64>>,
    stresses: Vec<Matrix3<f64>>,
}

impl Damping {
    pub(crate) fn new(mesh: &HexMesh, viscosity: f64, stepping: &Stepping) -> Self {
        let mean = MeanStrain::new(mesh);
        let all = vec![Matrix3::identity(); mean.len()];
        Self {
            weight: viscosity * mesh.element_volume() / stepping.solved_step(),
            before: all.clone(),
            linearised: all.clone(),
            stresses: all,
            mean,
        }
    }
}

/// Half the change of `F^T F`: the change of the Green strain.
fn change(f: &Matrix3<f64>, before: &Matrix3<f64>) -> Matrix3<f64> {
    (f.tr_mul(f) - before.tr_mul(before)) * 0.5
}

/// The change of the Green strain for a change of F.
fn rate(f: &Matrix3<f64>, df: &Matrix3<f64>) -> Matrix3<f64> {
    let product = f.tr_mul(df);
    (product + product.transpose()) * 0.5
}

impl Effect for Damping {
    /// Nothing: the constant matrix resists rotations as much as strain, which friction does not. A cycle knows of it.
    fn add_constant(&self, _matrix: &mut ConstantMatrix) {}

    fn is_bounded(&self) -> bool {
        false
    }

    fn set_parameters(&mut self, parameters: &Parameters) {
        let (mean, before) = (&self.mean, &mut self.before);
        mean.map(&parameters.before, before, |_, f| f);
    }

    fn energy_gradient(&mut self, u: &[Vector3<f64>], gradient: &mut NodalVector) -> f64 {
        let (weight, before) = (self.weight, &self.before);
        self.mean.map(u, &mut self.stresses, |_, f| f);
        let mut energy = 0.0;
        for (stress, before) in self.stresses.iter_mut().zip(before) {
            let change = change(stress, before);
            energy += 0.5 * weight * change.norm_squared();
            *stress = *stress * change * weight;
        }
        self.mean.scatter(&self.stresses, gradient);
        energy
    }

    fn linearise(&mut self, u: &[Vector3<f64>]) {
        self.mean.map(u, &mut self.linearised, |_, f| f);
    }

    fn hessian_product(&mut self, x: &[Vector3<f64>], out: &mut NodalVector) {
        let (weight, before, at) = (self.weight, &self.before, &self.linearised);
        self.mean.map(x, &mut self.stresses, |e, df| {
            let (f, before) = (&at[e], &before[e]);
            (df * change(f, before) + f * rate(f, &df)) * weight
        });
        self.mean.scatter(&self.stresses, out);
    }

    /// `-(d gradient / d before)^T z`: the gradient is `w F (C - C_before) / 2`, and `F_before` is linear in the positions before.
    fn parameter_vjp(&mut self, _u: &[Vector3<f64>], z: &[Vector3<f64>], out: &mut Parameters) {
        let (weight, before, at) = (self.weight, &self.before, &self.linearised);
        self.mean.map(z, &mut self.stresses, |e, dz| {
            before[e] * rate(&at[e], &dz) * weight
        });
        self.mean.scatter(&self.stresses, &mut out.before);
    }

    fn coarsen(&self, _view: &CoarseView) -> Option<Box<dyn Effect>> {
        None
    }

    fn largest_diagonal(&self) -> f64 {
        self.mean.largest_diagonal(self.weight)
    }

    fn bytes(&self) -> usize {
        self.mean.bytes() + 3 * size_of_val(self.before.as_slice())
    }
}
