//! What a fit aims at: a shape over the body's vertices, or a scan.

use super::scan::{LeftOut, Matches, Scan};
use crate::body::Body;
use crate::evaluate::weighted;
use crate::loss::{Loss, distances};
use crate::scene::LossSettings;
use crate::shapes::Shape;
use nalgebra::Vector3;
use serde::Serialize;

/// What the body's surface is to become.
pub enum Target {
    /// A place for every vertex.
    Shape(Shape),
    /// A surface to lie on.
    Scan(Box<Scan>),
}

/// What a surface is pulled to from where it is.
pub enum Aim<'a> {
    /// Places that do not depend on where it is.
    Shape(&'a Body, &'a [Vector3<f64>]),
    /// The places of a scan where it is nearest now.
    Scan(&'a Body, Matches),
}

/// Distances of the vertices that count from where they should be, scene unit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FitError {
    /// Mean, each vertex weighted by what it counts.
    pub mean: f64,
    /// What 99 of 100 vertices do not exceed.
    pub p99: f64,
    /// The largest.
    pub max: f64,
}

/// Distances at one state of the surface.
pub struct Measured {
    /// Distance of every vertex.
    pub distances: Vec<f64>,
    /// What each vertex counts.
    pub weights: Vec<f64>,
    /// What a scan leaves out.
    pub left_out: Option<LeftOut>,
}

impl Target {
    /// What tables call it.
    pub fn name(&self) -> String {
        match self {
            Self::Shape(shape) => shape.name.clone(),
            Self::Scan(scan) => {
                let stem = scan.path.file_stem().unwrap_or_default();
                stem.to_string_lossy().into_owned()
            }
        }
    }

    /// Vertices of the target, and its triangles where they are not the body's.
    pub fn mesh(&self) -> (&[Vector3<f64>], Option<&[[u32; 3]]>) {
        match self {
            Self::Shape(shape) => (&shape.positions, None),
            Self::Scan(scan) => (scan.surface.vertices(), Some(scan.surface.triangles())),
        }
    }

    /// What the surface `x` is pulled to.
    pub fn aim<'a>(&'a self, body: &'a Body, x: &[Vector3<f64>]) -> Aim<'a> {
        match self {
            Self::Shape(shape) => Aim::Shape(body, &shape.positions),
            Self::Scan(scan) => Aim::Scan(body, scan.matches(body, x)),
        }
    }

    /// How far the surface `x` is off.
    pub fn measure(&self, body: &Body, x: &[Vector3<f64>]) -> Measured {
        match self {
            Self::Shape(shape) => Measured {
                distances: distances(x, &shape.positions).2,
                weights: body.vertex_weights.clone(),
                left_out: None,
            },
            Self::Scan(scan) => {
                let matches = scan.matches(body, x);
                Measured {
                    distances: matches.distances,
                    weights: matches.weights,
                    left_out: Some(matches.left_out),
                }
            }
        }
    }
}

impl Aim<'_> {
    /// What each vertex counts.
    pub fn weights(&self) -> &[f64] {
        match self {
            Self::Shape(body, _) => &body.vertex_weights,
            Self::Scan(_, matches) => &matches.weights,
        }
    }

    /// The loss, with other weights of the vertices where they are held. That the aim moves with the
    /// surface has no part in its gradient: for distances from a scan there is none, for its normals it is left out.
    pub fn loss(&self, settings: &LossSettings, held: Option<&[f64]>) -> Loss<'_> {
        match self {
            Self::Shape(body, positions) => Loss::new(body, positions, settings),
            Self::Scan(body, matches) => {
                let weights = held.unwrap_or(&matches.weights).to_vec();
                let (places, normals) = (matches.places.clone(), matches.normals.clone());
                Loss::on_surface(body, places, normals, weights, settings)
            }
        }
    }
}

impl FitError {
    /// Sums up distances; vertices without weight do not count.
    pub fn of(distances: &[f64], weights: &[f64]) -> Self {
        let total: f64 = weights.iter().sum();
        let (mean, p99) = weighted(distances, weights);
        let counted = distances.iter().zip(weights).filter(|(_, w)| **w > 0.0);
        Self {
            mean: if total > 0.0 { mean / total } else { 0.0 },
            p99,
            max: counted.map(|(d, _)| *d).fold(0.0, f64::max),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_count_has_no_part_in_the_error() {
        let error = FitError::of(&[1.0, 4.0, 9.0], &[0.3, 0.1, 0.0]);
        assert!((error.mean - 0.7 / 0.4).abs() < 1e-12);
        assert_eq!((error.p99, error.max), (4.0, 4.0));
        let nothing = FitError::of(&[1.0], &[0.0]);
        assert_eq!((nothing.mean, nothing.max), (0.0, 0.0));
    }
}
