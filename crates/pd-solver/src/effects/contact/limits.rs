//! How far points may move, and whether they are where they may be.

use super::broad::piercings;
use super::ccd::Least;
use super::distance::{Kind, Quad, squared_distance};
use super::topology::Pair;
use super::{CHUNK, Contact};
use crate::error::SolverError;
use nalgebra::Vector3;
use rayon::prelude::*;

/// Share of the distance from a plane that a motion keeps.
const KEPT: f64 = 0.1;
/// Boxes that may meet per point before a motion counts as too long to be looked at as a whole.
const CROWDED: usize = 300;
/// Shorter shares of a motion are looked at however many boxes meet.
const SHORTEST: f64 = 1e-3;
/// A distance, in shares of the barrier's, that is none.
const TOUCHING: f64 = 1e-12;

impl Contact {
    /// The share of a straight motion of all points within which nothing passes through anything, and every distance keeps a tenth of itself.
    pub(super) fn free_share(&mut self, from: &[Vector3<f64>], to: &[Vector3<f64>]) -> f64 {
        if !to.iter().all(|x| x.iter().all(|x| x.is_finite())) {
            return 1.0;
        }
        let mut considered = self.share_above_planes(from, to);
        let reach = self.reach();
        self.list.prepare(&self.topology, from, reach);
        // Pairs that are near already limit most motions; what is left of them sweeps little.
        considered = self.free_of_pairs(from, to, considered);
        if self.list.serves(to, self.margin) {
            return considered;
        }
        // The list of all that comes near on the way serves for what is next: energies on it, and the Hessian at its end.
        let crowded = CROWDED * self.topology.rest.len();
        let mut end = to.to_vec();
        loop {
            let ways = from.iter().zip(to);
            let along = ways.map(|(a, b)| a + (b - a) * considered);
            end.iter_mut().zip(along).for_each(|(end, x)| *end = x);
            let limit = match considered > SHORTEST {
                true => crowded,
                false => usize::MAX,
            };
            if self.list.search(&self.topology, from, &end, reach, limit) {
                let share = self.free_of_pairs(from, &end, 1.0);
                self.list.shorten(share, self.margin);
                return considered * share;
            }
            considered *= 0.5;
        }
    }

    /// The share of a motion, at most `limit`, within which the pairs in the list keep a tenth of their distances.
    fn free_of_pairs(&self, from: &[Vector3<f64>], to: &[Vector3<f64>], limit: f64) -> f64 {
        let least = Least::new(limit);
        let pairs = self.list.pairs.par_iter().with_min_len(CHUNK);
        pairs.for_each(|pair| {
            let x: Quad = pair.gather(from);
            let way = pair.points.map(|p| to[p as usize] - from[p as usize]);
            least.see(pair.barrier.kind, &x, &way);
        });
        least.share()
    }

    fn share_above_planes(&self, from: &[Vector3<f64>], to: &[Vector3<f64>]) -> f64 {
        let mut share = 1.0_f64;
        for plane in &self.planes {
            for (from, to) in from.iter().zip(to).take(self.topology.own_points) {
                let (start, end) = (plane.distance(from), plane.distance(to));
                if end < KEPT * start {
                    share = share.min((1.0 - KEPT) * start / (start - end));
                }
            }
        }
        share
    }

    /// The first thing that passes through another, but for what is left out. The list of pairs has to serve.
    pub(super) fn find_intersection(&self, x: &[Vector3<f64>]) -> Option<SolverError> {
        for plane in &self.planes {
            let own = &x[..self.topology.own_points];
            let below = own
                .iter()
                .position(|x| plane.distance(x) <= TOUCHING * self.dhat);
            if let Some(point) = below {
                let triangle = self.triangle_with(&[point as u32]);
                let what = format!("the plane that is obstacle {}", plane.obstacle);
                return Some(self.intersects(triangle, what, &x[point]));
            }
        }
        if let Some(&(edge, triangle)) = piercings(&self.topology, x, self.own).first() {
            let ends = self.topology.edges[edge as usize];
            return Some(self.between(&ends, triangle, x));
        }
        let touching = |pair: &&Pair| {
            let squared = squared_distance(pair.barrier.kind, &pair.gather(x));
            squared.sqrt() <= TOUCHING * self.dhat
        };
        let pair = self.list.pairs.iter().find(touching)?;
        let [a, b, c, _] = pair.points;
        let triangle = self.triangle_with(&[c]);
        Some(match pair.barrier.kind {
            Kind::VertexTriangle => self.between(&[a], triangle, x),
            Kind::EdgeEdge => self.between(&[a, b], triangle, x),
        })
    }

    /// The error for some points of an edge or vertex in a triangle.
    fn between(&self, points: &[u32], triangle: u32, x: &[Vector3<f64>]) -> SolverError {
        let other = self.triangle_with(points);
        let own = self.topology.own_triangles as u32;
        // The first to be named is one of the surface.
        let (one, other) = match triangle < own {
            true => (triangle, other),
            false => (other, triangle),
        };
        let what = match self
            .obstacles
            .iter()
            .rev()
            .find(|(first, _)| *first <= other)
        {
            Some((first, obstacle)) => {
                format!("triangle {} of obstacle {obstacle}", other - first)
            }
            None => format!("triangle {} of the surface", self.triangles[other as usize]),
        };
        self.intersects(one, what, &x[points[0] as usize])
    }

    fn intersects(&self, triangle: u32, what: String, at: &Vector3<f64>) -> SolverError {
        SolverError::Intersects {
            index: self.index,
            triangle: self.triangles[triangle as usize] as usize,
            what,
            near: (*at).into(),
        }
    }

    /// The first triangle that has these corners.
    pub(super) fn triangle_with(&self, corners: &[u32]) -> u32 {
        let has = |t: &[u32; 3]| corners.iter().all(|c| t.contains(c));
        let found = self.topology.triangles.iter().position(has);
        found.expect("vertices and edges are those of triangles") as u32
    }
}

#[cfg(test)]
mod tests;
