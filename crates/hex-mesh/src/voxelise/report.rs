//! What the voxeliser found and left out.

use std::fmt;

use nalgebra::Vector3;

/// A face-connected piece of the body that was left out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DroppedPiece {
    /// How many elements it had.
    pub elements: usize,
    /// Lower corner of its bounding box.
    pub min: Vector3<f64>,
    /// Upper corner of its bounding box.
    pub max: Vector3<f64>,
}

/// What the voxeliser found: sizes, volumes, pieces and doubtful cells.
#[derive(Debug, Clone, PartialEq)]
pub struct VoxelReport {
    /// Edge length of the cubes.
    pub element_size: f64,
    /// Cells along each axis of the grid over the bounding box.
    pub grid: [usize; 3],
    /// Elements in the mesh.
    pub elements: usize,
    /// Nodes in the mesh.
    pub nodes: usize,
    /// Volume of the mesh.
    pub mesh_volume: f64,
    /// Signed volume of the surface: negative when its triangles face inwards.
    pub surface_volume: f64,
    /// Face-connected pieces found, kept and dropped.
    pub pieces: usize,
    /// The pieces that were left out, largest first.
    pub dropped: Vec<DroppedPiece>,
    /// Cells for which one of the three rays disagreed with the other two. Zero unless the surface passes within rounding of cell
    /// centres.
    pub minority_votes: usize,
    /// Cells that hold several elements, one for each separate part of the body.
    pub split_cells: usize,
    /// Elements that were left out because they lie inside bones.
    pub bone_elements: usize,
    /// Grid points that lie in more than one bone.
    pub shared_points: usize,
}

impl VoxelReport {
    /// Mesh volume over surface volume, less 1. Dropped pieces and bones count as missing.
    #[must_use]
    pub fn relative_volume_error(&self) -> f64 {
        self.mesh_volume / self.surface_volume.abs() - 1.0
    }
}

impl fmt::Display for VoxelReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z] = self.grid;
        writeln!(
            f,
            "{} elements of size {}, {} nodes, in a grid of {x} x {y} x {z}",
            self.elements, self.element_size, self.nodes
        )?;
        write!(
            f,
            "volume {:.6e}, surface {:.6e} ({:+.3} %)",
            self.mesh_volume,
            self.surface_volume.abs(),
            100.0 * self.relative_volume_error()
        )?;
        if self.surface_volume < 0.0 {
            write!(f, "\nthe surface faces inwards")?;
        }
        if self.minority_votes > 0 {
            write!(
                f,
                "\n{} cells decided by two rays of three",
                self.minority_votes
            )?;
        }
        if self.split_cells > 0 {
            write!(f, "\n{} cells split into separate parts", self.split_cells)?;
        }
        if self.bone_elements > 0 {
            write!(f, "\n{} elements left out for bones", self.bone_elements)?;
        }
        if self.shared_points > 0 {
            write!(
                f,
                "\n{} grid points lie in several bones, which overlap there: the first one has them",
                self.shared_points
            )?;
        }
        self.fmt_dropped(f)
    }
}

/// How many dropped pieces the printed report lists one by one.
const LISTED_PIECES: usize = 4;

impl VoxelReport {
    fn fmt_dropped(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for piece in self.dropped.iter().take(LISTED_PIECES) {
            let (min, max) = (piece.min, piece.max);
            write!(
                f,
                "\ndropped a piece of {} elements in ({:.6}, {:.6}, {:.6}) to ({:.6}, {:.6}, {:.6})",
                piece.elements, min.x, min.y, min.z, max.x, max.y, max.z
            )?;
        }
        let rest = self.dropped.get(LISTED_PIECES..).unwrap_or_default();
        if !rest.is_empty() {
            let elements: usize = rest.iter().map(|piece| piece.elements).sum();
            write!(
                f,
                "\ndropped {} more pieces, {elements} elements",
                rest.len()
            )?;
        }
        Ok(())
    }
}
