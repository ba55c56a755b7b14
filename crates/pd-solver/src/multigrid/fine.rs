//! The operator of the finest level, without a matrix: one core per element, and the constant stiffness of its other modes.
//!
//! With the eight mode coefficients `a` of an element's corners, the operator is
//! `stiffness_m a_m` per mode, less, for the three linear modes, `sum_k m_k (m_k : a)` with the core's three vectors m_k. That is the
//! Hessian of the energy with one sample per element and the others' constant part: spectrally close to that of any number of
//! samples, at a fraction of its memory traffic. Sixteen elements go side by side.

use super::grid::Grid;
use super::layout::{LANES, Lanes, Layout, load, over_slabs};
use super::modes::{LINEAR, stiffness};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;
use std::ops::Range;

/// Entries of a core: three 3x3 matrices.
pub(super) const CORE: usize = 27;

/// Sixteen elements whose corners follow one another in memory.
struct Block {
    /// Slots of the first element's corners, relative to the slab's part.
    base: [u32; 8],
    /// Zero where there is no element.
    weight: Lanes,
    cores: [Lanes; CORE],
}

/// A linear form over the nodes of one element, `stiffness (weights . x)^2 / 2`.
struct Form {
    /// Slots of the nodes' x components relative to the slab's part, distances to the next components, weights.
    nodes: Vec<(u32, u32, f32)>,
    stiffness: f32,
}

/// The elements between two lattice planes.
struct Slab {
    blocks: Range<usize>,
    forms: Vec<Form>,
    /// Distance between components in its two planes.
    step: [usize; 2],
}

pub(super) struct FineOperator {
    starts: Vec<usize>,
    /// The same for vectors of six components.
    doubled: Vec<usize>,
    parallel: bool,
    slabs: Vec<Slab>,
    blocks: Vec<Block>,
    /// The element in each lane of each block; `u32::MAX` where there is none.
    elements: Vec<[u32; LANES]>,
    /// Stiffness of every mode, in units of that of the linear ones.
    modes: [f32; 8],
    arch: Arch,
}

/// An element's linear form: element, weights of its corners, stiffness.
pub(crate) type ElementForm = (u32, [f64; 8], f64);

impl FineOperator {
    /// The operator in units of the linear modes' stiffness `unit`, for a grid of equal cubes.
    pub(super) fn new(grid: &Grid, layout: &Layout, forms: &[ElementForm], unit: f64) -> Self {
        let modes = stiffness(&grid.size(0));
        let linear = modes[LINEAR[0]];
        let mut operator = Self {
            starts: layout.starts.clone(),
            doubled: layout.doubled.clone(),
            parallel: layout.parallel(),
            slabs: Vec::new(),
            blocks: Vec::new(),
            elements: Vec::new(),
            modes: modes.map(|m| (m / linear) as f32),
            arch: Arch::new(),
        };
        let mut order: Vec<u32> = (0..grid.elements.len() as u32).collect();
        order.sort_by_key(|&e| grid.cells[e as usize]);
        let mut rest = &order[..];
        for plane in 0..layout.planes() - 1 {
            let in_slab = |&&e: &&u32| grid.cells[e as usize][0] as usize == plane;
            let (elements, tail) = rest.split_at(rest.iter().take_while(in_slab).count());
            operator.add_slab(grid, layout, plane, elements);
            rest = tail;
        }
        for (element, weights, stiffness) in forms {
            let element = *element as usize;
            let plane = grid.cells[element][0] as usize;
            let nodes = grid.elements[element].iter().zip(weights);
            let nodes = nodes.filter(|(_, w)| **w != 0.0).map(|(&node, w)| {
                let [x, y, _] = layout.components(node as usize);
                ((x - layout.starts[plane]) as u32, (y - x) as u32, *w as f32)
            });
            operator.slabs[plane].forms.push(Form {
                nodes: nodes.collect(),
                stiffness: (stiffness / unit) as f32,
            });
        }
        operator
    }

    fn add_slab(&mut self, grid: &Grid, layout: &Layout, plane: usize, elements: &[u32]) {
        let first_block = self.blocks.len();
        for &element in elements {
            let slots = grid.elements[element as usize].map(|node| layout.slots[node as usize]);
            // A block takes what lies within its lanes behind its first element, at all eight corners alike.
            let slots = slots.map(|s| s - layout.starts[plane] as u32);
            let lane_in = |block: &Block| -> Option<u32> {
                let lane = slots[0].checked_sub(block.base[0])?;
                let fits = (0..8).all(|n| slots[n] == block.base[n] + lane);
                (lane < LANES as u32 && fits && block.weight[lane as usize] == 0.0).then_some(lane)
            };
            let current = self.blocks[first_block..].last().and_then(lane_in);
            let lane = current.unwrap_or_else(|| {
                self.blocks.push(Block {
                    base: slots,
                    weight: [0.0; LANES],
                    cores: [[0.0; LANES]; CORE],
                });
                self.elements.push([u32::MAX; LANES]);
                0
            });
            let block = self.blocks.len() - 1;
            self.blocks[block].weight[lane as usize] = 1.0;
            self.elements[block][lane as usize] = element;
        }
        self.slabs.push(Slab {
            blocks: first_block..self.blocks.len(),
            forms: Vec::new(),
            step: [layout.step(plane), layout.step(plane + 1)],
        });
    }

    /// Takes over the cores of all elements.
    pub(super) fn set_cores(&mut self, cores: &[[f32; CORE]]) {
        let elements = self.elements.par_iter();
        self.blocks
            .par_iter_mut()
            .zip(elements)
            .with_min_len(16)
            .for_each(|(block, elements)| {
                for (lane, &element) in elements.iter().enumerate() {
                    if let Some(core) = cores.get(element as usize) {
                        for (entry, value) in block.cores.iter_mut().zip(core) {
                            entry[lane] = *value;
                        }
                    }
                }
            });
    }

    /// Share of the lanes that hold an element.
    #[cfg(test)]
    pub(super) fn occupancy(&self) -> f64 {
        let lanes = self.elements.as_flattened();
        let used = lanes.iter().filter(|&&e| e != u32::MAX).count();
        used as f64 / lanes.len() as f64
    }

    /// `y = A x`, prescribed rows included; the padding of `y` may hold anything finite.
    pub(super) fn apply(&self, x: &[f32], y: &mut [f32]) {
        y.fill(0.0);
        over_slabs(&self.starts, y, self.parallel, |slab, part| {
            let x = &x[self.starts[slab]..self.starts[slab + 2]];
            let slab = &self.slabs[slab];
            self.arch.dispatch(Product {
                slab,
                blocks: &self.blocks[slab.blocks.clone()],
                modes: &self.modes,
                x,
                y: part,
            });
        });
    }

    /// Adds the 3x3 diagonal blocks of all nodes to `out`, laid out like a vector but with six components.
    pub(super) fn add_diagonal(&self, out: &mut [f32]) {
        over_slabs(&self.doubled, out, self.parallel, |slab, part| {
            let slab = &self.slabs[slab];
            self.arch.dispatch(Diagonal {
                slab,
                blocks: &self.blocks[slab.blocks.clone()],
                modes: &self.modes,
                out: part,
            });
        });
    }
}

/// Slot of a corner of a block's first element, one component, as offset into the slab's part. A plane holds `components`
/// components of each node.
#[inline(always)]
fn corner(block: &Block, step: [usize; 2], component: usize, components: usize, n: usize) -> usize {
    let base = block.base[n] as usize;
    // Bases are given for vectors of three components; the second plane starts behind all components of the first.
    if n < 4 {
        base + component * step[0]
    } else {
        base + (components - 3) * step[0] + component * step[1]
    }
}

#[inline(always)]
fn add_to<S: Simd>(simd: S, data: &mut [f32], at: usize, value: S::f32s) {
    let place = &mut S::as_mut_simd_f32s(&mut data[at..at + S::F32_LANES]).0[0];
    *place = simd.add_f32s(*place, value);
}

/// `y += A x` over the blocks and forms of a slab.
struct Product<'a> {
    slab: &'a Slab,
    blocks: &'a [Block],
    modes: &'a [f32; 8],
    x: &'a [f32],
    y: &'a mut [f32],
}

impl WithSimd for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let step = self.slab.step;
        let zero = simd.splat_f32s(0.0);
        let mut stiffness = [zero; 8];
        for (out, value) in stiffness.iter_mut().zip(self.modes) {
            *out = simd.splat_f32s(*value);
        }
        for block in self.blocks {
            for shift in (0..LANES).step_by(S::F32_LANES) {
                let mut a = [[zero; 8]; 3];
                for (i, a) in a.iter_mut().enumerate() {
                    for (n, a) in a.iter_mut().enumerate() {
                        *a = load::<S>(self.x, corner(block, step, i, 3, n) + shift);
                    }
                    to_modes(simd, a);
                }
                core_product(simd, block, shift, &mut a);
                let weight = load::<S>(&block.weight, shift);
                for (i, a) in a.iter_mut().enumerate() {
                    a[0] = zero;
                    for mode in 1..8 {
                        let scale = simd.mul_f32s(weight, stiffness[mode]);
                        a[mode] = simd.mul_f32s(a[mode], scale);
                    }
                    from_modes(simd, a);
                    for (n, force) in a.iter().enumerate() {
                        add_to(simd, self.y, corner(block, step, i, 3, n) + shift, *force);
                    }
                }
            }
        }
        for form in &self.slab.forms {
            for component in 0..3 {
                let at = |&(slot, step, _): &(u32, u32, f32)| (slot + component * step) as usize;
                let value: f32 = form.nodes.iter().map(|n| n.2 * self.x[at(n)]).sum();
                for n in &form.nodes {
                    self.y[at(n)] += form.stiffness * n.2 * value;
                }
            }
        }
    }
}

// In what follows there are no closures over lanes: they are compiled without the instruction set that the loop is dispatched to.

/// `a -= sum_k m_k (m_k : a)` on the linear modes.
#[inline(always)]
fn core_product<S: Simd>(simd: S, block: &Block, shift: usize, a: &mut [[S::f32s; 8]; 3]) {
    let linear = *a;
    for k in 0..3 {
        let core = &block.cores[9 * k..9 * k + 9];
        let mut sums = [simd.splat_f32s(0.0); 3];
        for i in 0..3 {
            for (j, mode) in LINEAR.into_iter().enumerate() {
                let m = load::<S>(&core[3 * i + j], shift);
                sums[j] = simd.mul_add_e_f32s(m, linear[i][mode], sums[j]);
            }
        }
        let sum = simd.neg_f32s(simd.add_f32s(sums[0], simd.add_f32s(sums[1], sums[2])));
        for i in 0..3 {
            for (j, mode) in LINEAR.into_iter().enumerate() {
                let m = load::<S>(&core[3 * i + j], shift);
                a[i][mode] = simd.mul_add_e_f32s(m, sum, a[i][mode]);
            }
        }
    }
}

/// Mode coefficients of corner values, in place: sums and differences along each axis.
#[inline(always)]
fn to_modes<S: Simd>(simd: S, x: &mut [S::f32s; 8]) {
    for axis in LINEAR {
        for low in 0..8 {
            if low & axis == 0 {
                let (a, b) = (x[low], x[low + axis]);
                x[low] = simd.add_f32s(a, b);
                x[low + axis] = simd.sub_f32s(b, a);
            }
        }
    }
}

/// Corner forces of mode forces, in place: the transpose.
#[inline(always)]
fn from_modes<S: Simd>(simd: S, a: &mut [S::f32s; 8]) {
    for axis in LINEAR {
        for low in 0..8 {
            if low & axis == 0 {
                let (sum, difference) = (a[low], a[low + axis]);
                a[low] = simd.sub_f32s(sum, difference);
                a[low + axis] = simd.add_f32s(sum, difference);
            }
        }
    }
}

/// Diagonal blocks of a slab's elements and forms.
struct Diagonal<'a> {
    slab: &'a Slab,
    blocks: &'a [Block],
    modes: &'a [f32; 8],
    out: &'a mut [f32],
}

/// Places of the six entries of a symmetric matrix.
const SYMMETRIC: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];

impl WithSimd for Diagonal<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let step = self.slab.step;
        let constant: f32 = self.modes[1..].iter().sum();
        let zero = simd.splat_f32s(0.0);
        for block in self.blocks {
            for shift in (0..LANES).step_by(S::F32_LANES) {
                let weight = load::<S>(&block.weight, shift);
                let stiff = simd.mul_f32s(weight, simd.splat_f32s(constant));
                for n in 0..8 {
                    let mut d = [stiff, zero, zero, stiff, zero, stiff];
                    for core in block.cores.as_chunks::<9>().0 {
                        let mut q = [zero; 3];
                        for (i, q) in q.iter_mut().enumerate() {
                            for (j, mode) in LINEAR.into_iter().enumerate() {
                                let m = load::<S>(&core[3 * i + j], shift);
                                *q = if n & mode == 0 {
                                    simd.sub_f32s(*q, m)
                                } else {
                                    simd.add_f32s(*q, m)
                                };
                            }
                        }
                        for (d, (i, j)) in d.iter_mut().zip(SYMMETRIC) {
                            let taken = simd.mul_f32s(simd.mul_f32s(q[i], q[j]), weight);
                            *d = simd.sub_f32s(*d, taken);
                        }
                    }
                    for (c, d) in d.iter().enumerate() {
                        add_to(simd, self.out, corner(block, step, c, 6, n) + shift, *d);
                    }
                }
            }
        }
        for form in &self.slab.forms {
            for &(slot, step3, w) in &form.nodes {
                // From a place among three components to one among six.
                let first = self.slab.step[0] * 3;
                let slot = slot as usize;
                let slot = if slot >= first { slot + first } else { slot };
                for component in [0, 3, 5] {
                    self.out[slot + component * step3 as usize] += form.stiffness * w * w;
                }
            }
        }
    }
}
