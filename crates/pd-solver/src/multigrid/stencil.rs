//! The assembled operator of a coarse level: 3x3 blocks by diagonals, sixteen rows side by side.
//!
//! Rows that follow one another in memory mostly have neighbours that follow one another too, at the same distances. A block of
//! sixteen rows therefore holds a list of distances, and for each the nine entries of all its rows. The operator is symmetric, and to read its entries
//! is most of what a product costs, so only those with a column at or behind the row are kept: on a full grid 14 of 27. A
//! product takes each both ways.

use super::element_matrix::{BLOCKS, ElementMatrix};
use super::grid::Grid;
use super::layout::{LANES, Lanes, Layout, add_to, load, over_slabs};
use pulp::{Arch, Simd, WithSimd};
use std::ops::Range;

/// The entries of sixteen rows at one distance.
struct Diagonal {
    /// Slot of the column of lane 0, x component. Lanes without an entry read what lies there and multiply it by zero.
    column: u32,
    /// Distance between the components of the columns.
    step: u32,
}

/// The place of an entry whose column lies before its row.
const NOT_KEPT: u32 = u32::MAX;

pub(super) struct Stencil {
    starts: Vec<usize>,
    parallel: bool,
    /// First block of each plane, and the end.
    plane_blocks: Vec<usize>,
    /// First diagonal of each block, and the end.
    block_diagonals: Vec<usize>,
    diagonals: Vec<Diagonal>,
    /// Nine entries per diagonal.
    entries: Vec<Lanes>,
    /// Where the entry (x, x) of each pair of corners of each element goes: index among all numbers of `entries`, or [`NOT_KEPT`].
    targets: Vec<[u32; 64]>,
    /// The same for the diagonal block of every node.
    own: Vec<u32>,
    /// Elements between each two planes.
    slabs: Vec<Range<usize>>,
    /// Where the entries of each plane start, and the end.
    entry_starts: Vec<usize>,
    arch: Arch,
}

impl Stencil {
    /// The pattern of a grid's operator; all entries zero.
    pub(super) fn new(grid: &Grid, layout: &Layout) -> Self {
        let mut plane_blocks = vec![0];
        for plane in 0..layout.planes() {
            plane_blocks.push(plane_blocks[plane] + layout.step(plane) / LANES);
        }
        let blocks = plane_blocks[layout.planes()];
        let block_of = |node: u32| -> (usize, u32) {
            let plane = grid.places[node as usize][0] as usize;
            let slot = layout.slots[node as usize] as usize - layout.starts[plane];
            (plane_blocks[plane] + slot / LANES, (slot % LANES) as u32)
        };
        // Columns relative to lane 0 are shifted so that they are never negative.
        let mut columns: Vec<Vec<(u32, u32)>> = vec![Vec::new(); blocks];
        let pairs = |nodes: &[u32; 8], pair: usize| (nodes[pair / 8], nodes[pair % 8]);
        let is_kept =
            |row: u32, node: u32| layout.slots[row as usize] <= layout.slots[node as usize];
        let column = |row_lane: u32, node: u32| -> (u32, u32) {
            let [x, y, _] = layout.components(node as usize);
            (x as u32 - row_lane, (y - x) as u32)
        };
        for nodes in &grid.elements {
            for pair in 0..64 {
                let (row, node) = pairs(nodes, pair);
                if !is_kept(row, node) {
                    continue;
                }
                let (block, lane) = block_of(row);
                let wanted = column(lane, node);
                if !columns[block].contains(&wanted) {
                    columns[block].push(wanted);
                }
            }
        }
        let mut block_diagonals = vec![0];
        let mut diagonals = Vec::new();
        for list in &mut columns {
            list.sort_unstable();
            diagonals.extend(list.iter().map(|&(column, step)| Diagonal { column, step }));
            block_diagonals.push(diagonals.len());
        }
        let target = |row: u32, node: u32| -> u32 {
            if !is_kept(row, node) {
                return NOT_KEPT;
            }
            let (block, lane) = block_of(row);
            let wanted = column(lane, node);
            let found = columns[block]
                .binary_search(&wanted)
                .expect("in the pattern");
            ((block_diagonals[block] + found) * 9 * LANES) as u32 + lane
        };
        let targets = grid
            .elements
            .iter()
            .map(|nodes| {
                std::array::from_fn(|pair| {
                    let (row, node) = pairs(nodes, pair);
                    target(row, node)
                })
            })
            .collect();
        let own = (0..grid.node_count() as u32)
            .map(|n| target(n, n))
            .collect();
        let mut slabs = Vec::new();
        let mut first = 0;
        for plane in 0..layout.planes() - 1 {
            let in_slab = |cell: &[u32; 3]| cell[0] as usize == plane;
            let count = grid.cells[first..]
                .iter()
                .take_while(|c| in_slab(c))
                .count();
            slabs.push(first..first + count);
            first += count;
        }
        let of_plane = |&block: &usize| block_diagonals[block] * 9;
        Self {
            starts: layout.starts.clone(),
            parallel: layout.parallel(),
            entry_starts: plane_blocks.iter().map(of_plane).collect(),
            plane_blocks,
            entries: vec![[0.0; LANES]; diagonals.len() * 9],
            block_diagonals,
            diagonals,
            targets,
            own,
            slabs,
            arch: Arch::new(),
        }
    }

    /// Sets the entries to the sum of the elements' matrices.
    pub(super) fn assemble(&mut self, matrices: &[ElementMatrix]) {
        let mut entries = std::mem::take(&mut self.entries);
        entries.fill([0.0; LANES]);
        let this = &*self;
        over_slabs(
            &this.entry_starts,
            &mut entries,
            this.parallel,
            |slab, part| {
                let part = part.as_flattened_mut();
                let first = this.entry_starts[slab] * LANES;
                for element in this.slabs[slab].clone() {
                    let matrix = &matrices[element];
                    for (pair, target) in kept(&this.targets[element]) {
                        let (n, m) = (pair / 8, pair % 8);
                        let place = &mut part[target as usize - first..][..8 * LANES + 1];
                        for (block, (i, j)) in matrix.iter().zip(BLOCKS) {
                            place[(3 * i + j) * LANES] += block[n][m];
                            if i != j {
                                place[(3 * j + i) * LANES] += block[m][n];
                            }
                        }
                    }
                }
            },
        );
        self.entries = entries;
    }

    /// The diagonal block of a node: six entries of a symmetric matrix.
    pub(super) fn diagonal(&self, node: usize) -> [f32; 6] {
        let first = self.own[node] as usize;
        BLOCKS.map(|(i, j)| self.entries.as_flattened()[first + (3 * i + j) * LANES])
    }

    /// Adds the square of a form over an element's corners, by its coefficients of their x, y and z.
    pub(super) fn add_square(&mut self, element: usize, vector: &[[f32; 8]; 3]) {
        let entries = self.entries.as_flattened_mut();
        for (pair, target) in kept(&self.targets[element]) {
            for entry in 0..9 {
                let product = vector[entry / 3][pair / 8] * vector[entry % 3][pair % 8];
                entries[target as usize + entry * LANES] += product;
            }
        }
    }

    /// Calls `f(row node, column node, row component, column component, value)` for all entries among an element's corners.
    pub(super) fn for_each_entry(
        &self,
        grid: &Grid,
        mut f: impl FnMut(u32, u32, usize, usize, f32),
    ) {
        let entries = self.entries.as_flattened();
        for (nodes, targets) in grid.elements.iter().zip(&self.targets) {
            for (pair, target) in kept(targets) {
                let (row, column) = (nodes[pair / 8], nodes[pair % 8]);
                for entry in 0..9 {
                    let value = entries[target as usize + entry * LANES];
                    f(row, column, entry / 3, entry % 3, value);
                    f(column, row, entry % 3, entry / 3, value);
                }
            }
        }
    }

    /// `y = A x`, prescribed rows included; the padding of `y` may hold anything finite.
    pub(super) fn apply(&self, x: &[f32], y: &mut [f32]) {
        y.fill(0.0);
        let last = self.slabs.len() - 1;
        over_slabs(&self.starts, y, self.parallel, |slab, y| {
            // The last slab has the rows of its second plane as well.
            let planes = slab..slab + 1 + usize::from(slab == last);
            for plane in planes {
                self.arch.dispatch(Product {
                    stencil: self,
                    plane,
                    x,
                    y,
                    offset: self.starts[slab],
                });
            }
        });
    }
}

/// Pairs of corners whose entries are kept, with their places.
fn kept(targets: &[u32; 64]) -> impl Iterator<Item = (usize, u32)> {
    let pairs = targets.iter().copied().enumerate();
    pairs.filter(|&(_, target)| target != NOT_KEPT)
}

/// The rows of one plane.
struct Product<'a> {
    stencil: &'a Stencil,
    plane: usize,
    x: &'a [f32],
    /// From number `offset` on.
    y: &'a mut [f32],
    offset: usize,
}

impl WithSimd for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (stencil, plane) = (self.stencil, self.plane);
        let [first, end] = [plane, plane + 1].map(|plane| stencil.starts[plane]);
        let own_step = (end - first) / 3;
        let blocks = stencil.plane_blocks[plane]..stencil.plane_blocks[plane + 1];
        let zero = simd.splat_f32s(0.0);
        for (row, block) in blocks.enumerate() {
            let range = stencil.block_diagonals[block]..stencil.block_diagonals[block + 1];
            let entries = &stencil.entries[range.start * 9..range.end * 9];
            for shift in (0..LANES).step_by(S::F32_LANES) {
                let at = first + row * LANES + shift;
                let mut own = [zero; 3];
                for (j, own) in own.iter_mut().enumerate() {
                    *own = load::<S>(self.x, at + j * own_step);
                }
                let mut sums = [zero; 3];
                let mut more = sums;
                let diagonals = stencil.diagonals[range.clone()].iter();
                // The first one is that of the rows' own blocks.
                let mut both_ways = false;
                for (d, e) in diagonals.zip(entries.as_chunks::<9>().0) {
                    let column = d.column as usize + shift;
                    let step = d.step as usize;
                    let mut x = [zero; 3];
                    for (j, x) in x.iter_mut().enumerate() {
                        *x = load::<S>(self.x, column + j * step);
                    }
                    let mut back = [zero; 3];
                    for i in 0..3 {
                        let e = &e[3 * i..3 * i + 3];
                        let e = [
                            load::<S>(&e[0], shift),
                            load::<S>(&e[1], shift),
                            load::<S>(&e[2], shift),
                        ];
                        sums[i] = simd.mul_add_e_f32s(e[0], x[0], sums[i]);
                        more[i] = simd.mul_add_e_f32s(e[1], x[1], more[i]);
                        sums[i] = simd.mul_add_e_f32s(e[2], x[2], sums[i]);
                        for j in 0..3 {
                            back[j] = simd.mul_add_e_f32s(e[j], own[i], back[j]);
                        }
                    }
                    if both_ways {
                        for (j, back) in back.iter().enumerate() {
                            add_to(simd, self.y, column + j * step - self.offset, *back);
                        }
                    }
                    both_ways = true;
                }
                for i in 0..3 {
                    let at = at + i * own_step - self.offset;
                    add_to(simd, self.y, at, simd.add_f32s(sums[i], more[i]));
                }
            }
        }
    }
}
