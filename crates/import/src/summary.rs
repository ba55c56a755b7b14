//! What was imported, for people.

use std::fmt;
use std::path::PathBuf;

use surface_mesh::printable;

use crate::jaw::JawMotions;

/// A face that was written.
#[derive(Clone, Debug, PartialEq)]
pub struct FaceSummary {
    /// The folder.
    pub folder: PathBuf,
    /// Vertices of the closed neutral surface.
    pub vertices: usize,
    /// Its polygons.
    pub polygons: usize,
    /// Corners around each hole that was closed.
    pub holes: Vec<usize>,
    /// Number of units written.
    pub units: usize,
    /// Units of the source that move nothing of the skin, and were left out.
    pub still: Vec<String>,
    /// Rigid motions of the lower teeth, in the unit of the source.
    pub jaw: JawMotions,
    /// Millimetres in the unit of the source.
    pub millimetres: f64,
}

/// A body that was written.
#[derive(Clone, Debug, PartialEq)]
pub struct BodySummary {
    /// The folder.
    pub folder: PathBuf,
    /// Vertices of the closed neutral surface.
    pub vertices: usize,
    /// Its polygons.
    pub polygons: usize,
    /// Number of poses written.
    pub poses: usize,
}

impl fmt::Display for FaceSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.folder.display())?;
        let holes: Vec<String> = self.holes.iter().map(usize::to_string).collect();
        writeln!(
            f,
            "  neutral  {} vertices, {} polygons; holes closed: {} ({} corners)",
            self.vertices,
            self.polygons,
            holes.len(),
            holes.join(", "),
        )?;
        write!(f, "  units    {}", self.units)?;
        if !self.still.is_empty() {
            write!(
                f,
                "; left out, as they move no skin: {}",
                printable(&self.still.join(", "))
            )?;
        }
        writeln!(f)?;
        if self.jaw.is_empty() {
            return writeln!(f, "  jaw      no unit moves the lower teeth");
        }
        for (name, fit) in &self.jaw {
            writeln!(
                f,
                "  jaw      {name}: turned by {:.2} degrees, off the rigid motion by {:.3} mm (rms), {:.3} mm at most",
                degrees(fit),
                fit.residual_rms * self.millimetres,
                fit.residual_max * self.millimetres,
                name = printable(name),
            )?;
        }
        Ok(())
    }
}

/// The angle of the rotation.
fn degrees(fit: &crate::RigidFit) -> f64 {
    nalgebra::Rotation3::from_matrix_unchecked(fit.rotation)
        .angle()
        .to_degrees()
}

impl fmt::Display for BodySummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.folder.display())?;
        writeln!(
            f,
            "  neutral  {} vertices, {} polygons, closed",
            self.vertices, self.polygons
        )?;
        writeln!(f, "  poses    {}", self.poses)
    }
}
