//! What contact keeps apart, and whether it does.

use crate::body::Body;
use crate::error::Result;
use crate::scene::Scene;
use nalgebra::Vector3;
use pd_solver::{EffectSpec, Solver};
use serde::Serialize;

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
