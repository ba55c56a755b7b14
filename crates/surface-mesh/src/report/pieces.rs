//! Connected pieces and connected groups of open edges.

use super::{Component, Edge};
use crate::Surface;
use crate::surface::cone_volume;

/// A forest in which every vertex of a piece leads to the piece's lowest vertex.
struct DisjointSets(Vec<u32>);

impl DisjointSets {
    fn new(count: usize) -> Self {
        Self((0..count as u32).collect())
    }

    fn root(&mut self, mut vertex: u32) -> u32 {
        while self.0[vertex as usize] != vertex {
            let parent = self.0[vertex as usize];
            self.0[vertex as usize] = self.0[parent as usize];
            vertex = parent;
        }
        vertex
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b) as usize] = a.min(b);
    }

    /// The lowest vertex of every vertex's piece.
    fn into_roots(mut self) -> Vec<u32> {
        // A parent is never above its child, so its root is known before the child is met.
        for vertex in 0..self.0.len() {
            self.0[vertex] = self.0[self.0[vertex] as usize];
        }
        self.0
    }
}

/// The connected pieces, by rising lowest vertex.
pub(super) fn components(surface: &Surface) -> Vec<Component> {
    let mut sets = DisjointSets::new(surface.vertex_count());
    for polygon in surface.polygons() {
        for &corner in &polygon[1..] {
            sets.join(polygon[0], corner);
        }
    }
    let roots = sets.into_roots();
    let mut pieces: Vec<Component> = Vec::new();
    // The place of each piece in `pieces`, under its lowest vertex.
    let mut places = vec![0; surface.vertex_count()];
    for (vertex, &root) in roots.iter().enumerate() {
        if vertex == root as usize {
            places[vertex] = pieces.len();
            pieces.push(Component {
                first_vertex: root,
                vertices: 0,
                polygons: 0,
                signed_volume: 0.0,
            });
        }
        pieces[places[root as usize]].vertices += 1;
    }
    let place = |vertex: u32| places[roots[vertex as usize] as usize];
    for polygon in surface.polygons() {
        pieces[place(polygon[0])].polygons += 1;
    }
    let (low, high) = surface.bounding_box();
    let origin = (low + high) / 2.0;
    for &triangle in surface.triangles() {
        pieces[place(triangle[0])].signed_volume +=
            cone_volume(&surface.triangle_points(triangle), &origin);
    }
    // What is left without polygons are unused vertices.
    pieces.retain(|piece| piece.polygons > 0);
    pieces
}

/// The number of connected groups of open edges.
pub(super) fn open_loops(vertices: usize, open: &[Edge]) -> usize {
    if open.is_empty() {
        return 0;
    }
    let mut sets = DisjointSets::new(vertices);
    for edge in open {
        sets.join(edge.vertices[0], edge.vertices[1]);
    }
    let mut roots: Vec<u32> = (open.iter())
        .map(|edge| sets.root(edge.vertices[0]))
        .collect();
    roots.sort_unstable();
    roots.dedup();
    roots.len()
}
