//! Which parts of a body may add to the nodes at the same time.

use super::block::LANES;
use nalgebra::Vector3;
use std::ops::Range;

/// Fewer elements than this are not worth a task.
const LEAST: usize = 128;

/// Consecutive elements, in blocks, and the nodes they touch.
#[derive(Clone, Debug)]
struct Slab {
    blocks: Range<usize>,
    nodes: Range<usize>,
}

/// Consecutive slabs of a body. Every slab shares nodes with none but its two neighbours, so all even slabs can add to the nodes
/// side by side, and after them all odd ones. Each node is added to in one fixed order, whatever the number of threads.
#[derive(Clone, Debug, Default)]
pub(in crate::effects) struct Slabs {
    /// The even slabs, then the odd ones, each by rising nodes.
    phases: [Vec<Slab>; 2],
}

impl Slabs {
    /// Divides a body. Elements and nodes that are numbered along one direction give slabs across it; a numbering without order
    /// gives a single slab.
    pub(in crate::effects) fn new(elements: &[[u32; 8]], node_count: usize) -> Self {
        // Least node of all elements from one on.
        let mut least = vec![node_count as u32; elements.len() + 1];
        for (i, nodes) in elements.iter().enumerate().rev() {
            least[i] = nodes.iter().fold(least[i + 1], |least, &n| least.min(n));
        }
        let mut phases = [Vec::new(), Vec::new()];
        let (mut start, mut count) = (0, 0);
        // What the slabs from the one after the next on must stay beyond: one more than the largest node up to the last slab.
        let mut beyond = 0;
        while start < elements.len() {
            let mut end = elements.len().min(start + LEAST);
            while end < elements.len() && least[end] < beyond {
                end = elements.len().min(end + LANES);
            }
            let nodes = elements[start..end].iter().flatten();
            let largest = nodes.fold(0, |largest, &n| largest.max(n + 1));
            phases[count % 2].push(Slab {
                blocks: start / LANES..end.div_ceil(LANES),
                nodes: least_of(&elements[start..end])..largest as usize,
            });
            beyond = beyond.max(largest);
            (start, count) = (end, count + 1);
        }
        Self { phases }
    }

    /// Calls `work(blocks, first, out)` for every slab, where `out` is the part of all nodes that the slab touches and `first` the
    /// number of its first node, and returns the sum of what it returns, added in a fixed order.
    pub(super) fn run(
        &self,
        out: &mut [Vector3<f64>],
        work: &(impl Fn(Range<usize>, usize, &mut [Vector3<f64>]) -> f64 + Sync),
    ) -> f64 {
        let work = |blocks, first, out: &mut _, _: &mut [()]| work(blocks, first, out);
        self.run_with(out, (&mut [], 0), (0.0, |a, b| a + b), &work)
    }

    /// As [`Slabs::run`], with the part of `data` that belongs to the slab's blocks, so many entries to each. What `work` returns is put
    /// together by a function that has a neutral value.
    pub(super) fn run_with<T: Send, R: Send>(
        &self,
        out: &mut [Vector3<f64>],
        (data, per_block): (&mut [T], usize),
        (neutral, both): (R, fn(R, R) -> R),
        work: &(impl Fn(Range<usize>, usize, &mut [Vector3<f64>], &mut [T]) -> R + Sync),
    ) -> R {
        let mut all = neutral;
        for slabs in self.phases.iter().filter(|slabs| !slabs.is_empty()) {
            let parts = Parts {
                first_node: 0,
                out,
                first_block: 0,
                data,
                per_block,
            };
            all = both(all, halves(slabs, parts, both, work));
        }
        all
    }

    /// As [`Slabs::run`], by ranges of the `count` elements instead of blocks, for what returns nothing.
    pub(in crate::effects) fn run_elements(
        &self,
        out: &mut [Vector3<f64>],
        count: usize,
        work: &(impl Fn(Range<usize>, usize, &mut [Vector3<f64>]) + Sync),
    ) {
        self.run(out, &|blocks, first, out| {
            work(
                blocks.start * LANES..count.min(blocks.end * LANES),
                first,
                out,
            );
            0.0
        });
    }

    /// Bytes held.
    pub(in crate::effects) fn bytes(&self) -> usize {
        let slabs = self.phases.iter().map(|phase| phase.len());
        slabs.sum::<usize>() * size_of::<Slab>()
    }
}

fn least_of(elements: &[[u32; 8]]) -> usize {
    let nodes = elements.iter().flatten();
    nodes.fold(u32::MAX, |least, &n| least.min(n)) as usize
}

/// What consecutive slabs write to: nodes from `first_node` on, and `per_block` entries for each block from `first_block` on.
struct Parts<'a, T> {
    first_node: usize,
    out: &'a mut [Vector3<f64>],
    first_block: usize,
    data: &'a mut [T],
    per_block: usize,
}

impl<T> Parts<'_, T> {
    /// What comes before a slab, and the rest.
    fn cut(&mut self, slab: &Slab) -> (Parts<'_, T>, Parts<'_, T>) {
        let (node, block) = (slab.nodes.start, slab.blocks.start);
        let per_block = self.per_block;
        let (low_out, high_out) = self.out.split_at_mut(node - self.first_node);
        let (low, high) = (self.data).split_at_mut((block - self.first_block) * per_block);
        (
            Parts {
                first_node: self.first_node,
                out: low_out,
                first_block: self.first_block,
                data: low,
                per_block,
            },
            Parts {
                first_node: node,
                out: high_out,
                first_block: block,
                data: high,
                per_block,
            },
        )
    }
}

/// Runs the first and the second half of the slabs, of which there is one at least, side by side.
fn halves<T: Send, R: Send>(
    slabs: &[Slab],
    mut parts: Parts<T>,
    both: fn(R, R) -> R,
    work: &(impl Fn(Range<usize>, usize, &mut [Vector3<f64>], &mut [T]) -> R + Sync),
) -> R {
    if let [slab] = slabs {
        let (_, parts) = parts.cut(slab);
        let out = &mut parts.out[..slab.nodes.len()];
        let data = &mut parts.data[..slab.blocks.len() * parts.per_block];
        return work(slab.blocks.clone(), parts.first_node, out, data);
    }
    let (low, high) = slabs.split_at(slabs.len() / 2);
    let (low_parts, high_parts) = parts.cut(&high[0]);
    let (a, b) = rayon::join(
        || halves(low, low_parts, both, work),
        || halves(high, high_parts, both, work),
    );
    both(a, b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use hex_mesh::{HexMesh, Quadrature};

    /// All slabs of a body in their order.
    fn in_order(slabs: &Slabs) -> Vec<Slab> {
        let [even, odd] = &slabs.phases;
        let mut all: Vec<Slab> = even.iter().chain(odd).cloned().collect();
        all.sort_by_key(|slab| slab.blocks.start);
        all
    }

    fn check(elements: &[[u32; 8]], node_count: usize) -> usize {
        let slabs = Slabs::new(elements, node_count);
        let all = in_order(&slabs);
        let mut next = 0;
        for slab in &all {
            assert_eq!(slab.blocks.start, next);
            next = slab.blocks.end;
            let end = elements.len().min(slab.blocks.end * LANES);
            for &node in elements[slab.blocks.start * LANES..end].iter().flatten() {
                assert!(slab.nodes.contains(&(node as usize)));
            }
        }
        assert_eq!(next, elements.len().div_ceil(LANES));
        for phase in &slabs.phases {
            for pair in phase.windows(2) {
                assert!(pair[0].nodes.end <= pair[1].nodes.start, "{pair:?}");
            }
        }
        all.len()
    }

    #[test]
    fn slabs_of_one_phase_share_no_node() {
        for (cells, least) in [([40, 7, 9], 15), ([3, 20, 20], 3), ([1, 1, 1], 1)] {
            let mesh = HexMesh::solid_box(cells, 1.0, Quadrature::One).unwrap();
            let count = check(mesh.elements(), mesh.nodes().len());
            assert!(count >= least, "{cells:?} has {count} slabs");
            let by_use = HexMesh::from_cells(
                mesh.cells().to_vec(),
                Vector3::zeros(),
                1.0,
                Quadrature::One,
            )
            .unwrap();
            check(by_use.elements(), by_use.nodes().len());
        }
    }

    /// Elements in no order at all share nodes with everything: one task.
    #[test]
    fn shuffled_elements_are_one_slab() {
        let mesh = HexMesh::solid_box([12, 12, 12], 1.0, Quadrature::One).unwrap();
        let count = mesh.elements().len();
        let shuffled: Vec<_> = (0..count)
            .map(|i| mesh.elements()[i * 1001 % count])
            .collect();
        assert!(check(&shuffled, mesh.nodes().len()) <= 2);
    }
}
