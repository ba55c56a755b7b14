//! Symmetric 24x24 matrices of coarse elements and the Galerkin products that make them.

use super::fine::CORE;
use super::modes::{BILINEAR, LINEAR, TRILINEAR, sign, stiffness};
use nalgebra::Vector3;
use std::collections::HashMap;

/// The blocks (x,x), (x,y), (x,z), (y,y), (y,z), (z,z) of an element's matrix, each 8x8 over the corners; the other three are
/// their transposes.
pub(super) type ElementMatrix = [[[f32; 8]; 8]; 6];

/// Axes of the six blocks.
pub(super) const BLOCKS: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];

/// Share of their stiffness that an element's hourglass modes have on the corners of its parent, where they are too small to be worth
/// their part of the core: rotations soften them to between a quarter and all of it.
const HOURGLASS: f64 = 0.75;

pub(super) const ZERO: ElementMatrix = [[[0.0; 8]; 8]; 6];

/// Weights of a coarse element's corners (columns) at the corners of an element inside it (rows), rows of held corners left out.
#[inline(always)]
fn interpolation(interval: &[[f64; 2]; 3], held: u8) -> [[f64; 8]; 8] {
    let mut weights = [[1.0; 8]; 8];
    for (n, row) in weights.iter_mut().enumerate() {
        if held >> n & 1 == 1 {
            *row = [0.0; 8];
        }
        for axis in 0..3 {
            let bit = LINEAR[axis];
            let share = interval[axis][usize::from(n & bit != 0)];
            for (c, weight) in row.iter_mut().enumerate() {
                *weight *= if c & bit != 0 { share } else { 1.0 - share };
            }
        }
    }
    weights
}

/// Turns the core of an element into its matrix on the corners of the coarse element that holds it.
pub(super) struct CoreTable {
    /// Per axis and corner: what the corner adds to the coefficient of a linear mode.
    gradient: [[f32; 8]; 3],
    /// The matrix of an element without a core, equal for the three components.
    constant: [[f32; 8]; 8],
}

impl CoreTable {
    /// For an element of the given size that fills `interval` of its parent, in units in which the stiffness of a mode is
    /// `scale * stiffness(size)`; a core's product with a mode coefficient is scaled by `4 h`, so cores need no sizes.
    pub(super) fn new(size: &Vector3<f64>, interval: &[[f64; 2]; 3], held: u8, scale: f64) -> Self {
        let weights = interpolation(interval, held);
        let mut stiffness = stiffness(size);
        for mode in BILINEAR.into_iter().chain([TRILINEAR]) {
            stiffness[mode] *= HOURGLASS;
        }
        let modes: [[f64; 8]; 8] = std::array::from_fn(|mode| {
            std::array::from_fn(|c| (0..8).map(|n| sign(mode, n) * weights[n][c]).sum())
        });
        Self {
            gradient: LINEAR.map(|mode| {
                let root = (scale * stiffness[mode]).sqrt();
                std::array::from_fn(|c| (modes[mode][c] * root) as f32)
            }),
            constant: std::array::from_fn(|c| {
                std::array::from_fn(|d| {
                    let sum: f64 = (1..8)
                        .map(|m| stiffness[m] * modes[m][c] * modes[m][d])
                        .sum();
                    (scale * sum) as f32
                })
            }),
        }
    }
}

/// Most children that a coarse element has: three along each axis.
const CHILDREN: usize = 27;

/// Sums the matrices of elements given by their cores.
///
/// A core takes `sum_k q_k q_k^T` from the constant matrix with three vectors over corners and components. They are collected
/// first and multiplied together in the end, so that no entry of the matrix is read and written more than once.
pub(super) struct CoreSum {
    constant: [[f32; 8]; 8],
    /// Per vector and component.
    vectors: [[[f32; 8]; 3]; 3 * CHILDREN],
    count: usize,
}

impl CoreSum {
    pub(super) fn new() -> Self {
        Self {
            constant: [[0.0; 8]; 8],
            vectors: [[[0.0; 8]; 3]; 3 * CHILDREN],
            count: 0,
        }
    }

    pub(super) fn clear(&mut self) {
        self.constant = [[0.0; 8]; 8];
        self.count = 0;
    }

    /// Adds the matrix of an element with this core, times `weight`.
    #[inline(always)]
    pub(super) fn add(&mut self, table: &CoreTable, core: &[f32; CORE], weight: f32) {
        for (sum, row) in self.constant.iter_mut().zip(&table.constant) {
            for (sum, entry) in sum.iter_mut().zip(row) {
                *sum += weight * entry;
            }
        }
        let root = weight.sqrt();
        for form in core.as_chunks::<9>().0 {
            self.take(table, form, root);
        }
    }

    /// Takes the square of a form of an element's mean gradient, times `root`, from the matrix.
    #[inline(always)]
    pub(super) fn take(&mut self, table: &CoreTable, form: &[f32; 9], root: f32) {
        let [g0, g1, g2] = &table.gradient;
        let vector = &mut self.vectors[self.count];
        for (vector, m) in vector.iter_mut().zip(form.as_chunks::<3>().0) {
            let m = [m[0] * root, m[1] * root, m[2] * root];
            for c in 0..8 {
                vector[c] = m[0] * g0[c] + m[1] * g1[c] + m[2] * g2[c];
            }
        }
        self.count += 1;
    }

    /// Sets the matrix to the sum.
    #[inline(always)]
    pub(super) fn write(&self, out: &mut ElementMatrix) {
        for (block, (i, j)) in out.iter_mut().zip(BLOCKS) {
            let mut sum = if i == j { self.constant } else { [[0.0; 8]; 8] };
            for vector in &self.vectors[..self.count] {
                let (left, right) = (&vector[i], &vector[j]);
                for c in 0..8 {
                    let factor = left[c];
                    for d in 0..8 {
                        sum[c][d] -= factor * right[d];
                    }
                }
            }
            *block = sum;
        }
    }
}

/// Takes one matrix from another.
#[inline(always)]
pub(super) fn subtract(taken: &ElementMatrix, out: &mut ElementMatrix) {
    let taken = taken.as_flattened().as_flattened();
    let out = out.as_flattened_mut().as_flattened_mut();
    out.iter_mut().zip(taken).for_each(|(out, x)| *out -= x);
}

/// Core tables, one for every size, place in the parent, and set of held corners that occurs.
#[derive(Default)]
pub(super) struct CoreTables {
    pub(super) tables: Vec<CoreTable>,
    known: HashMap<([u64; 9], u8), u32>,
}

impl CoreTables {
    /// The number of the table for an element.
    pub(super) fn number(
        &mut self,
        size: &Vector3<f64>,
        interval: &[[f64; 2]; 3],
        held: u8,
        scale: f64,
    ) -> u32 {
        let mut key = [0u64; 9];
        // Lattice coordinates carry roundoff; what differs by no more than that is the same.
        let round = |x: f64| (x as f32).to_bits() as u64;
        for a in 0..3 {
            key[a] = round(size[a]);
            key[3 + 2 * a] = round(interval[a][0]);
            key[4 + 2 * a] = round(interval[a][1]);
        }
        *self.known.entry((key, held)).or_insert_with(|| {
            self.tables
                .push(CoreTable::new(size, interval, held, scale));
            self.tables.len() as u32 - 1
        })
    }
}

/// Adds `P^T A P` for the matrix of an element that fills `interval` of its parent; rows of held corners are left out.
#[inline(always)]
pub(super) fn add_galerkin(
    fine: &ElementMatrix,
    interval: &[[f64; 2]; 3],
    held: u8,
    out: &mut ElementMatrix,
) {
    // Eight times as many products as axis by axis, but all of them on whole rows.
    let p = interpolation(interval, held).map(|row| row.map(|weight| weight as f32));
    let transposed: [[f32; 8]; 8] = std::array::from_fn(|c| std::array::from_fn(|n| p[n][c]));
    for (fine, out) in fine.iter().zip(out) {
        let mut half = [[0.0; 8]; 8];
        for (half, weights) in half.iter_mut().zip(&transposed) {
            *half = combined(weights, fine, [0.0; 8]);
        }
        for (out, half) in out.iter_mut().zip(&half) {
            *out = combined(half, &p, *out);
        }
    }
}

/// Rows times weights, and more. One row of the result at a time stays in a register.
#[inline(always)]
fn combined(weights: &[f32; 8], rows: &[[f32; 8]; 8], mut sum: [f32; 8]) -> [f32; 8] {
    for (weight, row) in weights.iter().zip(rows) {
        for (sum, x) in sum.iter_mut().zip(row) {
            *sum += weight * x;
        }
    }
    sum
}

/// Adds `stiffness w w^T` for each component.
pub(super) fn add_form(weights: &[f64; 8], stiffness: f64, out: &mut ElementMatrix) {
    for block in [0, 3, 5] {
        for c in 0..8 {
            for d in 0..8 {
                out[block][c][d] += (stiffness * weights[c] * weights[d]) as f32;
            }
        }
    }
}

/// Weights of a form on the corners of the parent.
pub(super) fn parent_weights(weights: &[f64; 8], interval: &[[f64; 2]; 3], held: u8) -> [f64; 8] {
    let p = interpolation(interval, held);
    std::array::from_fn(|c| (0..8).map(|n| weights[n] * p[n][c]).sum())
}
