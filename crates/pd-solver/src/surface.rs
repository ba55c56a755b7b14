//! The surface that hangs on a body: what effects on it see.

use crate::error::SolverError;
use crate::spec::inside;
use hex_mesh::{EmbeddedPoint, HexMesh, NodeRegion};
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// A surface of triangles whose vertices are points inside elements (or near them), and move as those do.
#[derive(Debug, Clone, PartialEq)]
pub struct EmbeddedSurface {
    /// The vertices, as [`hex_mesh::embed`] and its like give them.
    pub points: Vec<EmbeddedPoint>,
    /// Triangles by three vertices each, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

/// Corners of the faces of an element, x slowest; each counter-clockwise from outside.
const FACES: [[usize; 4]; 6] = [
    [0, 1, 3, 2],
    [4, 6, 7, 5],
    [0, 4, 5, 1],
    [2, 3, 7, 6],
    [0, 2, 6, 4],
    [1, 5, 7, 3],
];

impl EmbeddedSurface {
    /// The boundary of a mesh, two triangles for each face that one element has for itself, with a vertex at each of their nodes: for bodies that
    /// were made of cells and have no surface of their own.
    pub fn boundary(mesh: &HexMesh) -> Self {
        let mut faces: BTreeMap<[u32; 4], ([u32; 4], usize)> = BTreeMap::new();
        let mut carrier = vec![None; mesh.nodes().len()];
        for (element, nodes) in mesh.elements().iter().enumerate() {
            for face in FACES {
                let face = face.map(|c| nodes[c]);
                let mut key = face;
                key.sort_unstable();
                faces.entry(key).or_insert((face, 0)).1 += 1;
            }
            for (corner, &n) in nodes.iter().enumerate() {
                carrier[n as usize] = Some((element as u32, corner));
            }
        }
        let mut vertex = BTreeMap::new();
        let (mut points, mut triangles) = (Vec::new(), Vec::new());
        for (face, _) in faces.into_values().filter(|(_, count)| *count == 1) {
            let [a, b, c, d] = face.map(|node| {
                *vertex.entry(node).or_insert_with(|| {
                    let (element, corner) = carrier[node as usize].expect("of an element");
                    let mut weights = [0.0; 8];
                    weights[corner] = 1.0;
                    points.push(EmbeddedPoint { element, weights });
                    points.len() as u32 - 1
                })
            });
            triangles.extend([[a, b, c], [a, c, d]]);
        }
        Self { points, triangles }
    }

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
