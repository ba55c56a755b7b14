//! The broad phase: what is near at all, by trees of boxes.

use super::distance::{Kind, squared_distance};
use super::topology::Topology;
use super::tree::{Fitted, Motion, Moving, Tree};
use nalgebra::Vector3;
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Tests of boxes per task.
const CHUNK: usize = 64;

/// Distance of a point from the triangle that it is on, in edges.
const ROUNDOFF: f64 = 1e-12;

/// What may be near: indices of a vertex and a triangle, or of two edges.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Near {
    VertexTriangle(u32, u32),
    EdgeEdge(u32, u32),
}

/// One search: a motion, how near counts as near, and how much was found.
struct Search<'a> {
    topology: &'a Topology,
    motion: Motion<'a>,
    reach: f64,
    found: AtomicUsize,
    limit: usize,
}

impl<'a> Search<'a> {
    fn new(topology: &'a Topology, motion: Motion<'a>, reach: f64, limit: usize) -> Self {
        Self {
            topology,
            motion,
            reach,
            found: AtomicUsize::new(0),
            limit,
        }
    }

    fn triangles<'t>(&self, tree: &'t Tree) -> Fitted<'t> {
        tree.fit(&self.topology.triangles, &self.motion)
    }

    fn edges<'t>(&self, tree: &'t Tree) -> Fitted<'t> {
        tree.fit(&self.topology.edges, &self.motion)
    }

    /// The box around the way of a vertex, grown by the reach.
    fn vertex(&self, vertex: u32) -> Moving {
        self.motion.around(&[vertex], self.reach)
    }

    /// The box around the way of an edge, grown by the reach.
    fn edge(&self, edge: u32) -> Moving {
        let ends = &self.topology.edges[edge as usize];
        self.motion.around(ends, self.reach)
    }

    /// Appends what `keep` makes of all pairs of a part and what is in a tree from the part's place on, parts first to last.
    fn run<P: Send>(
        &self,
        parts: impl IndexedParallelIterator<Item = (usize, u32)>,
        around: impl Fn(&Self, u32) -> Moving + Sync,
        tree: &Fitted,
        keep: impl Fn(u32, u32) -> Option<P> + Sync,
        out: &mut Vec<P>,
    ) {
        let of = |(place, part): (usize, u32)| {
            let around = around(self, part);
            let mut near = Vec::new();
            if self.found.load(Ordering::Relaxed) <= self.limit {
                let mut count = 0;
                tree.after(place, &around, |leaf| {
                    count += 1;
                    near.extend(keep(part, leaf));
                });
                self.found.fetch_add(count, Ordering::Relaxed);
            }
            near
        };
        out.par_extend(parts.with_min_len(CHUNK).flat_map_iter(of));
    }
}

/// Parts that are looked for in all of a tree.
fn everywhere(parts: std::ops::Range<usize>) -> impl IndexedParallelIterator<Item = (usize, u32)> {
    parts.into_par_iter().map(|part| (0, part as u32))
}

/// Collects what `keep` makes of everything that comes near in a motion, in an order that depends on nothing else; `own` asks for what the surface
/// has of itself too. None where more than `limit` boxes meet.
pub(super) fn near<P: Send>(
    topology: &Topology,
    motion: Motion,
    reach: f64,
    own: bool,
    limit: usize,
    keep: impl Fn(Near) -> Option<P> + Sync,
) -> Option<Vec<P>> {
    let t = topology;
    let search = Search::new(t, motion, reach, limit);
    let mut out = Vec::new();
    let touched = |v: u32, triangle: u32| keep(Near::VertexTriangle(v, triangle));
    let crossed = |e: u32, f: u32| keep(Near::EdgeEdge(e.min(f), e.max(f)));
    let triangles = search.triangles(&t.trees.own_triangles);
    let (own_points, obstacle_points) = (0..t.own_points, t.own_points..t.rest.len());
    if own {
        let parts = everywhere(own_points.clone());
        search.run(parts, Search::vertex, &triangles, touched, &mut out);
    }
    if t.has_obstacles() {
        let obstacles = search.triangles(&t.trees.obstacle_triangles);
        let parts = everywhere(own_points);
        search.run(parts, Search::vertex, &obstacles, touched, &mut out);
        let parts = everywhere(obstacle_points);
        search.run(parts, Search::vertex, &triangles, touched, &mut out);
        let obstacles = search.edges(&t.trees.obstacle_edges);
        let parts = everywhere(0..t.own_edges);
        search.run(parts, Search::edge, &obstacles, crossed, &mut out);
    }
    if own {
        let edges = &t.trees.own_edges;
        // Each two once: from the place of the one that comes first in the tree.
        let leaves = edges.leaves();
        let parts = leaves.par_iter().map(|&(place, e)| (place + 1, e));
        search.run(parts, Search::edge, &search.edges(edges), crossed, &mut out);
    }
    (search.found.into_inner() <= limit).then_some(out)
}

/// All edges that pass through triangles at the positions `x`, by their indices.
pub(super) fn piercings(topology: &Topology, x: &[Vector3<f64>], own: bool) -> Vec<(u32, u32)> {
    let t = topology;
    let search = Search::new(t, Motion::at(x), 0.0, usize::MAX);
    let pierces = |e: u32, triangle: u32| {
        let (ends, corners) = (t.edges[e as usize], t.triangles[triangle as usize]);
        let [p, q] = ends.map(|p| x[p as usize]);
        let [a, b, c] = corners.map(|p| x[p as usize]);
        (t.may_touch(&ends, &corners) && pierce(&[p, q], &[a, b, c])).then_some((e, triangle))
    };
    let mut out = Vec::new();
    let triangles = search.triangles(&t.trees.own_triangles);
    let own_edges = 0..t.own_edges;
    if own {
        let parts = everywhere(own_edges.clone());
        search.run(parts, Search::edge, &triangles, pierces, &mut out);
    }
    if t.has_obstacles() {
        let parts = everywhere(t.own_edges..t.edges.len());
        search.run(parts, Search::edge, &triangles, pierces, &mut out);
        let obstacles = search.triangles(&t.trees.obstacle_triangles);
        search.run(
            everywhere(own_edges),
            Search::edge,
            &obstacles,
            pierces,
            &mut out,
        );
    }
    out
}

/// Whether a segment goes through the inside of a triangle. Where the two lie in one plane but for roundoff, they do not.
fn pierce(segment: &[Vector3<f64>; 2], triangle: &[Vector3<f64>; 3]) -> bool {
    let [p, q] = segment;
    let [a, b, c] = triangle;
    let normal = (b - a).cross(&(c - a));
    let sides = [p, q].map(|x| normal.dot(&(x - a)));
    if sides[0] * sides[1] >= 0.0 {
        return false;
    }
    let along = q - p;
    let crossing = p + along * (sides[0] / (sides[0] - sides[1]));
    let squared = squared_distance(Kind::VertexTriangle, &[crossing, *a, *b, *c]);
    let size = (b - a).norm_squared().max((c - a).norm_squared());
    squared <= ROUNDOFF * ROUNDOFF * size.max(along.norm_squared())
}

#[cfg(test)]
mod tests;
