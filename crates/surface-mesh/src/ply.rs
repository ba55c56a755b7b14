//! PLY out, for pictures of a field on the surface.

use std::io::Write;
use std::path::Path;

use crate::whole_file::write_whole;
use crate::{Surface, SurfaceError};

/// What a PLY file holds per vertex besides the position.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlyAttributes<'a> {
    /// A scalar per vertex, written as the property `quality` that MeshLab and others colour by.
    pub quality: Option<&'a [f64]>,
    /// Red, green and blue per vertex.
    pub colors: Option<&'a [[u8; 3]]>,
}

/// Writes binary little-endian PLY with `double` positions; polygons keep their corners.
///
/// # Errors
/// [`SurfaceError::AttributeLength`] when an attribute has not one entry per vertex; [`SurfaceError::Write`], and then
/// nothing has changed under `path`.
pub fn write_ply(
    path: impl AsRef<Path>,
    surface: &Surface,
    attributes: &PlyAttributes,
) -> Result<(), SurfaceError> {
    check_length(surface, "quality", attributes.quality.map(<[f64]>::len))?;
    check_length(surface, "colours", attributes.colors.map(<[[u8; 3]]>::len))?;
    let small_polygons = surface.polygons().all(|polygon| polygon.len() <= 255);
    write_whole(path.as_ref(), |out| {
        write_header(out, surface, attributes, small_polygons)?;
        write_vertices(out, surface, attributes)?;
        for polygon in surface.polygons() {
            if small_polygons {
                out.write_all(&[polygon.len() as u8])?;
            } else {
                out.write_all(&(polygon.len() as u32).to_le_bytes())?;
            }
            for corner in polygon {
                out.write_all(&corner.to_le_bytes())?;
            }
        }
        Ok(())
    })
}

fn check_length(
    surface: &Surface,
    attribute: &'static str,
    found: Option<usize>,
) -> Result<(), SurfaceError> {
    let expected = surface.vertex_count();
    match found {
        Some(found) if found != expected => Err(SurfaceError::AttributeLength {
            attribute,
            expected,
            found,
        }),
        _ => Ok(()),
    }
}

fn write_header(
    out: &mut dyn Write,
    surface: &Surface,
    attributes: &PlyAttributes,
    small_polygons: bool,
) -> std::io::Result<()> {
    writeln!(out, "ply\nformat binary_little_endian 1.0")?;
    writeln!(out, "element vertex {}", surface.vertex_count())?;
    for axis in ["x", "y", "z"] {
        writeln!(out, "property double {axis}")?;
    }
    if attributes.colors.is_some() {
        for channel in ["red", "green", "blue"] {
            writeln!(out, "property uchar {channel}")?;
        }
    }
    if attributes.quality.is_some() {
        writeln!(out, "property double quality")?;
    }
    let count_type = if small_polygons { "uchar" } else { "uint" };
    writeln!(out, "element face {}", surface.polygon_count())?;
    writeln!(
        out,
        "property list {count_type} uint vertex_indices\nend_header"
    )
}

fn write_vertices(
    out: &mut dyn Write,
    surface: &Surface,
    attributes: &PlyAttributes,
) -> std::io::Result<()> {
    for (i, vertex) in surface.vertices().iter().enumerate() {
        for coordinate in vertex {
            out.write_all(&coordinate.to_le_bytes())?;
        }
        if let Some(colors) = attributes.colors {
            out.write_all(&colors[i])?;
        }
        if let Some(quality) = attributes.quality {
            out.write_all(&quality[i].to_le_bytes())?;
        }
    }
    Ok(())
}
