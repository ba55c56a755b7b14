//! Reading by file extension.

use std::path::Path;

use crate::{MorphedSurface, SurfaceError, read_gltf, read_obj};

/// Reads a surface, choosing the format by the extension in any letter case: `.obj`, `.glb` or `.gltf`.
///
/// # Errors
/// [`SurfaceError::UnknownFormat`] for another extension, else as [`read_obj`] and [`read_gltf`].
pub fn read_surface(path: impl AsRef<Path>) -> Result<MorphedSurface, SurfaceError> {
    let path = path.as_ref();
    let extension = path
        .extension()
        .map(|extension| extension.to_string_lossy().to_ascii_lowercase());
    match extension.as_deref() {
        Some("obj") => Ok(MorphedSurface {
            surface: read_obj(path)?,
            targets: Vec::new(),
            unit: None,
        }),
        Some("glb" | "gltf") => read_gltf(path),
        _ => Err(SurfaceError::UnknownFormat { path: path.into() }),
    }
}
