//! A folder of inputs to spoil.

use crate::refused_and_unchanged;
use std::path::PathBuf;
use surface_mesh::primitives::icosphere;
use surface_mesh::{MorphedSurface, write_glb, write_obj};
use tempfile::TempDir;

/// A folder with good inputs to spoil, and the name of an output folder that is not there.
pub struct Place(TempDir);

impl Place {
    /// A closed ball as OBJ and as GLB.
    pub fn new() -> Self {
        let place = Self(tempfile::tempdir().unwrap());
        let ball = icosphere(2, 1.0);
        write_obj(place.path("ball.obj"), &ball).unwrap();
        let plain = MorphedSurface::new(ball, Vec::new()).unwrap();
        write_glb(place.path("ball.glb"), &plain).unwrap();
        place
    }

    /// A path in the folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// The bytes of a file.
    pub fn read(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap()
    }

    /// Writes a file.
    pub fn write(&self, name: &str, bytes: impl AsRef<[u8]>) {
        std::fs::write(self.path(name), bytes).unwrap();
    }

    /// Solving with this surface is refused, with the name of the file and `parts`.
    #[track_caller]
    pub fn refuses_surface(&self, name: &str, parts: &[&str]) {
        let line = format!(
            "solve --surface {} --element-size 0.3 --fix z=min --out {}",
            self.path(name).display(),
            self.path("out").display()
        );
        let parts: Vec<&str> = parts.iter().copied().chain([name]).collect();
        refused_and_unchanged(line, &self.path("out"), &parts);
    }

    /// Solving a box of 2 x 1 x 1 cubes with these options is refused.
    #[track_caller]
    pub fn refuses_box(&self, options: &str, parts: &[&str]) {
        self.refuses_solve(&format!("--cells 2,1,1 --size 1 {options}"), parts);
    }

    /// Solving with these options is refused.
    #[track_caller]
    pub fn refuses_solve(&self, options: &str, parts: &[&str]) {
        let out = self.path("out");
        let line = format!("solve {options} --out {}", out.display());
        refused_and_unchanged(line, &out, parts);
    }
}

impl Default for Place {
    fn default() -> Self {
        Self::new()
    }
}
