//! Numbering the corners of a set of cells.

use crate::{HexMeshError, MAX_GRID_CELLS, corner_offset};

/// How nodes are numbered.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum NodeOrder {
    /// As elements first use them, corner by corner: nodes lie in memory as elements do.
    FirstUse,
    /// By x, then y, then z.
    Lexicographic,
}

/// The corners of cells: the integer lattice point of each node, and the nodes of each cell.
pub(crate) struct NumberedNodes {
    pub points: Vec<[i32; 3]>,
    pub elements: Vec<[u32; 8]>,
}

/// Integer box that holds the cells, and a flat index into its lattice points.
struct Lattice {
    min: [i32; 3],
    points: [usize; 3],
}

const UNUSED: u32 = u32::MAX;

impl Lattice {
    fn around(cells: &[[i32; 3]]) -> Result<Self, HexMeshError> {
        let axis_range = |axis: usize| {
            let along = cells.iter().map(|cell| cell[axis]);
            (along.clone().min(), along.max())
        };
        let mut lattice = Self {
            min: [0; 3],
            points: [0; 3],
        };
        let mut grid_cells = 1.0;
        for axis in 0..3 {
            let (Some(min), Some(max)) = axis_range(axis) else {
                return Err(HexMeshError::NoCellsGiven);
            };
            let count = (i64::from(max) - i64::from(min) + 1) as usize;
            grid_cells *= count as f64;
            lattice.min[axis] = min;
            lattice.points[axis] = count + 1;
        }
        if grid_cells > MAX_GRID_CELLS as f64 || cells.iter().flatten().any(|&i| i == i32::MAX) {
            return Err(HexMeshError::GridTooLarge {
                cells: grid_cells,
                limit: MAX_GRID_CELLS,
            });
        }
        Ok(lattice)
    }

    fn index(&self, cell: [i32; 3], offset: [usize; 3]) -> usize {
        let [x, y, z] = std::array::from_fn(|axis| {
            i64::from(cell[axis]).abs_diff(i64::from(self.min[axis])) as usize + offset[axis]
        });
        (x * self.points[1] + y) * self.points[2] + z
    }

    fn point(&self, index: usize) -> [i32; 3] {
        let (rest, z) = (index / self.points[2], index % self.points[2]);
        let (x, y) = (rest / self.points[1], rest % self.points[1]);
        let [min_x, min_y, min_z] = self.min;
        [min_x + x as i32, min_y + y as i32, min_z + z as i32]
    }

    fn point_count(&self) -> usize {
        self.points.iter().product()
    }

    fn check_distinct(&self, cells: &[[i32; 3]]) -> Result<(), HexMeshError> {
        let mut seen = vec![false; self.point_count()];
        for (entry, &cell) in cells.iter().enumerate() {
            if std::mem::replace(&mut seen[self.index(cell, [0; 3])], true) {
                return Err(HexMeshError::DuplicateCell { cell, entry });
            }
        }
        Ok(())
    }
}

/// Numbers the corners that `cells` use; cells that share a lattice point share the node.
pub(crate) fn number_nodes(
    cells: &[[i32; 3]],
    order: NodeOrder,
) -> Result<NumberedNodes, HexMeshError> {
    let lattice = Lattice::around(cells)?;
    lattice.check_distinct(cells)?;
    let corners = |cell: [i32; 3]| {
        std::array::from_fn::<usize, 8, _>(|c| lattice.index(cell, corner_offset(c)))
    };

    let mut node_at = vec![UNUSED; lattice.point_count()];
    let mut points = Vec::new();
    for &cell in cells {
        for index in corners(cell) {
            if node_at[index] == UNUSED {
                node_at[index] = points.len() as u32;
                points.push(lattice.point(index));
            }
        }
    }
    if order == NodeOrder::Lexicographic {
        let used = (0..node_at.len()).filter(|&index| node_at[index] != UNUSED);
        for (node, index) in used.collect::<Vec<_>>().into_iter().enumerate() {
            node_at[index] = node as u32;
            points[node] = lattice.point(index);
        }
    }
    let elements = cells
        .iter()
        .map(|&cell| corners(cell).map(|index| node_at[index]))
        .collect();
    Ok(NumberedNodes { points, elements })
}
