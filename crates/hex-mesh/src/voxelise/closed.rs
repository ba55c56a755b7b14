//! Whether a surface is closed.

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::HexMeshError;

/// How many open edges an error names.
const NAMED_EDGES: usize = 8;

/// Refuses surfaces that have no inside: with a vertex that is not finite, or an edge with an odd number of triangles.
///
/// Vertices at exactly the same position count as one, because files split vertices at seams of texture or normals.
pub(crate) fn check_closed(
    vertices: &[Vector3<f64>],
    triangles: &[[u32; 3]],
) -> Result<(), HexMeshError> {
    let not_finite = |vertex: &Vector3<f64>| !vertex.iter().all(|x| x.is_finite());
    if let Some(vertex) = vertices.iter().position(not_finite) {
        return Err(HexMeshError::VertexNotFinite { vertex });
    }
    if odd_edges(triangles.iter().copied()).is_empty() {
        return Ok(());
    }
    let first = weld(vertices);
    let welded = |triangle: &[u32; 3]| triangle.map(|vertex| first[vertex as usize]);
    let edges = odd_edges(triangles.iter().map(welded));
    if edges.is_empty() {
        return Ok(());
    }
    Err(HexMeshError::OpenSurface {
        count: edges.len(),
        edges: edges.into_iter().take(NAMED_EDGES).collect(),
    })
}

/// For each vertex, the first vertex at the same position.
fn weld(vertices: &[Vector3<f64>]) -> Vec<u32> {
    // Adding 0 turns -0 into +0.
    let key = |vertex: u32| {
        let [x, y, z]: [f64; 3] = vertices[vertex as usize].into();
        [
            (x + 0.0).to_bits(),
            (y + 0.0).to_bits(),
            (z + 0.0).to_bits(),
        ]
    };
    let mut order: Vec<u32> = (0..vertices.len() as u32).collect();
    order.par_sort_unstable_by_key(|&vertex| (key(vertex), vertex));
    let mut first = vec![0; vertices.len()];
    for same in order.chunk_by(|&a, &b| key(a) == key(b)) {
        for &vertex in same {
            first[vertex as usize] = same[0];
        }
    }
    first
}

/// The edges with an odd number of triangles, each as a rising pair of vertices.
fn odd_edges(triangles: impl Iterator<Item = [u32; 3]>) -> Vec<[u32; 2]> {
    let mut edges: Vec<u64> = triangles
        .flat_map(|[a, b, c]| [[a, b], [b, c], [c, a]])
        .filter(|[a, b]| a != b)
        .map(|[a, b]| u64::from(a.min(b)) << 32 | u64::from(a.max(b)))
        .collect();
    edges.par_sort_unstable();
    edges
        .chunk_by(|a, b| a == b)
        .filter(|same| same.len() % 2 == 1)
        .map(|same| [(same[0] >> 32) as u32, same[0] as u32])
        .collect()
}
