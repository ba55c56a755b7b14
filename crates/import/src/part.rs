//! Parts of a mesh that a source keeps in one piece.

use std::ops::Range;
use std::path::Path;

use surface_mesh::Surface;

use crate::error::{ImportError, Result};

/// The part of a surface with the vertices of `range`, renumbered from 0 in the same order; its polygons keep their order too.
///
/// `path` and `name` are what errors call the mesh and the part.
///
/// # Errors
/// [`ImportError::VertexCount`] where the range goes beyond the mesh, [`ImportError::Straddles`] where a polygon has corners on both
/// sides, [`ImportError::Surface`] where there is no polygon.
pub fn part(
    surface: &Surface,
    range: Range<usize>,
    path: &Path,
    name: &'static str,
) -> Result<Surface> {
    let Some(vertices) = surface.vertices().get(range.clone()) else {
        return Err(ImportError::VertexCount {
            path: path.into(),
            found: surface.vertex_count(),
            expected: range.end,
        });
    };
    let mut polygons = Vec::new();
    for (index, polygon) in surface.polygons().enumerate() {
        let inside = |&&corner: &&u32| range.contains(&(corner as usize));
        match polygon.iter().filter(inside).count() {
            0 => {}
            count if count == polygon.len() => {
                polygons.push(polygon.iter().map(|c| c - range.start as u32).collect());
            }
            _ => {
                return Err(ImportError::Straddles {
                    path: path.into(),
                    part: name,
                    polygon: index,
                });
            }
        }
    }
    Ok(Surface::from_polygons(vertices.to_vec(), polygons)?)
}
