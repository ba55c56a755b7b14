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
    stiffness: f64,
    /// Stiffness times volume of each element.
    weights: Vec<f64>,
    /// At the last linearisation.
    projections: Vec<Projection>,
    stresses: Vec<Matrix3<f64>>,
}

impl Volume {
    pub(crate) fn new(mesh: &HexMesh, stiffness: f64) -> Self {
        let mean = MeanStrain::new(mesh);
        let weights = vec![stiffness * mesh.element_volume(); mean.len()];
        Self::with(mean, stiffness, weights)
    }

    fn with(mean: MeanStrain, stiffness: f64, weights: Vec<f64>) -> Self {
        Self {
            projections: Vec::new(),
            stresses: vec![Matrix3::zeros(); mean.len()],
            mean,
            stiffness,
            weights,
        }
    }
}

impl Effect for Volume {
    fn add_constant(&self, matrix: &mut ConstantMatrix) {
        for ((nodes, g), weight) in self.mean.forms().zip(&self.weights) {
            matrix.add_block(nodes, |a, b| weight * g[a].dot(&g[b]));
        }
    }

    fn set_parameters(&mut self, _parameters: &Parameters) {}

    fn energy_gradient(&mut self, u: &[Vector3<f64>], gradient: &mut NodalVector) -> f64 {
        let weights = &self.weights;
        self.mean.map(u, &mut self.stresses, |e, f| {
            (f - Projection::new(&f).nearest()) * weights[e]
        });
        self.mean.scatter(&self.stresses, gradient);
        let stresses = self.stresses.iter().zip(weights);
        0.5 * stresses.map(|(s, w)| s.norm_squared() / w).sum::<f64>()
    }

    fn linearise(&mut self, u: &[Vector3<f64>]) {
        let identity = Projection::new(&Matrix3::identity());
        self.projections.resize(self.mean.len(), identity);
        self.mean
            .map(u, &mut self.projections, |_, f| Projection::new(&f));
    }

    fn hessian_product(&mut self, x: &[Vector3<f64>], out: &mut NodalVector) {
        let (weights, projections) = (&self.weights, &self.projections);
        assert_eq!(projections.len(), self.mean.len(), "linearised");
        self.mean.map(x, &mut self.stresses, |e, df| {
            (df - projections[e].derivative(&df)) * weights[e]
        });
        self.mean.scatter(&self.stresses, out);
    }

    fn parameter_vjp(&mut self, _u: &[Vector3<f64>], _z: &[Vector3<f64>], _out: &mut Parameters) {}

    /// A box that is filled in part keeps the volume that it has.
    fn coarsen(&self, view: &CoarseView) -> Option<Box<dyn Effect>> {
        let grid = view.grid;
        let volumes = (0..grid.elements.len()).map(|e| grid.volume(e));
        let weights = volumes.map(|v| self.stiffness * v).collect();
        let mean = MeanStrain::on_grid(grid);
        Some(Box::new(Self::with(mean, self.stiffness, weights)))
    }

    fn volume_stiffness(&self) -> f64 {
        self.stiffness
    }

    fn largest_diagonal(&self) -> f64 {
        self.mean.largest_diagonal(self.weights[0])
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
            + size_of_val(self.weights.as_slice())
            + size_of_val(self.projections.as_slice())
            + size_of_val(self.stresses.as_slice())
    }
}
