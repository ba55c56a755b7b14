//! Transfer of residuals and corrections between two levels' packed vectors.

use super::layout::Layout;
use super::transfer::Rows;

/// For every node of one level, the free nodes of another that its value comes from.
struct PackedRows {
    offsets: Vec<u32>,
    /// Slot of the x component, distance to the next components, weight.
    entries: Vec<(u32, u32, f32)>,
}

impl PackedRows {
    /// `own` and `other` say which nodes are held: their rows are empty, and they are in no row.
    fn new(rows: &Rows, own: &[bool], other: &[bool], layout: &Layout) -> Self {
        let mut packed = Self {
            offsets: vec![0],
            entries: Vec::new(),
        };
        for (node, &held) in own.iter().enumerate() {
            let row = rows
                .row(node)
                .filter(|(from, _)| !held && !other[*from as usize]);
            packed.entries.extend(row.map(|(from, weight)| {
                let [x, y, _] = layout.components(from as usize);
                (x as u32, (y - x) as u32, weight)
            }));
            packed.offsets.push(packed.entries.len() as u32);
        }
        packed
    }

    /// The weighted sum for one node.
    #[inline(always)]
    fn gather(&self, node: usize, from: &[f32]) -> [f32; 3] {
        let range = self.offsets[node] as usize..self.offsets[node + 1] as usize;
        let mut sum = [0.0; 3];
        for &(slot, step, weight) in &self.entries[range] {
            for (c, sum) in sum.iter_mut().enumerate() {
                *sum += weight * from[slot as usize + c * step as usize];
            }
        }
        sum
    }
}

/// Between a level and the next coarser one. Held nodes on either take no part.
pub(super) struct Correction {
    down: PackedRows,
    up: PackedRows,
}

impl Correction {
    pub(super) fn new(
        transfer: &super::transfer::Transfer,
        (fine, fine_held): (&Layout, &[bool]),
        (coarse, coarse_held): (&Layout, &[bool]),
    ) -> Self {
        Self {
            down: PackedRows::new(&transfer.restriction, coarse_held, fine_held, fine),
            up: PackedRows::new(&transfer.interpolation, fine_held, coarse_held, coarse),
        }
    }

    /// `coarse = P^T fine` at the nodes.
    pub(super) fn restrict(&self, fine: &[f32], layout: &Layout, coarse: &mut [f32]) {
        layout.by_plane(coarse, |nodes, start, part| {
            for &node in nodes {
                let node = node as usize;
                let sum = self.down.gather(node, fine);
                for (at, value) in layout.components(node).into_iter().zip(sum) {
                    part[at - start] = value;
                }
            }
        });
    }

    /// `fine += P coarse`.
    pub(super) fn interpolate(&self, coarse: &[f32], layout: &Layout, fine: &mut [f32]) {
        layout.by_plane(fine, |nodes, start, part| {
            for &node in nodes {
                let node = node as usize;
                let sum = self.up.gather(node, coarse);
                for (at, value) in layout.components(node).into_iter().zip(sum) {
                    part[at - start] += value;
                }
            }
        });
    }
}
