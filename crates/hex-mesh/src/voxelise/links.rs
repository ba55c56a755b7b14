//! Which parts of neighbouring cells connect through the face between them.

use super::cut::CutCells;

/// The pairs of parts that connect through the faces of cut cells.
pub(crate) struct FaceLinks {
    /// Pairs before those of each face, `6 * slot + 2 * axis + side` with side 1 the upper face.
    offsets: Vec<u32>,
    /// The part of the lower cell and the part of the upper cell.
    pairs: Vec<[u8; 2]>,
}

impl FaceLinks {
    /// Finds the links of all faces of cut cells.
    pub fn new(cut: &CutCells) -> Self {
        let strides = [cut.counts[1] * cut.counts[2], cut.counts[2], 1];
        let mut offsets = Vec::with_capacity(6 * cut.cells.len() + 1);
        offsets.push(0);
        let mut pairs = Vec::new();
        for &cell in &cut.cells {
            let cell = cell as usize;
            for (axis, stride) in strides.into_iter().enumerate() {
                let along = cell / stride % cut.counts[axis];
                // The faces between two cut cells are those of the lower one.
                if along > 0 && cut.slot(cell - stride).is_none() {
                    link_face(cut, cell - stride, cell, axis, &mut pairs);
                }
                offsets.push(pairs.len() as u32);
                if along + 1 < cut.counts[axis] {
                    link_face(cut, cell, cell + stride, axis, &mut pairs);
                }
                offsets.push(pairs.len() as u32);
            }
        }
        Self { offsets, pairs }
    }

    /// The cells and parts that a part of a cell connects with.
    pub fn around(
        &self,
        cut: &CutCells,
        cell: usize,
        part: u8,
    ) -> impl Iterator<Item = (usize, u8)> {
        let strides = [cut.counts[1] * cut.counts[2], cut.counts[2], 1];
        (0..6).flat_map(move |face| {
            let (axis, side) = (face / 2, face % 2);
            let along = cell / strides[axis] % cut.counts[axis];
            let (other, pairs) = match side {
                0 if along > 0 => {
                    let other = cell - strides[axis];
                    (other, self.between(cut, other, cell, axis))
                }
                1 if along + 1 < cut.counts[axis] => {
                    let other = cell + strides[axis];
                    (other, self.between(cut, cell, other, axis))
                }
                _ => (cell, &[][..]),
            };
            let own = pairs.iter().filter(move |pair| pair[1 - side] == part);
            own.map(move |pair| (other, pair[side]))
        })
    }

    /// The pairs of parts of a cell and of the next one along an axis that connect.
    pub fn between(&self, cut: &CutCells, lower: usize, upper: usize, axis: usize) -> &[[u8; 2]] {
        let face =
            |face: usize| &self.pairs[self.offsets[face] as usize..self.offsets[face + 1] as usize];
        match (cut.slot(lower), cut.slot(upper)) {
            (Some(slot), _) => face(6 * slot + 2 * axis + 1),
            (None, Some(slot)) => face(6 * slot + 2 * axis),
            // Without a crossing between them, both are inside or both are outside.
            (None, None) if cut.part_count(lower) == 1 && cut.part_count(upper) == 1 => &[[0, 0]],
            (None, None) => &[],
        }
    }
}

/// Per cut cell: whether it holds one part at most, and this connects with the part of every neighbour that has one. Where all cells
/// around are so, there is no gap.
pub(crate) fn gapless(cut: &CutCells) -> Vec<bool> {
    let links = FaceLinks::new(cut);
    let strides = [cut.counts[1] * cut.counts[2], cut.counts[2], 1];
    let is_linked = |lower: usize, upper: usize, axis: usize| {
        cut.part_count(lower) == 0
            || cut.part_count(upper) == 0
            || !links.between(cut, lower, upper, axis).is_empty()
    };
    let is_gapless = |&cell: &u32| {
        let cell = cell as usize;
        let face = |axis: usize| {
            let along = cell / strides[axis] % cut.counts[axis];
            (along == 0 || is_linked(cell - strides[axis], cell, axis))
                && (along + 1 == cut.counts[axis] || is_linked(cell, cell + strides[axis], axis))
        };
        cut.part_count(cell) <= 1 && (0..3).all(face)
    };
    cut.cells.iter().map(is_gapless).collect()
}

/// Appends the pairs of parts that connect through one face, each once.
fn link_face(cut: &CutCells, lower: usize, upper: usize, axis: usize, pairs: &mut Vec<[u8; 2]>) {
    let n = cut.samples;
    let strides = [n * n, n, 1];
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let first = pairs.len();
    for row in 0..n * n {
        let sample = row / n * strides[u] + row % n * strides[v];
        if cut.has_barrier(upper, sample, axis) {
            continue;
        }
        let below = cut.part_at(lower, sample + (n - 1) * strides[axis]);
        if let (Some(a), Some(b)) = (below, cut.part_at(upper, sample))
            && !pairs[first..].contains(&[a, b])
        {
            pairs.push([a, b]);
        }
    }
}
