//! A box of integer points, and flat indices into it.

use crate::{HexMeshError, MAX_GRID_CELLS};

/// All integer points from `min` on, `counts` along each axis, x slowest.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct GridBox {
    pub min: [i32; 3],
    pub counts: [usize; 3],
}

impl GridBox {
    /// The smallest box around cells.
    ///
    /// # Errors
    /// [`HexMeshError::NoCellsGiven`], and [`HexMeshError::GridTooLarge`] above [`MAX_GRID_CELLS`].
    pub fn around(cells: &[[i32; 3]]) -> Result<Self, HexMeshError> {
        let (&first, rest) = cells.split_first().ok_or(HexMeshError::NoCellsGiven)?;
        let (mut min, mut max) = (first, first);
        for cell in rest {
            for axis in 0..3 {
                min[axis] = min[axis].min(cell[axis]);
                max[axis] = max[axis].max(cell[axis]);
            }
        }
        let counts: [usize; 3] =
            std::array::from_fn(|axis| max[axis].abs_diff(min[axis]) as usize + 1);
        let total: f64 = counts.iter().map(|&n| n as f64).product();
        // The corners of the last cell must have integers too.
        if total > MAX_GRID_CELLS as f64 || max.contains(&i32::MAX) {
            return Err(HexMeshError::GridTooLarge {
                cells: total,
                limit: MAX_GRID_CELLS,
            });
        }
        Ok(Self { min, counts })
    }

    /// The box of the corners of these cells.
    pub fn corners(&self) -> Self {
        Self {
            min: self.min,
            counts: self.counts.map(|n| n + 1),
        }
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.counts.iter().product()
    }

    /// Steps of the flat index along x, y and z.
    pub fn strides(&self) -> [usize; 3] {
        [self.counts[1] * self.counts[2], self.counts[2], 1]
    }

    /// Flat index of a point, if it is in the box.
    pub fn index(&self, point: [i32; 3]) -> Option<usize> {
        let mut index = 0;
        for ((at, min), count) in point.into_iter().zip(self.min).zip(self.counts) {
            // A point below the minimum wraps around to beyond any count.
            let along = (i64::from(at) - i64::from(min)) as usize;
            if along >= count {
                return None;
            }
            index = index * count + along;
        }
        Some(index)
    }

    /// The point at a flat index.
    pub fn point(&self, index: usize) -> [i32; 3] {
        let (row, z) = (index / self.counts[2], index % self.counts[2]);
        let (x, y) = (row / self.counts[1], row % self.counts[1]);
        let position = [x, y, z];
        std::array::from_fn(|axis| self.min[axis] + position[axis] as i32)
    }
}
