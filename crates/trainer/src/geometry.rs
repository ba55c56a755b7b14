//! What a moved surface does not keep of its rest shape.

use crate::error::Result;
use nalgebra::Vector3;
use serde::Serialize;
use std::collections::HashSet;
use surface_mesh::{Surface, self_intersections};

/// What a surface does not keep.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Geometry {
    /// Enclosed volume against rest, in percent.
    pub volume_change_percent: f64,
    /// Pairs of triangles that pass through each other and did not at rest ([`self_intersections`]).
    pub crossing_pairs: usize,
}

/// Measures surfaces against one at rest.
pub(crate) struct GeometryMeasure<'a> {
    surface: &'a Surface,
    volume: f64,
    crossing: HashSet<[u32; 2]>,
}

impl<'a> GeometryMeasure<'a> {
    pub fn new(surface: &'a Surface) -> Self {
        let crossing = self_intersections(surface.vertices(), surface.triangles());
        Self {
            surface,
            volume: surface.signed_volume(),
            crossing: crossing.into_iter().collect(),
        }
    }

    /// What the surface does not keep with its vertices at `positions`.
    pub fn of(&self, positions: &[Vector3<f64>]) -> Result<Geometry> {
        self.with_crossings(positions).map(|(geometry, _)| geometry)
    }

    /// The same, and the pairs of triangles that pass through each other and did not at rest.
    pub fn with_crossings(&self, positions: &[Vector3<f64>]) -> Result<(Geometry, Vec<[u32; 2]>)> {
        let moved = self.surface.with_vertices(positions.to_vec())?;
        let mut crossing = self_intersections(positions, moved.triangles());
        crossing.retain(|pair| !self.crossing.contains(pair));
        let geometry = Geometry {
            volume_change_percent: 100.0 * (moved.signed_volume() / self.volume - 1.0),
            crossing_pairs: crossing.len(),
        };
        Ok((geometry, crossing))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_crossed_at_rest_is_not_counted() {
        let ball = surface_mesh::primitives::icosphere(2, 1.0);
        let measure = GeometryMeasure::new(&ball);
        let mut positions = ball.vertices().to_vec();
        assert_eq!(measure.of(&positions).unwrap().crossing_pairs, 0);
        positions[0] *= -1.5;
        positions[0].x += 0.01;
        assert!(measure.of(&positions).unwrap().crossing_pairs > 0);
        let crossed = ball.with_vertices(positions.clone()).unwrap();
        let known = GeometryMeasure::new(&crossed);
        assert_eq!(known.of(&positions).unwrap().crossing_pairs, 0);
    }
}
