//! The parts of the cells that the surface cuts: connected material within one cell.
//!
//! Each cut cell holds a small lattice of samples. Neighbouring samples are linked where both are inside and no triangle crosses the
//! segment between them. A gap between two sheets of the surface thus parts material however narrow it is and however coarse the
//! samples are. All samples lie on one lattice over the whole grid, so that links lead on through the faces between cells.

use nalgebra::Vector3;
use rayon::prelude::*;

use super::grid::CellGrid;
use super::inside::{InsideVotes, PointGrid, scan};
use super::pieces::grid_position;

/// The cells that the surface cuts. All other cells are inside or outside as a whole.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct CutCells {
    /// Samples along each axis of a cell.
    pub samples: usize,
    /// Cells along each axis of the grid.
    pub counts: [usize; 3],
    /// The cut cells, by rising flat index.
    pub cells: Vec<u32>,
    /// Per cell of the grid: its place in `cells`, or how it lies as a whole.
    slots: Vec<u32>,
    /// Per sample, x slowest: bit `axis` is set where the surface crosses the segment from the sample before along that axis.
    barriers: Vec<u8>,
    /// Per sample: 0 outside, else one more than its part.
    labels: Vec<u8>,
    /// Parts before those of each cut cell: `[cells + 1]`.
    offsets: Vec<u32>,
    /// Samples of each part.
    sizes: Vec<u16>,
}

const WHOLE_INSIDE: u32 = u32::MAX;
const WHOLE_OUTSIDE: u32 = u32::MAX - 1;
/// Cut, and not numbered yet.
const CUT: u32 = u32::MAX - 2;

/// Labels of samples before they get their part.
const OUTSIDE: u8 = 0;
const UNVISITED: u8 = u8::MAX;

/// One crossing: the cell and the sample beyond it.
struct Crossing {
    cell: u32,
    sample: u16,
    axis: u8,
}

impl CutCells {
    /// Samples the cells of a grid. `samples` is odd and at most 7; `votes` are those of the cells' centres.
    pub fn new(
        grid: &CellGrid,
        samples: usize,
        votes: &InsideVotes,
        vertices: &[Vector3<f64>],
        triangles: &[[u32; 3]],
    ) -> Self {
        let n = samples;
        let crossings = scan(
            &sample_grid(grid, n),
            vertices,
            triangles,
            |position, axis| Crossing {
                cell: flat(position.map(|i| i / n), grid.counts) as u32,
                sample: flat(position.map(|i| i % n), [n; 3]) as u16,
                axis: axis as u8,
            },
        );

        let whole = |cell| {
            if votes.is_inside(cell) {
                WHOLE_INSIDE
            } else {
                WHOLE_OUTSIDE
            }
        };
        let mut slots: Vec<u32> = (0..grid.counts.iter().product()).map(whole).collect();
        for crossing in crossings.iter().flatten() {
            slots[crossing.cell as usize] = CUT;
        }
        let mut cells = Vec::new();
        for (cell, slot) in (0..).zip(&mut slots) {
            if *slot == CUT {
                *slot = cells.len() as u32;
                cells.push(cell);
            }
        }

        let volume = n * n * n;
        let mut barriers = vec![0; cells.len() * volume];
        let mut parities = vec![0; cells.len() * volume];
        for crossing in crossings.iter().flatten() {
            let sample = slots[crossing.cell as usize] as usize * volume + crossing.sample as usize;
            barriers[sample] |= 1 << crossing.axis;
            parities[sample] ^= 1 << crossing.axis;
        }
        for axis in 0..3 {
            carry_parity(&cells, grid.counts, n, axis, &mut parities);
        }

        let centre = volume / 2;
        let mut labels = parities;
        let part_sizes: Vec<Vec<u16>> = (&cells, labels.par_chunks_mut(volume))
            .into_par_iter()
            .zip(barriers.par_chunks(volume))
            .map(|((&cell, labels), barriers)| {
                // A centre within rounding of the surface lies where the rays through all centres found it.
                let is_inside = |sample: usize, parity: u8| {
                    parity.count_ones() >= 2 || sample == centre && votes.is_inside(cell as usize)
                };
                for (sample, label) in labels.iter_mut().enumerate() {
                    *label = if is_inside(sample, *label) {
                        UNVISITED
                    } else {
                        OUTSIDE
                    };
                }
                label_parts(labels, barriers, n)
            })
            .collect();
        let mut offsets = vec![0];
        for sizes in &part_sizes {
            offsets.push(offsets[offsets.len() - 1] + sizes.len() as u32);
        }
        Self {
            samples,
            counts: grid.counts,
            cells,
            slots,
            barriers,
            labels,
            offsets,
            sizes: part_sizes.concat(),
        }
    }

    /// The place of a cell among the cut ones, if it is cut.
    pub fn slot(&self, cell: usize) -> Option<usize> {
        let slot = self.slots[cell];
        (slot < WHOLE_OUTSIDE).then_some(slot as usize)
    }

    /// Number of parts in a cell.
    pub fn part_count(&self, cell: usize) -> usize {
        match self.slots[cell] {
            WHOLE_INSIDE => 1,
            WHOLE_OUTSIDE => 0,
            slot => self.part_sizes(slot as usize).len(),
        }
    }

    /// Samples of each part of a cut cell.
    pub fn part_sizes(&self, slot: usize) -> &[u16] {
        &self.sizes[self.offsets[slot] as usize..self.offsets[slot + 1] as usize]
    }

    /// The index of a cut cell's first part among the parts of all cut cells.
    pub fn first_part(&self, slot: usize) -> usize {
        self.offsets[slot] as usize
    }

    /// Number of parts of all cut cells.
    pub fn total_parts(&self) -> usize {
        self.sizes.len()
    }

    /// The part that a sample of a cell lies in, if it is inside.
    pub fn part_at(&self, cell: usize, sample: usize) -> Option<u8> {
        match self.slots[cell] {
            WHOLE_INSIDE => Some(0),
            WHOLE_OUTSIDE => None,
            slot => self.labels[slot as usize * self.samples.pow(3) + sample].checked_sub(1),
        }
    }

    /// Whether the surface crosses the segment from the sample before, along an axis, to this one.
    pub fn has_barrier(&self, cell: usize, sample: usize, axis: usize) -> bool {
        let barriers = |slot: usize| self.barriers[slot * self.samples.pow(3) + sample];
        self.slot(cell)
            .is_some_and(|slot| barriers(slot) & 1 << axis != 0)
    }
}

/// The lattice of all samples. The middle sample of a cell is its centre.
pub(crate) fn sample_grid(grid: &CellGrid, samples: usize) -> PointGrid {
    let n = samples as f64;
    let centres = grid.centres();
    let spacing = centres.spacing / n;
    PointGrid {
        first: centres.first.add_scalar(-0.5 * (n - 1.0) * spacing),
        spacing,
        counts: grid.counts.map(|count| count * samples),
    }
}

/// Flat index of a position, x slowest.
pub(crate) fn flat([x, y, z]: [usize; 3], [_, ny, nz]: [usize; 3]) -> usize {
    (x * ny + y) * nz + z
}

/// Turns the toggles of bit `axis` into parities. Between the cut cells of a column lie whole cells, which change no parity.
fn carry_parity(cells: &[u32], counts: [usize; 3], n: usize, axis: usize, parities: &mut [u8]) {
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let mut order: Vec<([u32; 3], u32)> = (0..)
        .zip(cells)
        .map(|(slot, &cell)| {
            let position = grid_position(cell as usize, counts).map(|i| i as u32);
            ([position[u], position[v], position[axis]], slot)
        })
        .collect();
    order.par_sort_unstable();
    let strides = [n * n, n, 1];
    let bit = 1 << axis;
    let mut carried = vec![0; n * n];
    for column in order.chunk_by(|(a, _), (b, _)| a[..2] == b[..2]) {
        carried.fill(0);
        for &(_, slot) in column {
            let samples = &mut parities[slot as usize * n * n * n..][..n * n * n];
            for (row, parity) in carried.iter_mut().enumerate() {
                let start = row / n * strides[u] + row % n * strides[v];
                for step in 0..n {
                    let sample = &mut samples[start + step * strides[axis]];
                    *parity ^= *sample & bit;
                    *sample = *sample & !bit | *parity;
                }
            }
        }
    }
}

/// Numbers the connected parts of a cell's unvisited samples, in order of their first sample; returns the samples of each.
fn label_parts(labels: &mut [u8], barriers: &[u8], n: usize) -> Vec<u16> {
    let strides = [n * n, n, 1];
    let mut sizes = Vec::new();
    let mut stack = Vec::new();
    for seed in 0..labels.len() {
        if labels[seed] != UNVISITED {
            continue;
        }
        let label = sizes.len() as u8 + 1;
        let mut size = 0;
        labels[seed] = label;
        stack.push(seed);
        while let Some(sample) = stack.pop() {
            size += 1;
            for (axis, stride) in strides.into_iter().enumerate() {
                let along = sample / stride % n;
                let mut link = |neighbour: usize, barrier: usize| {
                    if labels[neighbour] == UNVISITED && barriers[barrier] & 1 << axis == 0 {
                        labels[neighbour] = label;
                        stack.push(neighbour);
                    }
                };
                if along > 0 {
                    link(sample - stride, sample);
                }
                if along + 1 < n {
                    link(sample + stride, sample + stride);
                }
            }
        }
        sizes.push(size);
    }
    sizes
}
