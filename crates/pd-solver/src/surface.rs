//! The surface that hangs on a body: what effects on it see.

use crate::error::SolverError;
use crate::spec::inside;
use hex_mesh::{EmbeddedPoint, HexMesh, NodeRegion};
use nalgebra::Vector3;

/// A surface of triangles whose vertices are points inside elements (or near them), and move as those do.
#[derive(Debug, Clone, PartialEq)]
pub struct EmbeddedSurface {
    /// The vertices, as [`hex_mesh::embed`] and its like give them.
    pub points: Vec<EmbeddedPoint>,
    /// Triangles by three vertices each, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl EmbeddedSurface {
    /// Positions of the vertices for positions of the nodes of `mesh`.
    pub(crate) fn positions(&self, mesh: &HexMesh, u: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let of = |point: &EmbeddedPoint| {
            let corners = mesh.elements()[point.element as usize].iter();
            let terms = corners.zip(&point.weights);
            terms.map(|(&n, w)| u[n as usize] * *w).sum()
        };
        self.points.iter().map(of).collect()
    }

    /// Refuses elements and vertices that do not exist.
    pub(crate) fn check(&self, mesh: &HexMesh) -> Result<(), SolverError> {
        let out_of_range = |what, found: u32, count| {
            Err(SolverError::OutOfRange {
                index: 0,
                what,
                found: found as usize,
                count,
            })
        };
        let elements = mesh.elements().len();
        if let Some(point) = (self.points.iter()).find(|p| p.element as usize >= elements) {
            return out_of_range("element of the surface", point.element, elements);
        }
        let vertices = self.points.len();
        let mut corners = self.triangles.iter().flatten();
        match corners.find(|&&v| v as usize >= vertices) {
            Some(&v) => out_of_range("vertex of the surface", v, vertices),
            None => Ok(()),
        }
    }

    /// Which vertices lie in a region at rest; all where there is none.
    pub(crate) fn select(
        &self,
        region: Option<&NodeRegion>,
        mesh: &HexMesh,
        effect: usize,
    ) -> Result<Vec<bool>, SolverError> {
        match region {
            Some(region) => {
                let rest = self.positions(mesh, mesh.nodes());
                inside(region, &rest, mesh, effect, "vertex of the surface")
            }
            None => Ok(vec![true; self.points.len()]),
        }
    }
}
