//! The face-connected pieces of a set of cells.

/// One face-connected piece.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Piece {
    pub cells: usize,
    /// Lowest and highest cell of its bounding box.
    pub min: [usize; 3],
    pub max: [usize; 3],
}

/// All pieces, and the piece of each cell.
pub(crate) struct Pieces {
    pub pieces: Vec<Piece>,
    /// Per cell of the grid: 0 outside, else one more than the index of its piece.
    labels: Vec<u32>,
}

const OUTSIDE: u32 = 0;
const UNVISITED: u32 = u32::MAX;

impl Pieces {
    /// Splits the inside cells of a grid (x slowest) into pieces, in order of their first cell.
    pub fn new(counts: [usize; 3], is_inside: impl Fn(usize) -> bool) -> Self {
        let label = |cell| if is_inside(cell) { UNVISITED } else { OUTSIDE };
        let mut labels: Vec<u32> = (0..counts.iter().product()).map(label).collect();
        let mut pieces = Vec::new();
        let mut stack = Vec::new();
        for seed in 0..labels.len() {
            if labels[seed] == UNVISITED {
                let label = pieces.len() as u32 + 1;
                pieces.push(flood(seed, label, counts, &mut labels, &mut stack));
            }
        }
        Self { pieces, labels }
    }

    /// The piece of a cell, if it is inside.
    pub fn piece_of(&self, cell: usize) -> Option<usize> {
        (self.labels[cell] as usize).checked_sub(1)
    }

    /// The piece with the most cells, the first among equals.
    pub fn largest(&self) -> Option<usize> {
        (0..self.pieces.len())
            .rev()
            .max_by_key(|&piece| self.pieces[piece].cells)
    }
}

fn flood(
    seed: usize,
    label: u32,
    counts: [usize; 3],
    labels: &mut [u32],
    stack: &mut Vec<usize>,
) -> Piece {
    let strides = [counts[1] * counts[2], counts[2], 1];
    let mut piece = Piece {
        cells: 0,
        min: [usize::MAX; 3],
        max: [0; 3],
    };
    labels[seed] = label;
    stack.push(seed);
    while let Some(cell) = stack.pop() {
        let position = grid_position(cell, counts);
        piece.cells += 1;
        for axis in 0..3 {
            piece.min[axis] = piece.min[axis].min(position[axis]);
            piece.max[axis] = piece.max[axis].max(position[axis]);
            let below = (position[axis] > 0).then(|| cell - strides[axis]);
            let above = (position[axis] + 1 < counts[axis]).then(|| cell + strides[axis]);
            for neighbour in [below, above].into_iter().flatten() {
                if labels[neighbour] == UNVISITED {
                    labels[neighbour] = label;
                    stack.push(neighbour);
                }
            }
        }
    }
    piece
}

/// Position in the grid of a flat index, x slowest.
pub(crate) fn grid_position(index: usize, counts: [usize; 3]) -> [usize; 3] {
    let (row, z) = (index / counts[2], index % counts[2]);
    [row / counts[1], row % counts[1], z]
}
