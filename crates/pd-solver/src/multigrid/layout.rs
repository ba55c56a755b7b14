//! How nodal vectors lie in memory for the kernels of the cycle: plane by plane, in each plane all x, then all y, then all z.
//!
//! Neighbours along z are neighbours in memory, so that a kernel loads the values of many nodes at once. Every plane ends in
//! padding that loads may run over; padding and prescribed nodes hold zeros wherever that matters.

use super::grid::Grid;
use nalgebra::Vector3;
use pulp::Simd;
use rayon::prelude::*;

/// Numbers that a kernel treats at once, whatever the width of the machine's registers.
pub(super) const LANES: usize = 16;

/// As many single-precision numbers as a kernel treats at once.
pub(super) type Lanes = [f32; LANES];

/// Levels with fewer numbers than this are not worth another thread. Those above it are as much for keeping it awake as for their own sake: to wake
/// it on the next finer level takes longer than the work here.
const SERIAL: usize = 3_000;
/// Fewer numbers than this are one task.
const TASK: usize = 2_000;

/// The places of all nodes in a vector.
pub(super) struct Layout {
    /// Where each plane starts, and the end.
    pub(super) starts: Vec<usize>,
    /// The same for vectors of six components.
    pub(super) doubled: Vec<usize>,
    /// Where the x component of every node lies.
    pub(super) slots: Vec<u32>,
    /// Distance between the components of every node.
    steps: Vec<u32>,
    /// The nodes in the order of their slots.
    order: Vec<u32>,
    /// First place of each plane in that order, and the end.
    plane_nodes: Vec<usize>,
}

impl Layout {
    pub(super) fn new(grid: &Grid) -> Self {
        let order = columns(&grid.places);
        // Loads may also begin before the first node.
        let mut starts = vec![LANES];
        let mut plane_nodes = vec![0];
        let mut slots = vec![0; order.len()];
        let mut steps = vec![0; order.len()];
        for plane in 0..grid.planes[0].len() {
            let (start, first) = (starts[plane], plane_nodes[plane]);
            let rest = order[first..].iter();
            let nodes = rest.take_while(|&&n| grid.places[n as usize][0] as usize == plane);
            let count = nodes.clone().count();
            let length = (count + LANES + 1).next_multiple_of(LANES);
            for (rank, &node) in nodes.enumerate() {
                slots[node as usize] = (start + rank) as u32;
                steps[node as usize] = length as u32;
            }
            starts.push(start + 3 * length);
            plane_nodes.push(first + count);
        }
        Self {
            doubled: starts.iter().map(|s| 2 * s).collect(),
            starts,
            slots,
            steps,
            order,
            plane_nodes,
        }
    }

    /// The nodes of a plane.
    pub(super) fn nodes(&self, plane: usize) -> &[u32] {
        &self.order[self.plane_nodes[plane]..self.plane_nodes[plane + 1]]
    }

    /// Length of a vector.
    pub(super) fn len(&self) -> usize {
        self.starts[self.starts.len() - 1]
    }

    pub(super) fn planes(&self) -> usize {
        self.starts.len() - 1
    }

    /// Whether loops over this level run on several threads.
    pub(super) fn parallel(&self) -> bool {
        self.len() > SERIAL
    }

    /// Distance between the components in a plane.
    pub(super) fn step(&self, plane: usize) -> usize {
        (self.starts[plane + 1] - self.starts[plane]) / 3
    }

    /// A vector of zeros.
    pub(super) fn zeros(&self) -> Vec<f32> {
        vec![0.0; self.len()]
    }

    /// Where the three components of a node lie.
    #[inline(always)]
    pub(super) fn components(&self, node: usize) -> [usize; 3] {
        let (slot, step) = (self.slots[node] as usize, self.steps[node] as usize);
        [slot, slot + step, slot + 2 * step]
    }

    /// Adds six components at a node to a vector of six components.
    pub(super) fn add_block(&self, node: usize, d: [f32; 6], out: &mut [f32]) {
        let (slot, step) = (self.slots[node] as usize, self.steps[node] as usize);
        // Planes are twice as long there as in a vector of three components.
        let plane = self.starts.partition_point(|&start| start <= slot) - 1;
        let first = slot + self.starts[plane];
        for (c, d) in d.into_iter().enumerate() {
            out[first + c * step] += d;
        }
    }

    /// `packed = scale * nodal` at the nodes; the padding is left alone.
    pub(super) fn pack(&self, nodal: &[Vector3<f64>], scale: f64, packed: &mut [f32]) {
        // Node by node in order of memory, so a plane's part is written by one thread.
        self.by_plane(packed, |nodes, start, part| {
            for &node in nodes {
                let at = self.components(node as usize);
                for a in 0..3 {
                    part[at[a] - start] = (nodal[node as usize][a] * scale) as f32;
                }
            }
        });
    }

    /// `nodal = scale * packed`.
    pub(super) fn unpack(&self, packed: &[f32], scale: f64, nodal: &mut [Vector3<f64>]) {
        let one = |(node, out): (usize, &mut Vector3<f64>)| {
            let at = self.components(node);
            *out = Vector3::from_fn(|a, _| packed[at[a]] as f64 * scale);
        };
        if self.parallel() {
            let nodal = nodal.par_iter_mut().with_min_len(4096);
            nodal.enumerate().for_each(one);
        } else {
            nodal.iter_mut().enumerate().for_each(one);
        }
    }

    /// Calls `f` with the nodes of each plane, where the plane starts, and its part of a vector.
    pub(super) fn by_plane(&self, data: &mut [f32], f: impl Fn(&[u32], usize, &mut [f32]) + Sync) {
        for_parts(
            data,
            &self.starts,
            self.parallel(),
            &|plane, part: &mut [f32]| {
                f(self.nodes(plane), self.starts[plane], part);
            },
        );
    }
}

/// What can be cut in two, like a mutable slice.
pub(super) trait Cut: Sized + Send {
    /// Everything before an index, and the rest.
    fn cut(self, at: usize) -> (Self, Self);
}

impl<T: Send> Cut for &mut [T] {
    fn cut(self, at: usize) -> (Self, Self) {
        self.split_at_mut(at)
    }
}

impl<A: Cut, B: Cut> Cut for (A, Option<B>) {
    fn cut(self, at: usize) -> (Self, Self) {
        let (a, rest_a) = self.0.cut(at);
        match self.1.map(|b| b.cut(at)) {
            Some((b, rest_b)) => ((a, Some(b)), (rest_a, Some(rest_b))),
            None => ((a, None), (rest_a, None)),
        }
    }
}

/// Calls `f` with the number of each part and the part of `data` from its start to the next, on several threads if `parallel`.
pub(super) fn for_parts<D: Cut>(
    data: D,
    starts: &[usize],
    parallel: bool,
    f: &(impl Fn(usize, D) + Sync),
) {
    let (_, data) = data.cut(starts[0]);
    run_parts(data, starts, 0, parallel, f);
}

/// `data` begins at the first start; `first` is the number of that part.
fn run_parts<D: Cut>(
    data: D,
    starts: &[usize],
    first: usize,
    parallel: bool,
    f: &(impl Fn(usize, D) + Sync),
) {
    let parts = starts.len() - 1;
    if parts == 1 {
        return f(first, data);
    }
    let middle = parts / 2;
    let (low, high) = data.cut(starts[middle] - starts[0]);
    let run_low = || run_parts(low, &starts[..=middle], first, parallel, f);
    let run_high = || run_parts(high, &starts[middle..], first + middle, parallel, f);
    if parallel && starts[parts] - starts[0] > TASK {
        rayon::join(run_low, run_high);
    } else {
        run_low();
        run_high();
    }
}

/// All nodes plane by plane, in each column by column, z fastest; of several nodes at one place, each belongs to another run of
/// the column.
fn columns(places: &[[u32; 3]]) -> Vec<u32> {
    let mut order: Vec<u32> = (0..places.len() as u32).collect();
    order.sort_by_key(|&n| places[n as usize]);
    let mut copies = vec![0u32; places.len()];
    let mut several = false;
    for pair in 1..order.len() {
        let (last, node) = (order[pair - 1] as usize, order[pair] as usize);
        if places[last] == places[node] {
            copies[node] = copies[last] + 1;
            several = true;
        }
    }
    if several {
        order.sort_by_key(|&n| {
            let [x, y, z] = places[n as usize];
            (x, y, copies[n as usize], z)
        });
    }
    order
}

/// Calls `f` for every slab, the space between two neighbouring planes, with the part of `data` that belongs to the two planes.
///
/// Slabs that share a plane never run at the same time: first the even ones, then the odd ones, so that sums come out the same
/// for any number of threads. `starts` says where each plane's part begins, and the end.
pub(super) fn over_slabs<T: Send>(
    starts: &[usize],
    data: &mut [T],
    parallel: bool,
    f: impl Fn(usize, &mut [T]) + Sync,
) {
    let slabs = starts.len() - 2;
    if !parallel {
        for slab in 0..slabs {
            f(slab, &mut data[starts[slab]..starts[slab + 2]]);
        }
        return;
    }
    for parity in 0..2 {
        let own = slabs.saturating_sub(parity).div_ceil(2);
        run_slabs(data, 0, starts, parity, own, &f);
    }
}

/// Runs `count` slabs, every second one from `slab` on; `data` begins at `offset`.
fn run_slabs<T: Send>(
    data: &mut [T],
    offset: usize,
    starts: &[usize],
    slab: usize,
    count: usize,
    f: &(impl Fn(usize, &mut [T]) + Sync),
) {
    if count == 0 {
        return;
    }
    if count == 1 {
        return f(
            slab,
            &mut data[starts[slab] - offset..starts[slab + 2] - offset],
        );
    }
    let middle = slab + 2 * (count / 2);
    let (low, high) = data.split_at_mut(starts[middle] - offset);
    rayon::join(
        || run_slabs(low, offset, starts, slab, count / 2, f),
        || run_slabs(high, starts[middle], starts, middle, count - count / 2, f),
    );
}

/// The numbers of one register from `at` on.
#[inline(always)]
pub(super) fn load<S: Simd>(data: &[f32], at: usize) -> S::f32s {
    S::as_simd_f32s(&data[at..at + S::F32_LANES]).0[0]
}

/// Adds to the numbers of one register from `at` on.
#[inline(always)]
pub(super) fn add_to<S: Simd>(simd: S, data: &mut [f32], at: usize, value: S::f32s) {
    let place = &mut S::as_mut_simd_f32s(&mut data[at..at + S::F32_LANES]).0[0];
    *place = simd.add_f32s(*place, value);
}
