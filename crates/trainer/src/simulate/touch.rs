//! What contact keeps apart, and whether it does.

use super::Variant;
use crate::body::Body;
use crate::error::Result;
use crate::scene::Scene;
use nalgebra::Vector3;
use pd_solver::{EffectSpec, Obstacle, Solver};
use serde::Serialize;
use std::collections::BTreeSet;
use surface_mesh::{Surface, self_intersections};

/// Where a surface touches itself or others in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Touch {
    /// Pairs of triangles that pass through each other where contact of the surface with itself acts.
    pub crossing_pairs: usize,
    /// Pairs of vertices, edges, triangles and planes that feel each other.
    pub felt: usize,
    /// The smallest distance among them.
    pub nearest: Option<f64>,
}

/// The part of a surface that contact keeps apart from itself.
pub(super) struct Watch {
    /// Whether each triangle belongs to it.
    watched: Vec<bool>,
    /// Triangles that pass through others at rest: they, and what has a vertex of theirs, are left out.
    pub(super) left_out: usize,
}

impl Watch {
    /// `None` where the scene has no contact.
    pub(super) fn new(scene: &Scene, body: &Body, solver: &mut Solver) -> Result<Option<Self>> {
        let triangles = body.surface.triangles();
        let mut watched = vec![false; triangles.len()];
        let mut any = false;
        for effect in &scene.effects {
            let EffectSpec::Contact { region, own, .. } = effect else {
                continue;
            };
            any = true;
            if !own {
                continue;
            }
            let rest = body.surface.vertices();
            let size = body.mesh.element_size();
            let inside = match region {
                Some(region) => region.contains(rest, size).unwrap_or_default(),
                None => vec![true; rest.len()],
            };
            for (watched, triangle) in watched.iter_mut().zip(triangles) {
                *watched |= triangle.iter().all(|&v| inside[v as usize]);
            }
        }
        if !any {
            return Ok(None);
        }
        let mut vertices = vec![false; body.surface.vertex_count()];
        let mut left_out = 0;
        for report in solver.contact_reports(body.mesh.nodes())? {
            left_out += report.left_out.len();
            for &t in &report.left_out {
                for v in triangles[t as usize] {
                    vertices[v as usize] = true;
                }
            }
        }
        for (watched, triangle) in watched.iter_mut().zip(triangles) {
            *watched &= !triangle.iter().any(|&v| vertices[v as usize]);
        }
        Ok(Some(Self { watched, left_out }))
    }

    /// What there is at positions of the nodes, of whose surface these pairs of triangles cross.
    pub(super) fn look(
        &self,
        solver: &mut Solver,
        nodes: &[Vector3<f64>],
        crossing: &[[u32; 2]],
    ) -> Result<Touch> {
        let reports = solver.contact_reports(nodes)?;
        let nearest = reports.iter().filter_map(|r| r.nearest);
        let crossed = |pair: &&[u32; 2]| pair.iter().all(|&t| self.watched[t as usize]);
        Ok(Touch {
            crossing_pairs: crossing.iter().filter(crossed).count(),
            felt: reports.iter().map(|r| r.felt).sum(),
            nearest: nearest.reduce(f64::min),
        })
    }
}

/// The surfaces that contact keeps off, one after another as in [`Parameters::obstacles`](pd_solver::Parameters::obstacles).
#[derive(Debug, Default)]
pub(super) struct Obstacles {
    /// Vertices at rest.
    rest: Vec<Vector3<f64>>,
    /// Triangles over the vertices.
    pub(super) triangles: Vec<[u32; 3]>,
}

impl Obstacles {
    /// Those of effects without names.
    pub(super) fn of(effects: &[EffectSpec]) -> Self {
        let mut all = Self::default();
        let lists = effects.iter().filter_map(|effect| match effect {
            EffectSpec::Contact { obstacles, .. } => Some(obstacles),
            _ => None,
        });
        for obstacle in lists.flatten() {
            if let Obstacle::Surface {
                vertices,
                triangles,
            } = obstacle
            {
                let first = all.rest.len() as u32;
                all.triangles
                    .extend(triangles.iter().map(|t| t.map(|v| v + first)));
                all.rest.extend(vertices.iter().map(|&x| Vector3::from(x)));
            }
        }
        all
    }

    /// Counts where the surface passes through them, in all variants: those without contact know nothing of obstacles, and get the places of the
    /// first's.
    pub(super) fn meet(&self, surface: &Surface, variants: &mut [Variant]) {
        if self.triangles.is_empty() {
            return;
        }
        let places = variants[0].frames.iter().map(|f| f.obstacles.clone());
        let places: Vec<_> = places.collect();
        let own = surface.triangles();
        let count = surface.vertex_count() as u32;
        let others = self.triangles.iter().map(|t| t.map(|v| v + count));
        let all: Vec<[u32; 3]> = own.iter().copied().chain(others).collect();
        let crossing = |surface: &[Vector3<f64>], obstacles: &[Vector3<f64>]| {
            let found = self_intersections(&[surface, obstacles].concat(), &all);
            let is_own = |t: u32| (t as usize) < own.len();
            let met = found.into_iter().filter(|p| is_own(p[0]) != is_own(p[1]));
            met.collect::<BTreeSet<_>>()
        };
        let at_rest = crossing(surface.vertices(), &self.rest);
        for variant in variants {
            for (frame, place) in variant.frames.iter_mut().zip(&places) {
                let met = crossing(&frame.surface, place);
                frame.obstacle_pairs = Some(met.difference(&at_rest).count());
                frame.obstacles.clone_from(place);
            }
        }
    }
}
