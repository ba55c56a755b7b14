//! Contact.
use super::{CoarseView, Effect};
use crate::constant::ConstantMatrix;
use crate::error::SolverError;
use crate::parameters::Parameters;
use crate::spec::Obstacle;
use crate::surface::EmbeddedSurface;
use crate::vector::NodalVector;
use hex_mesh::HexMesh;
use nalgebra::Vector3;

/// What a scene says of a contact.
#[expect(dead_code)]
pub(crate) struct ContactSettings<'a> {
    /// The vertices of the surface that may touch.
    pub(crate) touching: &'a [bool],
    pub(crate) distance: f64,
    pub(crate) stiffness: f64,
    /// Whether the surface touches itself.
    pub(crate) own: bool,
    pub(crate) obstacles: &'a [Obstacle],
    /// This effect's first entry in [`Parameters::obstacles`].
    pub(crate) first: usize,
}
pub(crate) struct Contact {}
impl Contact {
    pub(crate) fn new(
        _mesh: &HexMesh,
        _surface: &EmbeddedSurface,
        _settings: &ContactSettings,
        index: usize,
    ) -> Result<Self, SolverError> {
        Err(SolverError::Excluded {
            index,
            kind: "contact",
            why: "contact is not simulated yet: take it away",
        })
    }
}
impl Effect for Contact {
    fn add_constant(&self, _matrix: &mut ConstantMatrix) {}
    fn set_parameters(&mut self, _parameters: &Parameters) {}
    fn energy_gradient(&mut self, _u: &[Vector3<f64>], _gradient: &mut NodalVector) -> f64 {
        0.0
    }
    fn linearise(&mut self, _u: &[Vector3<f64>]) {}
    fn hessian_product(&mut self, _x: &[Vector3<f64>], _out: &mut NodalVector) {}
    fn parameter_vjp(&mut self, _u: &[Vector3<f64>], _z: &[Vector3<f64>], _out: &mut Parameters) {}
    fn coarsen(&self, _view: &CoarseView) -> Option<Box<dyn Effect>> {
        None
    }
    fn bytes(&self) -> usize {
        0
    }
}
