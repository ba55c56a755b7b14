//! The face-connected pieces of the candidates.

use super::candidates::Candidates;
use super::corners::Corners;
use crate::corner_offset;

/// One face-connected piece.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Piece {
    pub elements: usize,
    /// Lowest and highest cell of its bounding box.
    pub min: [usize; 3],
    pub max: [usize; 3],
}

/// All pieces, and the piece of each candidate.
pub(crate) struct Pieces {
    pub pieces: Vec<Piece>,
    /// Per candidate: the index of its piece, or `NO_PIECE` for bone.
    pub of_candidate: Vec<u32>,
}

const UNVISITED: u32 = u32::MAX;
/// The piece of what is no flesh.
pub(crate) const NO_PIECE: u32 = u32::MAX - 1;

impl Pieces {
    /// Sorts the candidates of a grid of `counts` cells (x slowest) into pieces, in order of their first candidate. Candidates
    /// connect where they share all four nodes of a face. Only candidates for which `is_flesh` holds belong to pieces.
    pub fn new(
        counts: [usize; 3],
        candidates: &Candidates,
        corners: &Corners,
        is_flesh: impl Fn(usize) -> bool,
    ) -> Self {
        let label = |candidate| {
            if is_flesh(candidate) {
                UNVISITED
            } else {
                NO_PIECE
            }
        };
        let mut of_candidate: Vec<u32> = (0..candidates.list.len()).map(label).collect();
        let mut pieces = Vec::new();
        let mut stack = Vec::new();
        for seed in 0..of_candidate.len() {
            if of_candidate[seed] != UNVISITED {
                continue;
            }
            let label = pieces.len() as u32;
            let mut piece = Piece {
                elements: 0,
                min: [usize::MAX; 3],
                max: [0; 3],
            };
            of_candidate[seed] = label;
            stack.push(seed);
            while let Some(candidate) = stack.pop() {
                piece.add(grid_position(
                    candidates.list[candidate].cell as usize,
                    counts,
                ));
                for_neighbours(counts, candidates, corners, candidate, |neighbour| {
                    if of_candidate[neighbour] == UNVISITED {
                        of_candidate[neighbour] = label;
                        stack.push(neighbour);
                    }
                });
            }
            pieces.push(piece);
        }
        Self {
            pieces,
            of_candidate,
        }
    }

    /// The piece with the most elements, the first among equals.
    pub fn largest(&self) -> Option<usize> {
        (0..self.pieces.len())
            .rev()
            .max_by_key(|&piece| self.pieces[piece].elements)
    }
}

impl Piece {
    fn add(&mut self, position: [usize; 3]) {
        self.elements += 1;
        for (axis, at) in position.into_iter().enumerate() {
            self.min[axis] = self.min[axis].min(at);
            self.max[axis] = self.max[axis].max(at);
        }
    }
}

/// Calls `visit` with the candidates that share a face with a candidate.
fn for_neighbours(
    counts: [usize; 3],
    candidates: &Candidates,
    corners: &Corners,
    candidate: usize,
    mut visit: impl FnMut(usize),
) {
    let strides = [counts[1] * counts[2], counts[2], 1];
    let cell = candidates.list[candidate].cell as usize;
    let position = grid_position(cell, counts);
    for axis in 0..3 {
        if position[axis] > 0 {
            let below = candidates.of_cell(cell - strides[axis]);
            { below }
                .filter(|&other| share_face(candidates, corners, [other, candidate], axis))
                .for_each(&mut visit);
        }
        if position[axis] + 1 < counts[axis] {
            let above = candidates.of_cell(cell + strides[axis]);
            { above }
                .filter(|&other| share_face(candidates, corners, [candidate, other], axis))
                .for_each(&mut visit);
        }
    }
    let in_cell = candidates.of_cell(cell).filter(|&other| other != candidate);
    { in_cell }
        .filter(|&other| overlap_in_face(candidates, corners, candidate, other))
        .for_each(&mut visit);
}

/// Whether two candidates in neighbouring cells, the lower first, share the nodes of the face between them.
fn share_face(candidates: &Candidates, corners: &Corners, pair: [usize; 2], axis: usize) -> bool {
    let [lower, upper] = pair.map(|candidate| candidates.list[candidate]);
    if !corners.touches_split(lower.cell) {
        return true;
    }
    let bit = 4 >> axis;
    let of_upper = |corner: &usize| corner_offset(*corner)[axis] == 0;
    (0..8).filter(of_upper).all(|corner| {
        let below = corners.class(lower.cell, corner | bit, lower.part);
        below == corners.class(upper.cell, corner, upper.part)
    })
}

/// Whether two candidates of one cell share the nodes of some face.
fn overlap_in_face(candidates: &Candidates, corners: &Corners, a: usize, b: usize) -> bool {
    let [a, b] = [a, b].map(|candidate| candidates.list[candidate]);
    let shared: [bool; 8] = std::array::from_fn(|corner| {
        corners.class(a.cell, corner, a.part) == corners.class(b.cell, corner, b.part)
    });
    let face = |axis: usize, side: usize| {
        let on_face = |corner: &usize| corner_offset(*corner)[axis] == side;
        (0..8).filter(on_face).all(|corner| shared[corner])
    };
    (0..3).any(|axis| face(axis, 0) || face(axis, 1))
}

/// Position in the grid of a flat index, x slowest.
pub(crate) fn grid_position(index: usize, counts: [usize; 3]) -> [usize; 3] {
    let (row, z) = (index / counts[2], index % counts[2]);
    [row / counts[1], row % counts[1], z]
}
