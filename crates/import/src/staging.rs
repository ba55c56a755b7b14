//! Folders that appear whole or not at all.

use std::path::{Path, PathBuf};

use serde_json::Value;
use surface_mesh::{MorphTarget, MorphedSurface, Surface, write_glb, write_obj};
use tempfile::TempDir;

use crate::error::{ImportError, Result, file_error};

/// A folder that is filled under another name and then renamed.
pub struct Staging {
    folder: TempDir,
    path: PathBuf,
}

impl Staging {
    /// Begins the folder `name` in `out`, which is created where it does not exist.
    ///
    /// # Errors
    /// [`ImportError::Exists`] when there is something of that name, [`ImportError::File`].
    pub fn new(out: &Path, name: &str) -> Result<Self> {
        let path = out.join(name);
        if path.exists() {
            return Err(ImportError::Exists { path });
        }
        std::fs::create_dir_all(out).map_err(file_error("create the folder", out))?;
        let mut builder = tempfile::Builder::new();
        builder.prefix(".part-");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // The umask takes its part away; the default of this library would hide the folder from others.
            builder.permissions(std::fs::Permissions::from_mode(0o777));
        }
        let folder = builder
            .tempdir_in(out)
            .map_err(file_error("write to the folder", out))?;
        Ok(Self { folder, path })
    }

    /// The folder that it will be.
    pub fn destination(&self) -> &Path {
        &self.path
    }

    /// Writes bytes.
    ///
    /// # Errors
    /// [`ImportError::File`].
    pub fn bytes(&self, name: &str, bytes: &[u8]) -> Result<()> {
        let path = self.folder.path().join(name);
        std::fs::write(&path, bytes).map_err(file_error("write", self.path.join(name)))
    }

    /// Writes JSON for people: a line for every value.
    ///
    /// # Errors
    /// [`ImportError::File`].
    pub fn json(&self, name: &str, value: &Value) -> Result<()> {
        self.bytes(name, format!("{value:#}\n").as_bytes())
    }

    /// Writes JSON for programs: one line.
    ///
    /// # Errors
    /// [`ImportError::File`].
    pub fn compact_json(&self, name: &str, value: &Value) -> Result<()> {
        self.bytes(name, format!("{value}\n").as_bytes())
    }

    /// Writes a surface as OBJ.
    ///
    /// # Errors
    /// [`ImportError::Surface`].
    pub fn obj(&self, name: &str, surface: &Surface) -> Result<()> {
        Ok(write_obj(self.folder.path().join(name), surface)?)
    }

    /// Writes a surface with morph targets as GLB.
    ///
    /// # Errors
    /// [`ImportError::Surface`].
    pub fn glb(&self, name: &str, surface: &Surface, targets: Vec<MorphTarget>) -> Result<()> {
        let morphed = MorphedSurface::new(surface.clone(), targets)?;
        Ok(write_glb(self.folder.path().join(name), &morphed)?)
    }

    /// Gives the folder its name.
    ///
    /// # Errors
    /// [`ImportError::File`]; then nothing is left behind.
    pub fn finish(self) -> Result<()> {
        std::fs::rename(self.folder.path(), &self.path)
            .map_err(file_error("write the folder", &self.path))?;
        // It goes by another name now: there is nothing left to remove.
        let _old_name = self.folder.keep();
        Ok(())
    }
}
