//! The starfish's surface.

use nalgebra::Vector3;
use surface_mesh::{Surface, report};

use crate::improve::{improve, split};
use crate::nets::{Grid, surface_nets};
use crate::{ShapeError, StarfishBody, StarfishShape};

/// Grid step over the mean edge length of the triangles it leads to, as measured on the default shape.
const STEP: f64 = 1.09;
const MAX_CELLS: f64 = 1e8;
/// The blend of disc and arms raises the body above `thickness` by less than this part of it.
const HEIGHT_MARGIN: f64 = 0.3;

/// The surface of a starfish: closed, one piece without handles, facing outwards, with every vertex on the zero set of
/// [`StarfishBody`] and about equilateral triangles of edge length [`StarfishShape::resolution`]. The same shape gives
/// the same bits.
///
/// # Errors
/// As [`StarfishShape::check`], and [`ShapeError::TooFine`] or [`ShapeError::NotASphere`] when the resolution does not
/// suit the shape.
pub fn starfish(shape: &StarfishShape) -> Result<Surface, ShapeError> {
    let body = StarfishBody::new(shape)?;
    let grid = grid(shape)?;
    let (mut vertices, quads) = surface_nets(&grid, |point| body.value(point));
    if quads.is_empty() {
        return Err(ShapeError::NotASphere {
            resolution: shape.resolution,
            euler: 0,
        });
    }
    let mut triangles = split(&vertices, &quads);
    improve(&body, &mut vertices, &mut triangles);
    let surface = Surface::from_triangles(vertices, triangles)?;
    require_sphere(shape, &surface)?;
    Ok(surface)
}

fn grid(shape: &StarfishShape) -> Result<Grid, ShapeError> {
    let height = (1.0 + HEIGHT_MARGIN) * shape.thickness;
    let high = Vector3::new(shape.radius, height, shape.radius);
    let step = STEP * shape.resolution;
    let cells = high.iter().map(|half| 2.0 * half / step + 2.0).product();
    if cells > MAX_CELLS {
        return Err(ShapeError::TooFine {
            resolution: shape.resolution,
            cells,
            limit: MAX_CELLS,
        });
    }
    Ok(Grid::covering(-high, high, step))
}

fn require_sphere(shape: &StarfishShape, surface: &Surface) -> Result<(), ShapeError> {
    let findings = report(surface);
    // A closed triangle surface has three edges for every two triangles.
    let euler = surface.vertex_count() as i64 - surface.triangles().len() as i64 / 2;
    if findings.is_solid() && findings.components.len() == 1 && euler == 2 {
        Ok(())
    } else {
        Err(ShapeError::NotASphere {
            resolution: shape.resolution,
            euler,
        })
    }
}

#[cfg(test)]
mod tests {
    use surface_mesh::primitives::torus;

    use super::*;

    #[test]
    fn a_surface_with_a_handle_is_refused() {
        let refused = require_sphere(&StarfishShape::default(), &torus(1.0, 0.3, 20, 10));
        assert!(matches!(
            refused,
            Err(ShapeError::NotASphere { euler: 0, .. })
        ));
    }
}
