//! The element nearest to a point.

use std::sync::OnceLock;

use nalgebra::Vector3;

use crate::cell_tree::{Candidate, CellTree, cell_distance, nearer};
use crate::{CellIndex, HexMesh};

/// Finds the cube nearest to a point: a table of cells for points near the body, a tree of boxes for the rest.
pub(crate) struct ElementFinder<'a> {
    mesh: &'a HexMesh,
    index: CellIndex,
    /// Built when the first point needs it: a skin seldom does.
    tree: OnceLock<CellTree<'a>>,
}

impl<'a> ElementFinder<'a> {
    pub fn new(mesh: &'a HexMesh) -> Self {
        Self {
            mesh,
            index: mesh.cell_index(),
            tree: OnceLock::new(),
        }
    }

    /// The nearest element (the lowest index among equals) and the point's distance from its cube, 0 inside.
    pub fn nearest(&self, point: &Vector3<f64>) -> (usize, f64) {
        let size = self.mesh.element_size();
        let local = (point - self.mesh.origin()) / size;
        let (squared, element) = self
            .among_neighbours(&local)
            .unwrap_or_else(|| self.tree().nearest(&local));
        (element, squared.sqrt() * size)
    }

    #[cold]
    fn tree(&self) -> &CellTree<'a> {
        self.tree.get_or_init(|| {
            let elements = 0..self.mesh.elements().len() as u32;
            let boundary = elements.filter(|&element| self.is_on_boundary(element));
            CellTree::new(self.mesh.cells(), boundary.collect())
        })
    }

    /// Whether a face neighbour is missing. A point outside the mesh is never nearest to another cube: the neighbour towards the
    /// point would be strictly nearer.
    fn is_on_boundary(&self, element: u32) -> bool {
        let cell = self.mesh.cells()[element as usize];
        (0..3).any(|axis| {
            [-1, 1].into_iter().any(|step| {
                let mut neighbour = cell;
                // Wrapping leads to a cell far away, which is missing as it should be.
                neighbour[axis] = neighbour[axis].wrapping_add(step);
                self.index.elements(neighbour).next().is_none()
            })
        })
    }

    /// The nearest element of the 3 x 3 x 3 cells around the point, provided that no other cell can be nearer.
    fn among_neighbours(&self, local: &Vector3<f64>) -> Option<Candidate> {
        let home = local.map(f64::floor);
        if home.amax() > f64::from(i32::MAX / 2) {
            return None;
        }
        let corner: [i32; 3] = home.map(|x| x as i32).into();
        // Off its boundary, the point's own cell has no rival.
        let off_boundary = (0..3).all(|axis| local[axis] > home[axis]);
        if off_boundary && let Some(element) = self.index.elements(corner).next() {
            return Some((0.0, element as usize));
        }
        let mut best: Option<Candidate> = None;
        for neighbour in 0..27 {
            let steps = [neighbour / 9 - 1, neighbour / 3 % 3 - 1, neighbour % 3 - 1];
            let cell = std::array::from_fn(|axis| corner[axis] + steps[axis]);
            if let Some(element) = self.index.elements(cell).next() {
                let candidate = (cell_distance(local, cell, cell), element as usize);
                best = Some(best.map_or(candidate, |best| nearer(best, candidate)));
            }
        }
        // Cells beyond the neighbours are at least one whole cell away.
        best.filter(|&(squared, _)| squared < 1.0)
    }
}
