//! Generated surfaces to try effects on.

use crate::error::Result;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use surface_mesh::Surface;
use surface_mesh::primitives::icosphere;

/// A closed surface by a few numbers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "shape", rename_all = "snake_case", deny_unknown_fields)]
pub enum Solid {
    /// A box.
    Box {
        /// Lower corner.
        min: [f64; 3],
        /// Upper corner.
        max: [f64; 3],
        /// About how far its vertices are apart.
        spacing: f64,
    },
    /// A ball.
    Ball {
        /// Centre.
        #[serde(default)]
        center: [f64; 3],
        /// Radius.
        radius: f64,
        /// How often the triangles of an icosahedron are split in four.
        #[serde(default = "default_subdivisions")]
        subdivisions: u32,
    },
    /// A ball with a ball-shaped cavity.
    Shell {
        /// Centre.
        #[serde(default)]
        center: [f64; 3],
        /// Radius of the cavity.
        inner: f64,
        /// Radius of the whole.
        outer: f64,
        /// How often the triangles of an icosahedron are split in four.
        #[serde(default = "default_subdivisions")]
        subdivisions: u32,
    },
}

fn default_subdivisions() -> u32 {
    4
}

/// Key, value and mend of what makes no sense.
pub(crate) type Problem = (&'static str, String, &'static str);

impl Solid {
    /// What is wrong with its numbers.
    pub(crate) fn problem(&self) -> Option<Problem> {
        let positive = |key, value: f64| {
            let fits = value.is_finite() && value > 0.0;
            (!fits).then(|| (key, value.to_string(), "give a finite number above zero"))
        };
        let few = |subdivisions: u32| {
            let mend = "give 0 to 7: 7 are 300,000 triangles";
            (subdivisions > 7)
                .then(|| ("surface.solid.subdivisions", subdivisions.to_string(), mend))
        };
        match self {
            Self::Box { min, max, spacing } => {
                let below =
                    (0..3).all(|a| min[a].is_finite() && max[a].is_finite() && min[a] < max[a]);
                let mend = "give finite numbers that lie below those of max";
                let extent = (0..3).map(|a| max[a] - min[a]).fold(0.0, f64::max);
                (!below)
                    .then(|| ("surface.solid.min", format!("{min:?}"), mend))
                    .or_else(|| positive("surface.solid.spacing", *spacing))
                    .or_else(|| {
                        let mend = "give at least a 300th of the longest edge";
                        (extent > 300.0 * spacing)
                            .then(|| ("surface.solid.spacing", spacing.to_string(), mend))
                    })
            }
            Self::Ball {
                radius,
                subdivisions,
                ..
            } => positive("surface.solid.radius", *radius).or_else(|| few(*subdivisions)),
            Self::Shell {
                inner,
                outer,
                subdivisions,
                ..
            } => positive("surface.solid.inner", *inner)
                .or_else(|| positive("surface.solid.outer", *outer))
                .or_else(|| {
                    let mend = "give less than the outer radius";
                    (inner >= outer).then(|| ("surface.solid.inner", inner.to_string(), mend))
                })
                .or_else(|| few(*subdivisions)),
        }
    }

    /// The surface, whose numbers were checked.
    pub(crate) fn surface(&self) -> Result<Surface> {
        Ok(match self {
            Self::Box { min, max, spacing } => {
                box_of_quads((*min).into(), (*max).into(), *spacing)?
            }
            Self::Ball {
                center,
                radius,
                subdivisions,
            } => moved(icosphere(*subdivisions, *radius), center)?,
            Self::Shell {
                center,
                inner,
                outer,
                subdivisions,
            } => {
                let (outside, inside) = (
                    icosphere(*subdivisions, *outer),
                    icosphere(*subdivisions, *inner),
                );
                let first = outside.vertex_count() as u32;
                let vertices = outside.vertices().iter().chain(inside.vertices());
                let turned = |t: &[u32; 3]| [t[0], t[2], t[1]].map(|v| v + first);
                let triangles = outside.triangles().iter().copied();
                let triangles = triangles.chain(inside.triangles().iter().map(turned));
                let both =
                    Surface::from_triangles(vertices.copied().collect(), triangles.collect())?;
                moved(both, center)?
            }
        })
    }
}

fn moved(surface: Surface, center: &[f64; 3]) -> Result<Surface> {
    let centre = Vector3::from(*center);
    let vertices = surface.vertices().iter().map(|x| x + centre);
    Ok(surface.with_vertices(vertices.collect())?)
}

/// A box whose faces are divided into quads of about the spacing.
fn box_of_quads(min: Vector3<f64>, max: Vector3<f64>, spacing: f64) -> Result<Surface> {
    let size = max - min;
    let counts = size.map(|s| (s / spacing).round().max(1.0) as u32);
    let mut numbers = HashMap::new();
    let mut vertices = Vec::new();
    let mut polygons = Vec::new();
    for axis in 0..3 {
        let (p, q) = ((axis + 1) % 3, (axis + 2) % 3);
        for upper in [false, true] {
            for (i, j) in (0..counts[p]).flat_map(|i| (0..counts[q]).map(move |j| (i, j))) {
                let mut corner = |i: u32, j: u32| {
                    let mut at = Vector3::zeros();
                    (at[axis], at[p], at[q]) = (if upper { counts[axis] } else { 0 }, i, j);
                    *numbers.entry(at).or_insert_with(|| {
                        let share = at.map(f64::from).component_div(&counts.map(f64::from));
                        vertices.push(min + share.component_mul(&size));
                        vertices.len() as u32 - 1
                    })
                };
                let mut quad = vec![
                    corner(i, j),
                    corner(i + 1, j),
                    corner(i + 1, j + 1),
                    corner(i, j + 1),
                ];
                if !upper {
                    quad.reverse();
                }
                polygons.push(quad);
            }
        }
    }
    Ok(Surface::from_polygons(vertices, polygons)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solids_are_closed_and_enclose_what_they_should() {
        let cuboid = Solid::Box {
            min: [0.0, 1.0, 0.0],
            max: [2.0, 2.0, 0.5],
            spacing: 0.24,
        };
        let shell = Solid::Shell {
            center: [1.0, 0.0, 0.0],
            inner: 0.5,
            outer: 1.0,
            subdivisions: 4,
        };
        let ball = |r: f64| 4.0 / 3.0 * std::f64::consts::PI * r.powi(3);
        for (solid, volume) in [(cuboid, 1.0), (shell, ball(1.0) - ball(0.5))] {
            assert_eq!(solid.problem(), None);
            let surface = solid.surface().unwrap();
            surface_mesh::report(&surface).require_closed("").unwrap();
            assert!((surface.signed_volume() / volume - 1.0).abs() < 0.01);
        }
    }

    #[test]
    fn senseless_numbers_are_told() {
        let shell = Solid::Shell {
            center: [0.0; 3],
            inner: 2.0,
            outer: 1.0,
            subdivisions: 3,
        };
        assert_eq!(shell.problem().unwrap().0, "surface.solid.inner");
        let flat = Solid::Box {
            min: [0.0; 3],
            max: [1.0, 0.0, 1.0],
            spacing: 0.1,
        };
        assert_eq!(flat.problem().unwrap().0, "surface.solid.min");
    }
}
