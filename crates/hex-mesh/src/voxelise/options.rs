//! How to voxelise.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::mesh::check_element_size;
use crate::{HexMeshError, Quadrature};

/// Which face-connected pieces of the body become elements.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Keep {
    /// Only the piece with the most elements; the others are reported as dropped.
    #[default]
    Largest,
    /// All pieces.
    All,
}

/// How cells are split that hold several separate parts of the body, such as both lips of a closed mouth.
///
/// Samples on a lattice in each cell are linked where the segment between them crosses no triangle, so a gap of any width parts them.
/// Only cells that the surface cuts are sampled; each sample takes two bytes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Splitting {
    /// Samples along each axis of a cell: 3, 5 or 7. They limit how thin a bridge of material may be and still be seen, not how thin
    /// a gap.
    pub samples: usize,
    /// How much of a cell a part must fill to become an element beside another, above 0 and at most 1/2.
    pub least_fraction: f64,
    /// Whether parts of the body that are too thin to hold cell centres become elements too, full cubes however little they hold, and
    /// so do the cells on the way from them to the rest of the body. They are stiffer and heavier than they should be, but move on
    /// their own. Some cells at edges and corners of other bodies are added as well.
    pub cover_thin: bool,
}

impl Default for Splitting {
    /// 5 samples, a fifth of the cell, thin parts left out.
    fn default() -> Self {
        Self {
            samples: 5,
            least_fraction: 0.2,
            cover_thin: false,
        }
    }
}

/// How to [`voxelise`](crate::voxelise) a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VoxelOptions {
    /// Edge length of the cubes, in the surface's unit.
    pub element_size: f64,
    /// Sample points per element.
    pub quadrature: Quadrature,
    /// Which pieces become elements.
    pub keep: Keep,
    /// A point where cells meet; without one, the grid is centred on the surface's bounding box, so that symmetric bodies get
    /// symmetric meshes.
    pub origin: Option<Vector3<f64>>,
    /// How cells with several parts are split; without it, every cell is one element at most, and elements in touching cells share
    /// nodes whatever lies between them.
    pub split: Option<Splitting>,
    /// Whether cells inside bones stay elements where the body ends beside them. Skin that lies on a bone, with less than an element of
    /// flesh between, is then carried by what is under it, and not by flesh far away.
    pub cover_bones: bool,
}

impl VoxelOptions {
    /// Cubes of the given size, 8 samples each, the largest piece, a centred grid, cells split at gaps.
    #[must_use]
    pub fn new(element_size: f64) -> Self {
        Self {
            element_size,
            quadrature: Quadrature::default(),
            keep: Keep::default(),
            origin: None,
            split: Some(Splitting::default()),
            cover_bones: false,
        }
    }

    /// Refuses numbers out of range.
    pub(crate) fn check(&self) -> Result<(), HexMeshError> {
        check_element_size(self.element_size)?;
        let Some(Splitting {
            samples,
            least_fraction,
            ..
        }) = self.split
        else {
            return Ok(());
        };
        if ![3, 5, 7].contains(&samples) {
            return Err(HexMeshError::SplitSamples { samples });
        }
        if !(least_fraction > 0.0 && least_fraction <= 0.5) {
            return Err(HexMeshError::SplitFraction { least_fraction });
        }
        Ok(())
    }
}
