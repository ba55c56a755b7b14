//! What can touch: vertices, edges and triangles of the surface and of obstacles, and the areas that they stand for.

use super::barrier::Barrier;
use super::broad::Near;
use super::distance::{Kind, Quad, squared_distance};
use super::tree::Trees;
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// A pair nearer at rest than the barrier's distance has a barrier that begins at this share of its distance at rest.
const OF_REST: f64 = 0.5;
/// Distance at rest, in shares of the barrier's, below which two things count as one: seams of a surface whose vertices are doubled.
const ONE: f64 = 1e-6;
/// Share of the area that a pair of the surface with itself stands for: faces are seen by the vertices of either, and by edges.
const OWN: f64 = 1.0 / 3.0;
/// Triangles stand at least for this share of the mean area, and edges are at least this share of the mean length.
const DEGENERATE: f64 = 1e-3;
/// The share of `|e1|^2 |e2|^2` at rest below which edges are nearly parallel (Li et al. 2020).
const PARALLEL: f64 = 1e-3;

/// Two things that may touch, by their four points, and how they resist.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pair {
    pub(super) points: [u32; 4],
    pub(super) barrier: Barrier,
}

impl Pair {
    pub(super) fn gather(&self, x: &[Vector3<f64>]) -> Quad {
        self.points.map(|p| x[p as usize])
    }
}

/// The surface of the body, and after it the obstacles.
pub(super) struct Topology {
    /// Points of the body's surface; from here on, of obstacles.
    pub(super) own_points: usize,
    pub(super) triangles: Vec<[u32; 3]>,
    pub(super) own_triangles: usize,
    pub(super) edges: Vec<[u32; 2]>,
    pub(super) own_edges: usize,
    /// Positions of all points at rest.
    pub(super) rest: Vec<Vector3<f64>>,
    /// The first point at the same place at rest: seams are no gaps.
    same: Vec<u32>,
    /// Points of triangles that pass through each other at rest.
    pub(super) left_out: Vec<bool>,
    /// Areas at rest that points, triangles and edges stand for.
    point_areas: Vec<f64>,
    triangle_areas: Vec<f64>,
    edge_areas: Vec<f64>,
    pub(super) trees: Trees,
    dhat: f64,
    stiffness: f64,
}

impl Topology {
    /// `triangles` of the body, of whose points there are `own_points`, come before those of obstacles.
    pub(super) fn new(
        rest: Vec<Vector3<f64>>,
        own_points: usize,
        triangles: Vec<[u32; 3]>,
        own_triangles: usize,
        (dhat, stiffness): (f64, f64),
    ) -> Self {
        let area = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|p| rest[p as usize]);
            0.5 * (b - a).cross(&(c - a)).norm()
        };
        let mut triangle_areas: Vec<f64> = triangles.iter().map(area).collect();
        let mean = triangle_areas.iter().sum::<f64>() / triangle_areas.len().max(1) as f64;
        let least = DEGENERATE * mean;
        triangle_areas.iter_mut().for_each(|a| *a = a.max(least));
        let mut point_areas = vec![0.0; rest.len()];
        // Own edges first: their points have the lower numbers.
        let mut edges: BTreeMap<[u32; 2], f64> = BTreeMap::new();
        for (t, area) in triangles.iter().zip(&triangle_areas) {
            for k in 0..3 {
                point_areas[t[k] as usize] += area / 3.0;
                let (a, b) = (t[k], t[(k + 1) % 3]);
                *edges.entry([a.min(b), a.max(b)]).or_default() += area / 3.0;
            }
        }
        let (edges, edge_areas): (Vec<[u32; 2]>, Vec<f64>) = edges.into_iter().unzip();
        let is_own = |e: &&[u32; 2]| (e[0] as usize) < own_points;
        let own_edges = edges.iter().take_while(is_own).count();
        Self {
            own_edges,
            trees: Trees::new(&triangles, &edges, [own_triangles, own_edges], &rest),
            same: welded(&rest),
            left_out: vec![false; rest.len()],
            own_points,
            triangles,
            own_triangles,
            edges,
            rest,
            point_areas,
            triangle_areas,
            edge_areas,
            dhat,
            stiffness,
        }
    }

    pub(super) fn is_own(&self, point: u32) -> bool {
        (point as usize) < self.own_points
    }

    pub(super) fn has_obstacles(&self) -> bool {
        self.triangles.len() > self.own_triangles
    }

    /// Whether two things can touch at all: they share no point, are not both obstacles, and not left out.
    pub(super) fn may_touch(&self, a: &[u32], b: &[u32]) -> bool {
        let own = [a, b].map(|points| self.is_own(points[0]));
        if own == [false, false] {
            return false;
        }
        if own != [true, true] {
            return true;
        }
        let out = |p: &u32| self.left_out[*p as usize];
        let one = |p: &u32, q: &u32| self.same[*p as usize] == self.same[*q as usize];
        !a.iter().chain(b).any(out) && !a.iter().any(|p| b.iter().any(|q| one(p, q)))
    }

    /// The points of what is near, where that can touch.
    pub(super) fn points_of(&self, near: Near) -> Option<(Kind, [u32; 4])> {
        let (kind, points, first) = match near {
            Near::VertexTriangle(vertex, triangle) => {
                let [a, b, c] = self.triangles[triangle as usize];
                (Kind::VertexTriangle, [vertex, a, b, c], 1)
            }
            Near::EdgeEdge(e, f) => {
                let ([a, b], [c, d]) = (self.edges[e as usize], self.edges[f as usize]);
                (Kind::EdgeEdge, [a, b, c, d], 2)
            }
        };
        let (one, other) = points.split_at(first);
        self.may_touch(one, other).then_some((kind, points))
    }

    /// What is near, as a pair, where it can touch.
    pub(super) fn pair(&self, near: Near) -> Option<Pair> {
        let (kind, points) = self.points_of(near)?;
        let (area, parallel) = match near {
            Near::VertexTriangle(vertex, triangle) => {
                let area = 2.0 * self.triangle_areas[triangle as usize];
                (area.min(self.point_areas[vertex as usize]), 0.0)
            }
            Near::EdgeEdge(e, f) => {
                let area = self.edge_areas[e as usize].min(self.edge_areas[f as usize]);
                let square = |[p, q]: [u32; 2]| {
                    let edge = self.rest[p as usize] - self.rest[q as usize];
                    edge.norm_squared().max(DEGENERATE * area)
                };
                let squares = square(self.edges[e as usize]) * square(self.edges[f as usize]);
                (0.5 * area, PARALLEL * squares)
            }
        };
        // A vertex of no triangle is none.
        if area <= 0.0 {
            return None;
        }
        let dhat = self.begins(kind, &points)?;
        let share = match points.iter().all(|&p| self.is_own(p)) {
            true => OWN,
            false => 1.0,
        };
        let barrier = Barrier {
            kind,
            strength: self.stiffness * area * share,
            dhat,
            parallel,
        };
        Some(Pair { points, barrier })
    }

    /// The distance at which the barrier of a pair begins; none where it is one thing.
    fn begins(&self, kind: Kind, points: &[u32; 4]) -> Option<f64> {
        if !points.iter().all(|&p| self.is_own(p)) {
            return Some(self.dhat);
        }
        let at_rest = squared_distance(kind, &points.map(|p| self.rest[p as usize]));
        match at_rest.sqrt() {
            d if d <= ONE * self.dhat => None,
            d if d < self.dhat => Some(OF_REST * d),
            _ => Some(self.dhat),
        }
    }

    /// What a plane feels of a vertex.
    pub(super) fn strength(&self, point: usize) -> f64 {
        self.stiffness * self.point_areas[point]
    }

    /// Mean length of the body's edges at rest.
    pub(super) fn mean_edge(&self) -> f64 {
        let own = &self.edges[..self.own_edges];
        let length = |e: &[u32; 2]| (self.rest[e[0] as usize] - self.rest[e[1] as usize]).norm();
        own.iter().map(length).sum::<f64>() / own.len().max(1) as f64
    }

    pub(super) fn bytes(&self) -> usize {
        let points = size_of::<Vector3<f64>>() + size_of::<u32>() + 1 + size_of::<f64>();
        size_of_val(&self.triangles[..])
            + size_of_val(&self.triangle_areas[..])
            + size_of_val(&self.edges[..])
            + size_of_val(&self.edge_areas[..])
            + points * self.rest.len()
            + self.trees.bytes()
    }
}

/// The first point at the place of each.
fn welded(x: &[Vector3<f64>]) -> Vec<u32> {
    let mut first: BTreeMap<[u64; 3], u32> = BTreeMap::new();
    // Adding zero makes one of the two zeros.
    let key = |x: &Vector3<f64>| [x.x, x.y, x.z].map(|x| (x + 0.0).to_bits());
    let points = x.iter().zip(0..);
    points
        .map(|(x, i)| *first.entry(key(x)).or_insert(i))
        .collect()
}

#[cfg(test)]
mod tests;
