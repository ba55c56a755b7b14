//! Morph targets (blendshapes) over a surface.

use nalgebra::Vector3;

use crate::{Surface, SurfaceError};

/// One morph target: what it adds to each vertex at weight 1.
#[derive(Clone, Debug, PartialEq)]
pub struct MorphTarget {
    /// The target's name, as the file gives it.
    pub name: String,
    /// One displacement per vertex of the surface, in scene length units.
    pub deltas: Vec<Vector3<f64>>,
}

/// A neutral surface with its morph targets.
#[derive(Clone, Debug, PartialEq)]
pub struct MorphedSurface {
    /// The neutral surface.
    pub surface: Surface,
    /// The targets, in file order. Empty for formats without morph targets.
    pub targets: Vec<MorphTarget>,
    /// The length unit that the file names, as `units` among the extras of its mesh or asset: "m", "cm" and the like. Says nothing about
    /// the coordinates here, which are as they are in the file.
    pub unit: Option<String>,
}

impl MorphedSurface {
    /// Joins a surface and its targets.
    ///
    /// # Errors
    /// [`SurfaceError::TargetLength`] when a target has not one delta per vertex, [`SurfaceError::NonFiniteDelta`].
    pub fn new(surface: Surface, targets: Vec<MorphTarget>) -> Result<Self, SurfaceError> {
        let morphed = Self {
            surface,
            targets,
            unit: None,
        };
        morphed.check_targets()?;
        Ok(morphed)
    }

    /// Checks that every target has one finite delta per vertex; the fields are public and may have been changed.
    pub(crate) fn check_targets(&self) -> Result<(), SurfaceError> {
        for target in &self.targets {
            if target.deltas.len() != self.surface.vertex_count() {
                return Err(SurfaceError::TargetLength {
                    name: target.name.clone(),
                    expected: self.surface.vertex_count(),
                    found: target.deltas.len(),
                });
            }
            let finite = |delta: &Vector3<f64>| delta.iter().all(|x| x.is_finite());
            if let Some(vertex) = target.deltas.iter().position(|delta| !finite(delta)) {
                return Err(SurfaceError::NonFiniteDelta {
                    name: target.name.clone(),
                    vertex,
                });
            }
        }
        Ok(())
    }

    /// Vertex positions of target `index` at weight 1: neutral plus deltas.
    ///
    /// # Panics
    /// When there is no such target, or it has not one delta per vertex.
    pub fn shape(&self, index: usize) -> Vec<Vector3<f64>> {
        let mut positions = self.surface.vertices().to_vec();
        add_scaled(&mut positions, 1.0, &self.targets[index]);
        positions
    }

    /// Vertex positions of a blend: neutral plus the sum of `weights[i] * deltas of target i`.
    ///
    /// # Panics
    /// When `weights` has not one entry per target, or a target has not one delta per vertex.
    pub fn blend(&self, weights: &[f64]) -> Vec<Vector3<f64>> {
        assert_eq!(weights.len(), self.targets.len(), "one weight per target");
        let mut positions = self.surface.vertices().to_vec();
        for (&weight, target) in weights.iter().zip(&self.targets) {
            if weight != 0.0 {
                add_scaled(&mut positions, weight, target);
            }
        }
        positions
    }

    /// Index of the first target with this name, compared exactly.
    pub fn target_index(&self, name: &str) -> Option<usize> {
        self.targets.iter().position(|target| target.name == name)
    }
}

fn add_scaled(positions: &mut [Vector3<f64>], weight: f64, target: &MorphTarget) {
    assert_eq!(
        positions.len(),
        target.deltas.len(),
        "target {:?} needs one delta per vertex",
        target.name
    );
    for (position, delta) in positions.iter_mut().zip(&target.deltas) {
        *position += weight * delta;
    }
}
