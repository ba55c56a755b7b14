//! What is wrong with a surface, where, and how to mend it.

mod display;
mod edges;
mod pieces;

use std::cmp::Ordering;

use nalgebra::Vector3;

use crate::surface::doubled_area;
use crate::{Surface, SurfaceError};

/// A polygon side, shared or not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edge {
    /// Vertex indices from 0, the lower one first.
    pub vertices: [u32; 2],
    /// Positions of these vertices.
    pub positions: [Vector3<f64>; 2],
    /// How many polygon sides run along it.
    pub uses: usize,
}

/// A connected piece of a surface: polygons joined by common vertices.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Component {
    /// The lowest vertex index in the piece.
    pub first_vertex: u32,
    /// Number of vertices.
    pub vertices: usize,
    /// Number of polygons.
    pub polygons: usize,
    /// Signed volume, as [`Surface::signed_volume`]. A cavity inside a larger piece is rightly negative.
    pub signed_volume: f64,
}

/// What [`report`] found. Its `Display` is a short text for people.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceReport {
    /// Number of vertices.
    pub vertices: usize,
    /// Number of polygons.
    pub polygons: usize,
    /// Number of triangles in the fan triangulation.
    pub triangles: usize,
    /// Edges with an odd number of polygons: the border of a hole, mostly. A ray can slip in or out there.
    pub open_edges: Vec<Edge>,
    /// Number of connected groups of open edges: the number of holes, when holes do not touch.
    pub open_loops: usize,
    /// Edges with more than two polygons. One with three is open as well.
    pub non_manifold_edges: Vec<Edge>,
    /// Edges whose two polygons run along them in the same direction: one of the two is turned over.
    pub inconsistent_edges: Vec<Edge>,
    /// Connected pieces, by rising first vertex.
    pub components: Vec<Component>,
    /// Polygons without area, or with a corner that is repeated.
    pub degenerate_polygons: Vec<usize>,
    /// Vertices no polygon uses.
    pub unused_vertices: Vec<u32>,
    /// Vertices at exactly the position of one with a lower index.
    pub duplicate_vertices: Vec<u32>,
    /// Signed volume, as [`Surface::signed_volume`].
    pub signed_volume: f64,
}

/// Examines a surface. Cost is about linear in its size.
pub fn report(surface: &Surface) -> SurfaceReport {
    let edges = edges::examine(surface);
    let used = used_vertices(surface);
    SurfaceReport {
        vertices: surface.vertex_count(),
        polygons: surface.polygon_count(),
        triangles: surface.triangles().len(),
        open_loops: pieces::open_loops(surface.vertex_count(), &edges.open),
        open_edges: edges.open,
        non_manifold_edges: edges.non_manifold,
        inconsistent_edges: edges.inconsistent,
        components: pieces::components(surface),
        degenerate_polygons: degenerate_polygons(surface),
        unused_vertices: (0..used.len() as u32)
            .filter(|&vertex| !used[vertex as usize])
            .collect(),
        duplicate_vertices: duplicate_vertices(surface.vertices()),
        signed_volume: surface.signed_volume(),
    }
}

impl SurfaceReport {
    /// Whether the surface encloses a volume: no open edges. Pieces may touch (non-manifold edges with an even number of
    /// polygons) or be turned over.
    pub fn is_closed(&self) -> bool {
        self.open_edges.is_empty()
    }

    /// Whether the surface bounds a solid: closed, two polygons at every edge, turned the same way, and facing outwards.
    pub fn is_solid(&self) -> bool {
        self.is_closed()
            && self.non_manifold_edges.is_empty()
            && self.inconsistent_edges.is_empty()
            && self.signed_volume > 0.0
    }

    /// Whether the surface is closed and consistently turned, but faces inwards.
    pub fn is_inside_out(&self) -> bool {
        self.is_closed() && self.inconsistent_edges.is_empty() && self.signed_volume < 0.0
    }

    /// Demands a closed surface; `file_name` is what the error calls it.
    ///
    /// # Errors
    /// [`SurfaceError::NotClosed`] with the number of open edges and one of them.
    pub fn require_closed(&self, file_name: &str) -> Result<(), SurfaceError> {
        match self.open_edges.first() {
            Some(edge) => Err(SurfaceError::NotClosed {
                file: file_name.into(),
                open_edges: self.open_edges.len(),
                edge: edge.vertices,
                positions: edge.positions,
            }),
            None => Ok(()),
        }
    }
}

fn used_vertices(surface: &Surface) -> Vec<bool> {
    let mut used = vec![false; surface.vertex_count()];
    for &corner in surface.polygons().flatten() {
        used[corner as usize] = true;
    }
    used
}

fn degenerate_polygons(surface: &Surface) -> Vec<usize> {
    let mut first_triangle = 0;
    let mut degenerate = Vec::new();
    for (index, polygon) in surface.polygons().enumerate() {
        let end = first_triangle + polygon.len() - 2;
        if repeats_a_corner(polygon)
            || has_no_area(surface, &surface.triangles()[first_triangle..end])
        {
            degenerate.push(index);
        }
        first_triangle = end;
    }
    degenerate
}

fn repeats_a_corner(polygon: &[u32]) -> bool {
    if polygon.len() <= 8 {
        return (1..polygon.len()).any(|i| polygon[..i].contains(&polygon[i]));
    }
    let mut sorted = polygon.to_vec();
    sorted.sort_unstable();
    sorted.windows(2).any(|pair| pair[0] == pair[1])
}

fn has_no_area(surface: &Surface, triangles: &[[u32; 3]]) -> bool {
    // Rounding leaves a cross product of about 1e-16 of the squared lengths; real slivers are far above.
    const RELATIVE: f64 = 1e-14;
    triangles.iter().all(|&triangle| {
        let points = surface.triangle_points(triangle);
        let [a, b, c] = &points;
        let longest = (b - a).amax().max((c - a).amax()).max((c - b).amax());
        doubled_area(&points).amax() <= RELATIVE * longest * longest
    })
}

fn duplicate_vertices(vertices: &[Vector3<f64>]) -> Vec<u32> {
    // Adding zero makes -0 and 0 the same.
    let mut order: Vec<([f64; 3], u32)> = (vertices.iter().zip(0..))
        .map(|(vertex, index)| ([vertex.x + 0.0, vertex.y + 0.0, vertex.z + 0.0], index))
        .collect();
    order.sort_unstable_by(|(a, i), (b, j)| {
        a.partial_cmp(b).unwrap_or(Ordering::Equal).then(i.cmp(j))
    });
    let mut duplicates: Vec<u32> = order
        .windows(2)
        .filter(|pair| pair[0].0 == pair[1].0)
        .map(|pair| pair[1].1)
        .collect();
    duplicates.sort_unstable();
    duplicates
}
