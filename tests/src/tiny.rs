//! A ball that stands on its lower end and learns to bend: a scene of some hundred elements.

use nalgebra::Vector3;
use std::path::{Path, PathBuf};
use surface_mesh::primitives::icosphere;
use surface_mesh::{MorphTarget, MorphedSurface, Surface, write_glb, write_obj};
use tempfile::TempDir;

/// A folder with a scene file, the surface it names as OBJ, its target shapes as GLB, and room for runs.
pub struct TinyScene {
    folder: TempDir,
}

/// A point of the ball moved: to the side, up, and around, all growing from nothing at the lower end.
pub fn bent(x: &Vector3<f64>, [side, up, around]: [f64; 3]) -> Vector3<f64> {
    let t = 0.5 * (x.z + 1.0);
    let (sin, cos) = (around * t).sin_cos();
    Vector3::new(
        x.x * cos - x.y * sin + side * t * t,
        x.x * sin + x.y * cos,
        x.z + up * t,
    )
}

/// Morph targets of a surface by [`bent`].
pub fn targets(surface: &Surface, shapes: &[(&str, [f64; 3])]) -> Vec<MorphTarget> {
    let all = shapes.iter().map(|(name, amounts)| MorphTarget {
        name: (*name).to_string(),
        deltas: (surface.vertices().iter())
            .map(|x| bent(x, *amounts) - x)
            .collect(),
    });
    all.collect()
}

impl TinyScene {
    /// Writes the scene with so many passes in stages 1 and 2, and a checkpoint after every step.
    ///
    /// # Panics
    /// When it cannot be written.
    pub fn new(stage1_epochs: usize, stage2_epochs: usize) -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let scene = Self { folder };
        let ball = icosphere(2, 1.0);
        write_obj(scene.path("ball.obj"), &ball).expect("a written surface");
        let shapes = [
            ("bend", [0.3, 0.0, 0.0]),
            ("rise", [0.0, 0.25, 0.0]),
            ("turn", [0.0, 0.0, 0.5]),
            ("both", [0.15, 0.0, 0.25]),
        ];
        scene.write_targets("shapes.glb", &ball, &shapes);
        scene.write_targets("other.glb", &ball, &[("lean", [0.2, 0.1, 0.0])]);
        let text = format!(
            r#"name = "ball"
unit = "cm"
checkpoint_seconds = 0

[surface]
file = "ball.obj"

[shapes]
file = "shapes.glb"
held_out = ["both"]

[mesh]
element_size = 0.4
samples = 8

[[effects]]
type = "elasticity"

[[effects]]
type = "prescribed"
nodes = {{ type = "half_space", normal = [0, 0, -1], offset = 0.6 }}

[network]
width = 64

[stage1]
epochs = {stage1_epochs}
batch = 2
points = 64

[stage2]
epochs = {stage2_epochs}
"#
        );
        std::fs::write(scene.scene(), text).expect("a written scene");
        scene
    }

    /// Writes a GLB file of a surface with morph targets by [`bent`] into the folder.
    ///
    /// # Panics
    /// When it cannot be written.
    pub fn write_targets(&self, name: &str, surface: &Surface, shapes: &[(&str, [f64; 3])]) {
        let morphed = MorphedSurface::new(surface.clone(), targets(surface, shapes));
        write_glb(self.path(name), &morphed.expect("targets that fit")).expect("a written GLB");
    }

    /// Replaces a part of the scene file, which has to be there.
    ///
    /// # Panics
    /// When it is not, or the file cannot be written.
    #[track_caller]
    pub fn edit(&self, from: &str, to: &str) {
        let text = std::fs::read_to_string(self.scene()).expect("a readable scene");
        assert!(text.contains(from), "{from}");
        std::fs::write(self.scene(), text.replacen(from, to, 1)).expect("a written scene");
    }

    /// The scene file.
    pub fn scene(&self) -> PathBuf {
        self.path("scene.toml")
    }

    /// A path in the folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }
}
