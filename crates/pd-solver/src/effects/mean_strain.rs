//! The mean deformation gradient of every element, and forces of stresses on it: what effects with one sample per element share.

use super::elasticity::Slabs;
use super::elasticity::deformation_gradient;
use crate::vector::NodalVector;
use hex_mesh::{HexMesh, Quadrature, QuadratureRule};
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

/// Elements per task.
const TASK: usize = 256;

/// Cubes of one size. The mean over a cube of the gradients of trilinear functions is their value at its centre.
pub(super) struct MeanStrain {
    elements: Vec<[u32; 8]>,
    gradients: [Vector3<f64>; 8],
    slabs: Slabs,
}

impl MeanStrain {
    pub(super) fn new(mesh: &HexMesh) -> Self {
        Self {
            elements: mesh.elements().to_vec(),
            gradients: QuadratureRule::new(Quadrature::One).gradients(mesh.element_size())[0],
            slabs: Slabs::new(mesh.elements(), mesh.nodes().len()),
        }
    }

    /// Number of elements.
    pub(super) fn len(&self) -> usize {
        self.elements.len()
    }

    /// The nodes of each element, and the derivatives of their shape functions in its mean.
    pub(super) fn forms(&self) -> impl Iterator<Item = (&[u32; 8], &[Vector3<f64>; 8])> {
        self.elements.iter().map(|nodes| (nodes, &self.gradients))
    }

    /// About the largest diagonal entry of a matrix of `weight` times these forms: eight elements meet in a node.
    pub(super) fn largest_diagonal(&self, weight: f64) -> f64 {
        8.0 * weight * self.gradients[0].norm_squared()
    }

    /// Writes `of(e, F_e)` for every element.
    pub(super) fn map<T: Send>(
        &self,
        u: &[Vector3<f64>],
        out: &mut [T],
        of: impl Fn(usize, Matrix3<f64>) -> T + Sync,
    ) {
        let elements = self.elements.par_iter().enumerate().with_min_len(TASK);
        elements.zip(out).for_each(|((e, nodes), out)| {
            let x = nodes.map(|n| u[n as usize]);
            *out = of(e, deformation_gradient(&x, &self.gradients));
        });
    }

    /// Adds the forces of the stresses of all elements to their nodes.
    pub(super) fn scatter(&self, stresses: &[Matrix3<f64>], out: &mut NodalVector) {
        self.slabs
            .run_elements(out, self.elements.len(), &|range, first, out| {
                for e in range {
                    for (&n, g) in self.elements[e].iter().zip(&self.gradients) {
                        out[n as usize - first] += stresses[e] * g;
                    }
                }
            });
    }

    pub(super) fn bytes(&self) -> usize {
        size_of_val(self.elements.as_slice()) + self.slabs.bytes()
    }
}
