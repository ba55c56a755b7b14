//! The operator of the finest level, without a matrix: one core per element, at all of its points.
//!
//! With the eight mode coefficients `a` of an element's corners, the gradient at the point `xi` of [-1, 1]^3 is, up to a factor that
//! all share, `g_ij = a_i(j) + xi_k a_i(jk) + xi_l a_i(jl) + xi_k xi_l a_i(jkl)`, where a mode is named by the axes along which it
//! changes sign. The operator is the second derivative of the mean of `|g|^2 - sum_k (m_k : g)^2` with the core's three matrices m_k:
//! `m_k : g` is a polynomial of `xi` whose seven coefficients are orthogonal, so the mean is a sum of squares, with no samples left.
//! That is the Hessian of the energy with the rotation and stretch of the centre everywhere in the element: spectrally close to that of
//! eight or more samples, at a fraction of its memory traffic. (Without the core's part of the modes that change sign along several axes, they are up to
//! four times too stiff, and conjugate gradients take 10 instead of 6 iterations on a box.) Sixteen elements go side by side.

use super::grid::Grid;
use super::kept_volume::{add_pressure, volume_change, volume_diagonal};
use super::layout::{LANES, Lanes, Layout, add_to, load, over_slabs};
use super::modes::{BILINEAR, LINEAR, MEAN_SQUARES, TRILINEAR, sign, stiffness};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;
use std::ops::Range;

/// Entries of a core: three 3x3 matrices.
pub(super) const CORE: usize = 27;

/// Sixteen elements whose corners follow one another in memory.
struct Block {
    /// Slots of the first element's corners, relative to the slab's part.
    base: [u32; 8],
    /// Factor on the stiffness; zero where there is no element.
    weight: Lanes,
    /// Its root, by which cores are scaled: what they take goes with their square.
    root: Lanes,
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
    /// Per block, what each element does against a change of its volume; empty where nothing does.
    pub(super) normals: Vec<[Lanes; 9]>,
    /// The element in each lane of each block; `u32::MAX` where there is none.
    pub(super) elements: Vec<[u32; LANES]>,
    stiffness: Stiffness,
    arch: Arch,
}

/// What all elements have in common, in units of the stiffness of a linear mode.
struct Stiffness {
    /// Stiffness of every mode without the core.
    modes: [f32; 8],
    /// Weights of the squares that a core takes for the modes that change sign along two axes and along three.
    hourglass: [f32; 2],
}

/// An element's linear form: element, weights of its corners, stiffness.
pub(crate) type ElementForm = (u32, [f64; 8], f64);

impl FineOperator {
    /// The operator in units of the linear modes' stiffness `unit`, for a grid of equal cubes. Elements of one `sample` see rotations
    /// in their linear modes only.
    pub(super) fn new(
        grid: &Grid,
        layout: &Layout,
        forms: &[ElementForm],
        unit: f64,
        samples: usize,
    ) -> Self {
        let modes = stiffness(&grid.size(0));
        let linear = modes[LINEAR[0]];
        let mut operator = Self {
            starts: layout.starts.clone(),
            doubled: layout.doubled.clone(),
            parallel: layout.parallel(),
            slabs: Vec::new(),
            blocks: Vec::new(),
            normals: Vec::new(),
            elements: Vec::new(),
            stiffness: Stiffness {
                modes: modes.map(|m| (m / linear) as f32),
                hourglass: if samples == 1 {
                    [0.0; 2]
                } else {
                    MEAN_SQUARES.map(|m| m as f32)
                },
            },
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
                    root: [0.0; LANES],
                    cores: [[0.0; LANES]; CORE],
                });
                self.elements.push([u32::MAX; LANES]);
                0
            });
            let block = self.blocks.len() - 1;
            let stiffness = grid.stiffness[element as usize];
            self.blocks[block].weight[lane as usize] = stiffness as f32;
            self.blocks[block].root[lane as usize] = stiffness.sqrt() as f32;
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
                        let root = block.root[lane];
                        for (entry, value) in block.cores.iter_mut().zip(core) {
                            entry[lane] = root * *value;
                        }
                    }
                }
            });
    }

    fn normals_of(&self, slab: &Slab) -> &[[Lanes; 9]] {
        self.normals.get(slab.blocks.clone()).unwrap_or_default()
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
            let blocks = &self.blocks[slab.blocks.clone()];
            let (normals, stiffness) = (self.normals_of(slab), &self.stiffness);
            match normals.is_empty() {
                true => self.arch.dispatch(Product::<false> {
                    slab,
                    blocks,
                    normals,
                    stiffness,
                    x,
                    y: part,
                }),
                false => self.arch.dispatch(Product::<true> {
                    slab,
                    blocks,
                    normals,
                    stiffness,
                    x,
                    y: part,
                }),
            }
        });
    }

    /// Adds the 3x3 diagonal blocks of all nodes to `out`, laid out like a vector but with six components.
    pub(super) fn add_diagonal(&self, out: &mut [f32]) {
        over_slabs(&self.doubled, out, self.parallel, |slab, part| {
            let slab = &self.slabs[slab];
            self.arch.dispatch(Diagonal {
                slab,
                blocks: &self.blocks[slab.blocks.clone()],
                normals: self.normals_of(slab),
                stiffness: &self.stiffness,
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

/// `y += A x` over the blocks and forms of a slab, whose elements may `KEEP` their volume.
struct Product<'a, const KEEP: bool> {
    slab: &'a Slab,
    blocks: &'a [Block],
    normals: &'a [[Lanes; 9]],
    stiffness: &'a Stiffness,
    x: &'a [f32],
    y: &'a mut [f32],
}

impl<const KEEP: bool> WithSimd for Product<'_, KEEP> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let step = self.slab.step;
        let zero = simd.splat_f32s(0.0);
        let mut stiffness = [zero; 8];
        for (out, value) in stiffness.iter_mut().zip(&self.stiffness.modes) {
            *out = simd.splat_f32s(*value);
        }
        for (b, block) in self.blocks.iter().enumerate() {
            for shift in (0..LANES).step_by(S::F32_LANES) {
                let mut a = [[zero; 8]; 3];
                for (i, a) in a.iter_mut().enumerate() {
                    for (n, a) in a.iter_mut().enumerate() {
                        *a = load::<S>(self.x, corner(block, step, i, 3, n) + shift);
                    }
                    to_modes(simd, a);
                }
                let hourglass = self.stiffness.hourglass;
                let coefficients = core_coefficients(simd, block, shift, hourglass, &a);
                let change = match KEEP {
                    true => volume_change(simd, &self.normals[b], shift, &a),
                    false => zero,
                };
                let weight = load::<S>(&block.weight, shift);
                for (i, a) in a.iter_mut().enumerate() {
                    let force = core_force(simd, block, shift, i, &coefficients);
                    a[0] = zero;
                    for mode in 1..8 {
                        let scale = simd.mul_f32s(weight, stiffness[mode]);
                        a[mode] = simd.mul_add_e_f32s(a[mode], scale, force[mode]);
                    }
                    if KEEP {
                        add_pressure(simd, &self.normals[b], shift, i, change, a);
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

/// For every core, minus the seven weighted coefficients of the polynomial `m : g`: its constant, its slopes along the three axes, and
/// the factors of the products of the two other coordinates. Zero where a lane holds no element.
#[inline(always)]
fn core_coefficients<S: Simd>(
    simd: S,
    block: &Block,
    shift: usize,
    hourglass: [f32; 2],
    a: &[[S::f32s; 8]; 3],
) -> [[S::f32s; 7]; 3] {
    let zero = simd.splat_f32s(0.0);
    let slope = simd.splat_f32s(-hourglass[0]);
    let product = simd.splat_f32s(-hourglass[1]);
    let mut out = [[zero; 7]; 3];
    for (out, core) in out.iter_mut().zip(block.cores.as_chunks::<9>().0) {
        let (mut constant, mut linear, mut bilinear) = (zero, [zero; 3], [zero; 3]);
        for (a, m) in a.iter().zip(core.as_chunks::<3>().0) {
            for axis in 0..3 {
                let m = load::<S>(&m[axis], shift);
                constant = simd.mul_add_e_f32s(m, a[LINEAR[axis]], constant);
                let (next, last) = ((axis + 1) % 3, (axis + 2) % 3);
                linear[next] = simd.mul_add_e_f32s(m, a[BILINEAR[last]], linear[next]);
                linear[last] = simd.mul_add_e_f32s(m, a[BILINEAR[next]], linear[last]);
                bilinear[axis] = simd.mul_add_e_f32s(m, a[TRILINEAR], bilinear[axis]);
            }
        }
        out[0] = simd.neg_f32s(constant);
        for axis in 0..3 {
            out[1 + axis] = simd.mul_f32s(linear[axis], slope);
            out[4 + axis] = simd.mul_f32s(bilinear[axis], product);
        }
    }
    out
}

/// What the cores add to the force of every mode of component `i`: the derivative of the mean of `-sum_k (m_k : g)^2 / 2`. One
/// component after another, so that the sums stay in registers.
#[inline(always)]
fn core_force<S: Simd>(
    simd: S,
    block: &Block,
    shift: usize,
    i: usize,
    coefficients: &[[S::f32s; 7]; 3],
) -> [S::f32s; 8] {
    let mut force = [simd.splat_f32s(0.0); 8];
    for (core, c) in block.cores.as_chunks::<9>().0.iter().zip(coefficients) {
        for axis in 0..3 {
            let m = load::<S>(&core[3 * i + axis], shift);
            let (next, last) = ((axis + 1) % 3, (axis + 2) % 3);
            for (mode, c) in [
                (LINEAR[axis], c[0]),
                (BILINEAR[last], c[1 + next]),
                (BILINEAR[next], c[1 + last]),
                (TRILINEAR, c[4 + axis]),
            ] {
                force[mode] = simd.mul_add_e_f32s(m, c, force[mode]);
            }
        }
    }
    force
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
    normals: &'a [[Lanes; 9]],
    stiffness: &'a Stiffness,
    out: &'a mut [f32],
}

/// What the cores of a block take from the diagonal blocks of its elements' corners, a sum of seven squares per core: one matrix for all
/// corners, and by the axes those whose sign at a corner is that of the bilinear mode which is constant along the axis.
///
/// With `m_j` the columns of a core, the constant of `m : g` is there `sum_j s_j m_j`, its slope along l `sum_(j != l) s_j s_l m_j`, and the
/// factor of the product of the coordinates other than j is `s_x s_y s_z m_j`. So the squares add up to multiples of `m_j m_j^T` and of
/// `s_j s_k (m_j m_k^T + m_k m_j^T)`.
#[inline(always)]
fn taken_from_diagonals<S: Simd>(
    simd: S,
    block: &Block,
    shift: usize,
    [slope, product]: [f32; 2],
) -> ([S::f32s; 6], [[S::f32s; 6]; 3]) {
    let zero = simd.splat_f32s(0.0);
    let (mut even, mut mixed) = ([zero; 6], [[zero; 6]; 3]);
    for core in block.cores.as_chunks::<9>().0 {
        let mut m = [zero; 9];
        for (m, entry) in m.iter_mut().zip(core) {
            *m = load::<S>(entry, shift);
        }
        for (entry, (row, column)) in SYMMETRIC.into_iter().enumerate() {
            let (left, right) = (&m[3 * row..3 * row + 3], &m[3 * column..3 * column + 3]);
            for (axis, mixed) in mixed.iter_mut().enumerate() {
                let (j, k) = ((axis + 1) % 3, (axis + 2) % 3);
                even[entry] = simd.mul_add_e_f32s(left[axis], right[axis], even[entry]);
                let sum = simd.mul_add_e_f32s(left[j], right[k], mixed[entry]);
                mixed[entry] = simd.mul_add_e_f32s(left[k], right[j], sum);
            }
        }
    }
    let even_times = simd.splat_f32s(1.0 + 2.0 * slope + product);
    let mixed_times = simd.splat_f32s(1.0 + slope);
    for x in &mut even {
        *x = simd.mul_f32s(*x, even_times);
    }
    for x in mixed.as_flattened_mut() {
        *x = simd.mul_f32s(*x, mixed_times);
    }
    (even, mixed)
}

/// Places of the six entries of a symmetric matrix.
pub(super) const SYMMETRIC: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];

impl WithSimd for Diagonal<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let step = self.slab.step;
        let constant: f32 = self.stiffness.modes[1..].iter().sum();
        let positive: [[bool; 3]; 8] =
            std::array::from_fn(|n| BILINEAR.map(|mode| sign(mode, n) > 0.0));
        let zero = simd.splat_f32s(0.0);
        for block in self.blocks {
            for shift in (0..LANES).step_by(S::F32_LANES) {
                let weight = load::<S>(&block.weight, shift);
                let stiff = simd.mul_f32s(weight, simd.splat_f32s(constant));
                let (even, mixed) =
                    taken_from_diagonals(simd, block, shift, self.stiffness.hourglass);
                for n in 0..8 {
                    let mut d = [stiff, zero, zero, stiff, zero, stiff];
                    for (c, d) in d.iter_mut().enumerate() {
                        *d = simd.sub_f32s(*d, even[c]);
                        for (mixed, positive) in mixed.iter().zip(positive[n]) {
                            *d = if positive {
                                simd.sub_f32s(*d, mixed[c])
                            } else {
                                simd.add_f32s(*d, mixed[c])
                            };
                        }
                        add_to(simd, self.out, corner(block, step, c, 6, n) + shift, *d);
                    }
                }
            }
        }
        for (block, normal) in self.blocks.iter().zip(self.normals) {
            for shift in (0..LANES).step_by(S::F32_LANES) {
                for n in 0..8 {
                    let d = volume_diagonal(simd, normal, shift, n);
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
