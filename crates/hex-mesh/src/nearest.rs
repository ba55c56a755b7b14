//! The element nearest to a point.

use nalgebra::Vector3;

use crate::{CellIndex, HexMesh};

/// Finds the cube nearest to a point: a hash of cells for points near the body, bounding boxes of runs of elements for the rest.
pub(crate) struct ElementFinder<'a> {
    mesh: &'a HexMesh,
    index: CellIndex,
    runs: Vec<Run>,
}

/// Elements that follow each other in memory, and so lie near each other, with the range of their cells.
struct Run {
    first: usize,
    min: [i32; 3],
    max: [i32; 3],
}

/// Short runs make a long list of boxes, long runs make loose boxes; both cost the same near this length.
const RUN_LENGTH: usize = 64;

/// A candidate: squared distance in cells, then the element, so that equals go to the lowest index.
type Candidate = (f64, usize);

impl<'a> ElementFinder<'a> {
    pub fn new(mesh: &'a HexMesh) -> Self {
        let runs = mesh.cells().chunks(RUN_LENGTH).enumerate();
        Self {
            mesh,
            index: mesh.cell_index(),
            runs: runs
                .map(|(run, cells)| Run::new(run * RUN_LENGTH, cells))
                .collect(),
        }
    }

    /// The nearest element (the lowest index among equals) and the point's distance from its cube, 0 inside.
    pub fn nearest(&self, point: &Vector3<f64>) -> (usize, f64) {
        let size = self.mesh.element_size();
        let local = (point - self.mesh.origin()) / size;
        let (squared, element) = self
            .among_neighbours(&local)
            .unwrap_or_else(|| self.among_all(&local));
        (element, squared.sqrt() * size)
    }

    /// The nearest element of the 3 x 3 x 3 cells around the point, provided that no other cell can be nearer.
    fn among_neighbours(&self, local: &Vector3<f64>) -> Option<Candidate> {
        let home = local.map(f64::floor);
        if home.amax() > f64::from(i32::MAX / 2) {
            return None;
        }
        let home: [i32; 3] = home.map(|x| x as i32).into();
        // Inside a cell, off its boundary, there is nothing to compare.
        let inside = cell_distance(local, home, home) == 0.0
            && (0..3).all(|axis| local[axis] > f64::from(home[axis]));
        if inside && let Some(element) = self.index.elements(home).next() {
            return Some((0.0, element as usize));
        }
        let mut best: Option<Candidate> = None;
        for offset in 0..27 {
            let steps = [offset / 9 - 1, offset / 3 % 3 - 1, offset % 3 - 1];
            let cell = std::array::from_fn(|axis| home[axis] + steps[axis]);
            if let Some(element) = self.index.elements(cell).next() {
                let candidate = (cell_distance(local, cell, cell), element as usize);
                best = Some(best.map_or(candidate, |best| nearer(best, candidate)));
            }
        }
        // Cells beyond the neighbours are at least one whole cell away.
        best.filter(|&(squared, _)| squared < 1.0)
    }

    #[cold]
    fn among_all(&self, local: &Vector3<f64>) -> Candidate {
        let mut best = (f64::INFINITY, usize::MAX);
        for run in &self.runs {
            if cell_distance(local, run.min, run.max) > best.0 {
                continue;
            }
            let cells = &self.mesh.cells()[run.first..];
            for (offset, &cell) in cells.iter().take(RUN_LENGTH).enumerate() {
                let candidate = (cell_distance(local, cell, cell), run.first + offset);
                best = nearer(best, candidate);
            }
        }
        best
    }
}

impl Run {
    fn new(first: usize, cells: &[[i32; 3]]) -> Self {
        let mut run = Self {
            first,
            min: cells[0],
            max: cells[0],
        };
        for cell in cells {
            run.min = std::array::from_fn(|axis| run.min[axis].min(cell[axis]));
            run.max = std::array::from_fn(|axis| run.max[axis].max(cell[axis]));
        }
        run
    }
}

fn nearer(a: Candidate, b: Candidate) -> Candidate {
    if (b.0, b.1) < (a.0, a.1) { b } else { a }
}

/// Squared distance, in cells, from a point in grid coordinates to the box of cells `min..=max`.
fn cell_distance(local: &Vector3<f64>, min: [i32; 3], max: [i32; 3]) -> f64 {
    let outside = |axis: usize| {
        let below = f64::from(min[axis]) - local[axis];
        let above = local[axis] - (f64::from(max[axis]) + 1.0);
        below.max(above).max(0.0)
    };
    (0..3).map(|axis| outside(axis).powi(2)).sum()
}
