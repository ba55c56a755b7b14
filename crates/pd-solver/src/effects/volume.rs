//! Flesh that resists a change of volume.

mod projection;

use super::mean_strain::MeanStrain;
use super::{CoarseView, Effect};
use crate::constant::ConstantMatrix;
use crate::parameters::Parameters;
use crate::vector::NodalVector;
use hex_mesh::HexMesh;
use nalgebra::{Matrix3, Vector3};
use projection::Projection;

/// Energy `w / 2 |F - D(F)|^2` per element, with its mean deformation gradient F and the matrix D of determinant 1 that is nearest to it.
///
/// One sample per element: with more, elements of nearly incompressible material lock. As a minimum over D of quadratic functions the energy lies
/// below each of them, so that its Hessian is at most `w` times the constant matrix of one sample, and the projection to D is a local step.
pub(crate) struct Volume {
    mean: MeanStrain,
    /// Stiffness times volume of an element.
    weight: f64,
    /// At the last linearisation.
    projections: Vec<Projection>,
    stresses: Vec<Matrix3<f64>>,
}

impl Volume {
    pub(crate) fn new(mesh: &HexMesh, stiffness: f64) -> Self {
        let mean = MeanStrain::new(mesh);
        Self {
            weight: stiffness * mesh.element_volume(),
            projections: Vec::new(),
            stresses: vec![Matrix3::zeros(); mean.len()],
            mean,
        }
    }
}

impl Effect for Volume {
    fn add_constant(&self, matrix: &mut ConstantMatrix) {
        for (nodes, g) in self.mean.forms() {
            matrix.add_block(nodes, |a, b| self.weight * g[a].dot(&g[b]));
        }
    }

    fn set_parameters(&mut self, _parameters: &Parameters) {}

    fn energy_gradient(&mut self, u: &[Vector3<f64>], gradient: &mut NodalVector) -> f64 {
        let weight = self.weight;
        self.mean.map(u, &mut self.stresses, |_, f| {
            (f - Projection::new(&f).nearest()) * weight
        });
        self.mean.scatter(&self.stresses, gradient);
        let squares = self.stresses.iter().map(|s| s.norm_squared());
        0.5 / weight * squares.sum::<f64>()
    }

    fn linearise(&mut self, u: &[Vector3<f64>]) {
        let identity = Projection::new(&Matrix3::identity());
        self.projections.resize(self.mean.len(), identity);
        self.mean
            .map(u, &mut self.projections, |_, f| Projection::new(&f));
    }

    fn hessian_product(&mut self, x: &[Vector3<f64>], out: &mut NodalVector) {
        let (weight, projections) = (self.weight, &self.projections);
        assert_eq!(projections.len(), self.mean.len(), "linearised");
        self.mean.map(x, &mut self.stresses, |e, df| {
            (df - projections[e].derivative(&df)) * weight
        });
        self.mean.scatter(&self.stresses, out);
    }

    fn parameter_vjp(&mut self, _u: &[Vector3<f64>], _z: &[Vector3<f64>], _out: &mut Parameters) {}

    /// Coarse elements are boxes and partly filled; a start has no need to keep volumes.
    fn coarsen(&self, _view: &CoarseView) -> Option<Box<dyn Effect>> {
        None
    }

    fn largest_diagonal(&self) -> f64 {
        self.mean.largest_diagonal(self.weight)
    }

    fn projections(&self) -> u64 {
        self.mean.len() as u64
    }

    fn smallest_pair_sum(&self) -> Option<f64> {
        let sums = self.projections.iter().map(Projection::smallest_pair_sum);
        sums.reduce(f64::min)
    }

    fn bytes(&self) -> usize {
        self.mean.bytes()
            + size_of_val(self.projections.as_slice())
            + size_of_val(self.stresses.as_slice())
    }
}
