//! The broad phase: what is near at all, by trees of boxes.

use super::distance::{Kind, Nearest};
use super::topology::Topology;
use nalgebra::Vector3;
use parry3d_f64::bounding_volume::Aabb;
use parry3d_f64::math::Vector;
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Tests of boxes per task.
const CHUNK: usize = 64;

/// Distance of a point from the triangle that it is on, in edges.
const ROUNDOFF: f64 = 1e-12;

/// Points that move along straight lines, and how near counts as near.
#[derive(Clone, Copy)]
pub(super) struct Motion<'a> {
    pub(super) from: &'a [Vector3<f64>],
    pub(super) to: &'a [Vector3<f64>],
    pub(super) reach: f64,
}

impl<'a> Motion<'a> {
    /// No motion.
    pub(super) fn at(x: &'a [Vector3<f64>], reach: f64) -> Self {
        Self {
            from: x,
            to: x,
            reach,
        }
    }

    /// The box around the ways of some points, `grown` on all sides.
    fn around(&self, points: &[u32], grown: f64) -> Aabb {
        let (mut low, mut high) = (
            Vector3::repeat(f64::INFINITY),
            Vector3::repeat(f64::NEG_INFINITY),
        );
        for &p in points {
            for x in [&self.from[p as usize], &self.to[p as usize]] {
                (low, high) = (low.inf(x), high.sup(x));
            }
        }
        let grown = Vector::splat(grown);
        let vector = |x: Vector3<f64>| Vector::new(x.x, x.y, x.z);
        Aabb::new(vector(low) - grown, vector(high) + grown)
    }

    fn tree<const N: usize>(&self, parts: &[[u32; N]]) -> Bvh {
        let boxes: Vec<Aabb> = (parts.par_iter().with_min_len(CHUNK))
            .map(|part| self.around(part, 0.0))
            .collect();
        Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes)
    }
}

/// What may be near: indices of a vertex and a triangle, of two edges, or of an edge and a triangle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Near {
    VertexTriangle(u32, u32),
    EdgeEdge(u32, u32),
}

/// One search: a motion, its trees, and how much was found.
struct Search<'a> {
    topology: &'a Topology,
    motion: Motion<'a>,
    found: AtomicUsize,
    limit: usize,
}

impl Search<'_> {
    /// Appends what `keep` makes of all pairs of a part and a leaf of a tree, parts first to last.
    fn run<const N: usize, P: Send>(
        &self,
        parts: (Range<usize>, impl Fn(u32) -> [u32; N] + Sync),
        tree: &Bvh,
        keep: impl Fn(u32, u32) -> Option<P> + Sync,
        out: &mut Vec<P>,
    ) {
        let (range, points) = parts;
        if tree.is_empty() || range.is_empty() {
            return;
        }
        let of = |part: usize| {
            let part = part as u32;
            let around = self.motion.around(&points(part), self.motion.reach);
            let mut near = Vec::new();
            if self.found.load(Ordering::Relaxed) <= self.limit {
                let mut count = 0;
                near.extend(tree.intersect_aabb(&around).filter_map(|leaf| {
                    count += 1;
                    keep(part, leaf)
                }));
                self.found.fetch_add(count, Ordering::Relaxed);
            }
            near
        };
        out.par_extend((range.into_par_iter().with_min_len(CHUNK)).flat_map_iter(of));
    }
}

/// Collects what `keep` makes of everything that comes near in a motion, in an order that depends on nothing else; `own` asks for what the surface
/// has of itself too. None where more than `limit` boxes meet.
pub(super) fn near<P: Send>(
    topology: &Topology,
    motion: Motion,
    own: bool,
    limit: usize,
    keep: impl Fn(Near) -> Option<P> + Sync,
) -> Option<Vec<P>> {
    let search = Search {
        topology,
        motion,
        found: AtomicUsize::new(0),
        limit,
    };
    let t = search.topology;
    let (own_triangles, obstacles) = t.triangles.split_at(t.own_triangles);
    let (own_edges, obstacle_edges) = t.edges.split_at(t.own_edges);
    let mut out = Vec::new();
    let vertex = |v: u32| [v];
    let edge = |e: u32| t.edges[e as usize];
    let triangle = motion.tree(own_triangles);
    let all_points = t.rest.len();
    let mut vertices = |points: Range<usize>, tree: &Bvh, first: usize| {
        let keep = |v: u32, leaf: u32| keep(Near::VertexTriangle(v, leaf + first as u32));
        search.run((points, vertex), tree, keep, &mut out);
    };
    if own {
        vertices(0..t.own_points, &triangle, 0);
    }
    if !obstacles.is_empty() {
        vertices(0..t.own_points, &motion.tree(obstacles), t.own_triangles);
        vertices(t.own_points..all_points, &triangle, 0);
        let tree = motion.tree(obstacle_edges);
        let first = t.own_edges as u32;
        let keep = |e: u32, leaf: u32| keep(Near::EdgeEdge(e, leaf + first));
        search.run((0..t.own_edges, edge), &tree, keep, &mut out);
    }
    if own {
        let keep = |e: u32, f: u32| (e < f).then(|| keep(Near::EdgeEdge(e, f))).flatten();
        search.run(
            (0..t.own_edges, edge),
            &motion.tree(own_edges),
            keep,
            &mut out,
        );
    }
    (search.found.into_inner() <= limit).then_some(out)
}

/// All edges that pass through triangles at the positions `x`, by their indices.
pub(super) fn piercings(topology: &Topology, x: &[Vector3<f64>], own: bool) -> Vec<(u32, u32)> {
    let t = topology;
    let motion = Motion::at(x, 0.0);
    let search = Search {
        topology: t,
        motion,
        found: AtomicUsize::new(0),
        limit: usize::MAX,
    };
    let (own_triangles, obstacles) = t.triangles.split_at(t.own_triangles);
    let edge = |e: u32| t.edges[e as usize];
    let pierces = |e: u32, triangle: u32| {
        let (ends, corners) = (edge(e), t.triangles[triangle as usize]);
        let [p, q] = ends.map(|p| x[p as usize]);
        let [a, b, c] = corners.map(|p| x[p as usize]);
        (t.may_touch(&ends, &corners) && pierce(&[p, q], &[a, b, c])).then_some((e, triangle))
    };
    let mut out = Vec::new();
    let tree = motion.tree(own_triangles);
    if own {
        search.run((0..t.own_edges, edge), &tree, pierces, &mut out);
    }
    if !obstacles.is_empty() {
        search.run((t.own_edges..t.edges.len(), edge), &tree, pierces, &mut out);
        let tree = motion.tree(obstacles);
        let first = t.own_triangles as u32;
        let pierces = |e: u32, leaf: u32| pierces(e, leaf + first);
        search.run((0..t.own_edges, edge), &tree, pierces, &mut out);
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
    let nearest = Nearest::of(Kind::VertexTriangle, &[crossing, *a, *b, *c]);
    let size = (b - a).norm_squared().max((c - a).norm_squared());
    nearest.squared() <= ROUNDOFF * ROUNDOFF * size.max(along.norm_squared())
}
