//! Points of the surface as linear forms over nodes.

use super::CoarseView;
use crate::surface::EmbeddedSurface;
use crate::vector::NodalVector;
use hex_mesh::HexMesh;
use nalgebra::Vector3;

/// Points `x_p = sum_n w_pn u_n`, each with the nodes that carry it.
#[derive(Default)]
pub(super) struct Points {
    /// First term of each point, and the end.
    offsets: Vec<u32>,
    terms: Vec<(u32, f64)>,
}

impl Points {
    /// These vertices of a surface, in this order.
    pub(super) fn of_surface(mesh: &HexMesh, surface: &EmbeddedSurface, vertices: &[u32]) -> Self {
        let mut points = Self::with_capacity(vertices.len());
        for &v in vertices {
            let point = &surface.points[v as usize];
            let corners = mesh.elements()[point.element as usize].iter();
            points.push(corners.copied().zip(point.weights));
        }
        points
    }

    fn with_capacity(points: usize) -> Self {
        let mut offsets = Vec::with_capacity(points + 1);
        offsets.push(0);
        Self {
            offsets,
            terms: Vec::with_capacity(8 * points),
        }
    }

    fn push(&mut self, terms: impl Iterator<Item = (u32, f64)>) {
        self.terms.extend(terms.filter(|(_, w)| *w != 0.0));
        self.offsets.push(self.terms.len() as u32);
    }

    /// Number of points.
    pub(super) fn len(&self) -> usize {
        self.offsets.len() - 1
    }

    /// The nodes that carry a point, and their weights.
    pub(super) fn terms(&self, point: usize) -> &[(u32, f64)] {
        &self.terms[self.offsets[point] as usize..self.offsets[point + 1] as usize]
    }

    /// Writes what the points make of nodal vectors.
    pub(super) fn gather(&self, u: &[Vector3<f64>], out: &mut Vec<Vector3<f64>>) {
        out.clear();
        let of = |p| {
            let terms = self.terms(p).iter();
            terms.map(|&(n, w)| u[n as usize] * w).sum::<Vector3<f64>>()
        };
        out.extend((0..self.len()).map(of));
    }

    /// Adds forces on the points to the nodes that carry them.
    pub(super) fn scatter(&self, forces: &[Vector3<f64>], out: &mut NodalVector) {
        for (p, force) in forces.iter().enumerate() {
            for &(n, w) in self.terms(p) {
                out[n as usize] += force * w;
            }
        }
    }

    /// The same points, carried by the nodes of a coarser grid.
    pub(super) fn coarsen(&self, view: &CoarseView) -> Self {
        let mut points = Self::with_capacity(self.len());
        for p in 0..self.len() {
            let (nodes, weights): (Vec<u32>, Vec<f64>) = self.terms(p).iter().copied().unzip();
            let (nodes, weights) = view.transfer.restrict_form(&nodes, &weights);
            points.push(nodes.into_iter().zip(weights));
        }
        points
    }

    pub(super) fn bytes(&self) -> usize {
        size_of_val(self.offsets.as_slice()) + size_of_val(self.terms.as_slice())
    }
}
