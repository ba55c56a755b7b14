//! The mean deformation gradient of every element, and forces of stresses on it: what effects with one sample per element share.

use super::elasticity::Slabs;
use super::elasticity::deformation_gradient;
use crate::multigrid::Grid;
use crate::vector::NodalVector;
use hex_mesh::{HexMesh, Quadrature, QuadratureRule};
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

/// Elements per task.
const TASK: usize = 256;
/// Share of an edge that is none.
const ROUNDOFF: f64 = 1e-6;

/// Boxes along the axes. The mean over a box of the gradients of trilinear functions is their value at its centre.
pub(super) struct MeanStrain {
    elements: Vec<[u32; 8]>,
    /// Derivatives of the shape functions, for every size of boxes that occurs.
    gradients: Vec<[Vector3<f64>; 8]>,
    /// The size of each element; empty where there is only one.
    sizes: Vec<u32>,
    slabs: Slabs,
}

/// The derivatives at the centre of the unit cube.
fn of_unit_cube() -> [Vector3<f64>; 8] {
    QuadratureRule::new(Quadrature::One).gradients(1.0)[0]
}

impl MeanStrain {
    pub(super) fn new(mesh: &HexMesh) -> Self {
        Self {
            elements: mesh.elements().to_vec(),
            gradients: vec![of_unit_cube().map(|g| g / mesh.element_size())],
            sizes: Vec::new(),
            slabs: Slabs::new(mesh.elements(), mesh.nodes().len()),
        }
    }

    pub(super) fn on_grid(grid: &Grid) -> Self {
        let (mut known, mut gradients) = (Vec::new(), Vec::new());
        let size = |e| {
            let size = grid.size(e);
            // Lattice coordinates carry roundoff; what differs by no more than that is the same.
            let same = |k: &Vector3<f64>| (k - size).norm() < ROUNDOFF * size.norm();
            let found = known.iter().position(same);
            found.unwrap_or_else(|| {
                known.push(size);
                gradients.push(of_unit_cube().map(|g| g.component_div(&size)));
                known.len() - 1
            }) as u32
        };
        Self {
            sizes: (0..grid.elements.len()).map(size).collect(),
            gradients,
            elements: grid.elements.clone(),
            slabs: Slabs::new(&grid.elements, grid.node_count()),
        }
    }

    /// Derivatives of an element's shape functions.
    fn gradients(&self, element: usize) -> &[Vector3<f64>; 8] {
        let size = self.sizes.get(element).copied().unwrap_or(0);
        &self.gradients[size as usize]
    }

    /// Number of elements.
    pub(super) fn len(&self) -> usize {
        self.elements.len()
    }

    /// The nodes of each element, and the derivatives of their shape functions in its mean.
    pub(super) fn forms(&self) -> impl Iterator<Item = (&[u32; 8], &[Vector3<f64>; 8])> {
        let elements = self.elements.iter().enumerate();
        elements.map(|(e, nodes)| (nodes, self.gradients(e)))
    }

    /// About the largest diagonal entry of a matrix of `weight` times these forms: eight elements meet in a node.
    pub(super) fn largest_diagonal(&self, weight: f64) -> f64 {
        8.0 * weight * self.gradients[0][0].norm_squared()
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
            *out = of(e, deformation_gradient(&x, self.gradients(e)));
        });
    }

    /// Adds the forces of the stresses of all elements to their nodes.
    pub(super) fn scatter(&self, stresses: &[Matrix3<f64>], out: &mut NodalVector) {
        self.slabs
            .run_elements(out, self.elements.len(), &|range, first, out| {
                for e in range {
                    for (&n, g) in self.elements[e].iter().zip(self.gradients(e)) {
                        out[n as usize - first] += stresses[e] * g;
                    }
                }
            });
    }

    pub(super) fn bytes(&self) -> usize {
        size_of_val(self.elements.as_slice())
            + size_of_val(self.gradients.as_slice())
            + size_of_val(self.sizes.as_slice())
            + self.slabs.bytes()
    }
}
