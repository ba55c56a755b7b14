//! OBJ out: positions and faces.

use std::path::Path;

use crate::whole_file::write_whole;
use crate::{Surface, SurfaceError};

/// Writes positions and polygons. Coordinates are the shortest text that reads back as the same `f64`.
///
/// # Errors
/// [`SurfaceError::Write`]; then nothing has changed under `path`.
pub fn write_obj(path: impl AsRef<Path>, surface: &Surface) -> Result<(), SurfaceError> {
    write_whole(path.as_ref(), |out| {
        for vertex in surface.vertices() {
            writeln!(out, "v {:?} {:?} {:?}", vertex.x, vertex.y, vertex.z)?;
        }
        for polygon in surface.polygons() {
            out.write_all(b"f")?;
            for &corner in polygon {
                write!(out, " {}", u64::from(corner) + 1)?;
            }
            out.write_all(b"\n")?;
        }
        Ok(())
    })
}
