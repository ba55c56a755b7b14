//! Points carried by the mesh: a skin, a bone, a marker.

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::nearest::ElementFinder;
use crate::{HexMesh, HexMeshError, trilinear_weights};

/// One embedded point: `x = sum_c weights[c] * nodes[elements[element][c]]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EmbeddedPoint {
    /// The element that carries the point.
    pub element: u32,
    /// Trilinear weights of its corners; they sum to 1, and some are negative when the point lies outside the element.
    pub weights: [f64; 8],
}

/// Points tied to a mesh by trilinear weights, made by [`embed`]: a linear map `W` from node positions to point positions.
#[derive(Debug, Clone, PartialEq)]
pub struct Embedding {
    vertices: Vec<EmbeddedPoint>,
    max_outside_distance: f64,
    /// Start of each node's row in `uses`: `[nodes + 1]`.
    use_offsets: Vec<usize>,
    /// Per node, the entries `8 * vertex + corner` that refer to it, rising.
    uses: Vec<usize>,
}

/// Ties points to a mesh.
///
/// A point inside an element (or on its boundary) is interpolated there. A point outside all elements goes to the element whose
/// cube is nearest, the lowest index among equals, with extrapolated trilinear weights: they still sum to 1 and reproduce the
/// point exactly, but some are negative. [`Embedding::max_outside_distance`] tells how far that went.
///
/// # Errors
/// [`HexMeshError::PointNotFinite`].
pub fn embed(mesh: &HexMesh, points: &[Vector3<f64>]) -> Result<Embedding, HexMeshError> {
    check_finite(points)?;
    let finder = ElementFinder::new(mesh);
    let nearest = |point| finder.nearest(point).0 as u32;
    let elements: Vec<u32> = points.par_iter().map(nearest).collect();
    Ok(Embedding::new(mesh, points, &elements))
}

/// Ties points to given elements, one for each point, with trilinear weights: extrapolated where the point lies outside its element.
///
/// # Errors
/// [`HexMeshError::PointNotFinite`].
///
/// # Panics
/// When `elements` does not have one entry per point, or an entry is not an element of the mesh.
pub fn embed_in(
    mesh: &HexMesh,
    points: &[Vector3<f64>],
    elements: &[u32],
) -> Result<Embedding, HexMeshError> {
    assert_eq!(points.len(), elements.len(), "one element per point");
    check_finite(points)?;
    Ok(Embedding::new(mesh, points, elements))
}

fn check_finite(points: &[Vector3<f64>]) -> Result<(), HexMeshError> {
    let not_finite = |point: &Vector3<f64>| !point.iter().all(|x| x.is_finite());
    match points.iter().position(not_finite) {
        Some(point) => Err(HexMeshError::PointNotFinite { point }),
        None => Ok(()),
    }
}

impl Embedding {
    fn new(mesh: &HexMesh, points: &[Vector3<f64>], elements: &[u32]) -> Self {
        let size = mesh.element_size();
        let embedded = |(point, &element): (&Vector3<f64>, &u32)| {
            let xi = (point - mesh.element_corner(element as usize)) / size;
            let outside = xi - xi.map(|x| x.clamp(0.0, 1.0));
            let weights = trilinear_weights(&xi);
            (EmbeddedPoint { element, weights }, outside.norm() * size)
        };
        let points = points.par_iter().zip(elements);
        let (vertices, distances): (Vec<_>, Vec<f64>) = points.map(embedded).unzip();
        let max_outside_distance = distances.into_iter().fold(0.0, f64::max);
        let nodes = |vertex: &EmbeddedPoint| mesh.elements()[vertex.element as usize];
        let mut use_offsets = vec![0; mesh.nodes().len() + 1];
        for node in vertices.iter().flat_map(nodes) {
            use_offsets[node as usize + 1] += 1;
        }
        for node in 0..mesh.nodes().len() {
            use_offsets[node + 1] += use_offsets[node];
        }
        let mut next = use_offsets.clone();
        let mut uses = vec![0; 8 * vertices.len()];
        for (entry, node) in vertices.iter().flat_map(nodes).enumerate() {
            uses[next[node as usize]] = entry;
            next[node as usize] += 1;
        }
        Self {
            vertices,
            max_outside_distance,
            use_offsets,
            uses,
        }
    }

    /// The embedded points, in the order in which they were given.
    #[must_use]
    pub fn vertices(&self) -> &[EmbeddedPoint] {
        &self.vertices
    }

    /// Number of embedded points.
    #[must_use]
    pub fn len(&self) -> usize {
        self.vertices.len()
    }

    /// Whether no point is embedded.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.vertices.is_empty()
    }

    /// The largest distance of a point from the cube that carries it; 0 when all points are inside.
    #[must_use]
    pub fn max_outside_distance(&self) -> f64 {
        self.max_outside_distance
    }

    /// Positions of the points when the nodes are at `nodes`: `W nodes`.
    ///
    /// # Panics
    /// When `nodes` does not have one entry per node of `mesh`, or `mesh` is not the mesh of this embedding.
    #[must_use]
    pub fn positions(&self, nodes: &[Vector3<f64>], mesh: &HexMesh) -> Vec<Vector3<f64>> {
        let mut positions = vec![Vector3::zeros(); self.len()];
        self.positions_into(nodes, mesh, &mut positions);
        positions
    }

    /// Like [`Embedding::positions`], overwriting `positions`.
    ///
    /// # Panics
    /// When `nodes` does not have one entry per node of `mesh`, `positions` not one per point, or `mesh` is not the mesh of this
    /// embedding.
    pub fn positions_into(
        &self,
        nodes: &[Vector3<f64>],
        mesh: &HexMesh,
        positions: &mut [Vector3<f64>],
    ) {
        assert_eq!(mesh.nodes().len(), self.node_count(), "another mesh");
        assert_eq!(nodes.len(), self.node_count(), "one position per node");
        assert_eq!(positions.len(), self.len(), "one position per point");
        let vertices = self.vertices.par_iter().with_min_len(MIN_PARALLEL);
        vertices.zip(positions).for_each(|(vertex, position)| {
            let corners = mesh.elements()[vertex.element as usize];
            let terms = corners.iter().zip(&vertex.weights);
            *position = terms.map(|(&node, &w)| nodes[node as usize] * w).sum();
        });
    }

    /// The exact transpose of [`Embedding::positions_into`]: `node_bar = W^T vertex_bar`, overwriting `node_bar`.
    ///
    /// Each node sums its own terms in one fixed order, so the result does not depend on the number of threads.
    ///
    /// # Panics
    /// When `vertex_bar` does not have one entry per point, or `node_bar` not one per node of the mesh.
    pub fn transpose_into(&self, vertex_bar: &[Vector3<f64>], node_bar: &mut [Vector3<f64>]) {
        assert_eq!(vertex_bar.len(), self.len(), "one cotangent per point");
        assert_eq!(node_bar.len(), self.node_count(), "one cotangent per node");
        let rows = self.use_offsets.par_windows(2).with_min_len(MIN_PARALLEL);
        rows.zip(node_bar).for_each(|(row, bar)| {
            let uses = self.uses[row[0]..row[1]].iter();
            *bar = uses
                .map(|entry| vertex_bar[entry / 8] * self.vertices[entry / 8].weights[entry % 8])
                .sum();
        });
    }

    fn node_count(&self) -> usize {
        self.use_offsets.len() - 1
    }
}

/// Points or nodes that one thread takes at least: handing over fewer costs more than it saves.
const MIN_PARALLEL: usize = 1024;
