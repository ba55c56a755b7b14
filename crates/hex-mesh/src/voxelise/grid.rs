//! Placing the grid over the body.

use nalgebra::Vector3;

use super::inside::PointGrid;
use crate::{HexMeshError, MAX_GRID_CELLS};

/// A grid of cells: cell `[i, j, k]`, counted from `first_cell`, has its lowest corner at `origin + size * (i, j, k)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct CellGrid {
    pub origin: Vector3<f64>,
    pub size: f64,
    pub first_cell: [i32; 3],
    pub counts: [usize; 3],
}

/// Cells cover the bounding box but for this part of a cell: a box of whole cells must not get a further layer by rounding.
const ROUNDING: f64 = 1e-6;

/// Farther cells could not be numbered, nor told apart from their neighbours after rounding.
const MAX_CELL: f64 = (1 << 30) as f64;

impl CellGrid {
    /// The grid centred on the box `min..max`.
    pub fn centred(min: Vector3<f64>, max: Vector3<f64>, size: f64) -> Result<Self, HexMeshError> {
        let counts = cell_counts(&(max - min), size)?;
        let half = Vector3::from(counts.map(|n| n as f64)) * (0.5 * size);
        Ok(Self {
            origin: (min + max) / 2.0 - half,
            size,
            first_cell: [0; 3],
            counts,
        })
    }

    /// The grid over the box `min..max` with a corner of cell `[0, 0, 0]` at `origin`.
    pub fn anchored(
        min: Vector3<f64>,
        max: Vector3<f64>,
        size: f64,
        origin: Vector3<f64>,
    ) -> Result<Self, HexMeshError> {
        let first = ((min - origin) / size).map(|x| (x + ROUNDING).floor());
        // Also catches NaN.
        if !first.iter().all(|x| x.abs() <= MAX_CELL) {
            return Err(HexMeshError::Origin { origin });
        }
        let counts = cell_counts(&(max - (origin + first * size)), size)?;
        Ok(Self {
            origin,
            size,
            first_cell: first.map(|x| x as i32).into(),
            counts,
        })
    }

    /// The centres of all cells.
    pub fn centres(&self) -> PointGrid {
        let first = Vector3::from(self.first_cell.map(f64::from));
        PointGrid {
            first: self.origin + first.add_scalar(0.5) * self.size,
            spacing: self.size,
            counts: self.counts,
        }
    }

    /// The integer cell at a position of the grid.
    pub fn cell(&self, position: [usize; 3]) -> [i32; 3] {
        std::array::from_fn(|axis| self.first_cell[axis] + position[axis] as i32)
    }

    /// The lowest corner of a cell.
    pub fn corner(&self, cell: [i32; 3]) -> Vector3<f64> {
        self.origin + self.size * Vector3::from(cell.map(f64::from))
    }
}

fn cell_counts(extent: &Vector3<f64>, size: f64) -> Result<[usize; 3], HexMeshError> {
    let counts = along_axes(extent, size);
    let cells = counts.product();
    if cells > MAX_GRID_CELLS as f64 {
        return Err(HexMeshError::TooManyCells {
            element_size: size,
            cells,
            limit: MAX_GRID_CELLS,
            fitting_size: fitting_size(extent),
        });
    }
    Ok(counts.map(|n| n as usize).into())
}

fn along_axes(extent: &Vector3<f64>, size: f64) -> Vector3<f64> {
    extent.map(|length| (length / size - ROUNDING).ceil().max(1.0))
}

/// A size, to two digits, whose grid is within the limit.
fn fitting_size(extent: &Vector3<f64>) -> f64 {
    let mut size = extent.max();
    while along_axes(extent, 0.95 * size).product() <= MAX_GRID_CELLS as f64 {
        size *= 0.95;
    }
    let digit = 10.0_f64.powf(size.log10().floor() - 1.0);
    (size / digit).ceil() * digit
}
