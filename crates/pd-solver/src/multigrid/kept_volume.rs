//! What the cycle knows of flesh that keeps its volume: one form per element.
//!
//! Where the volume is nearly kept, the Hessian of the distance from the nearest matrix of determinant 1 is next to `n n^T` with `n` along the
//! cofactors of the mean F of the element: what does not change the volume is free. (The rest is of the size of the pressure.)

use super::fine::{FineOperator, SYMMETRIC};
use super::layout::{LANES, Lanes, load};
use super::modes::{LINEAR, sign};
use nalgebra::{Matrix3, Vector3};
use pulp::Simd;
use rayon::prelude::*;

/// `n` row by row, times the root of the stiffness over that of elasticity.
pub(super) type Normal = [f32; 9];

/// Elements per task.
const TASK: usize = 256;

/// The forms of all elements of the level that the cycle was last built on.
pub(super) struct KeptVolume {
    /// Root of the stiffness over that of elasticity.
    root: f64,
    pub(super) normals: Vec<Normal>,
}

impl KeptVolume {
    /// None where there is no such stiffness.
    pub(super) fn new(stiffness: f64, elastic: f64, elements: usize) -> Option<Self> {
        (stiffness > 0.0).then(|| Self {
            root: (stiffness / elastic).sqrt(),
            normals: vec![[0.0; 9]; elements],
        })
    }

    /// Sets the forms of some elements at the positions `u`; `inverse_sizes` are reciprocals of their edge lengths.
    pub(super) fn set(
        &mut self,
        elements: &[[u32; 8]],
        inverse_sizes: &[Vector3<f64>],
        u: &[Vector3<f64>],
    ) {
        let root = self.root;
        let elements = elements.par_iter().zip(inverse_sizes);
        self.normals
            .par_iter_mut()
            .zip(elements)
            .with_min_len(TASK)
            .for_each(|(out, (nodes, inverse))| {
                let normal = cofactors(&mean_gradient(nodes, inverse, u));
                let scale = root / normal.norm().max(f64::MIN_POSITIVE);
                *out = std::array::from_fn(|k| (normal[(k / 3, k % 3)] * scale) as f32);
            });
    }
}

/// F at the centre of an element: differences between the mean corners of opposite faces.
fn mean_gradient(nodes: &[u32; 8], inverse: &Vector3<f64>, u: &[Vector3<f64>]) -> Matrix3<f64> {
    let columns = LINEAR.map(|bit| {
        let signed = |(n, &node): (usize, &u32)| match n & bit {
            0 => -u[node as usize],
            _ => u[node as usize],
        };
        nodes.iter().enumerate().map(signed).sum::<Vector3<f64>>() * 0.25
    });
    Matrix3::from_columns(&[
        columns[0] * inverse[0],
        columns[1] * inverse[1],
        columns[2] * inverse[2],
    ])
}

/// The derivative of the determinant.
fn cofactors(f: &Matrix3<f64>) -> Matrix3<f64> {
    let (a, b, c) = (f.column(0), f.column(1), f.column(2));
    Matrix3::from_columns(&[b.cross(&c), c.cross(&a), a.cross(&b)])
}

impl FineOperator {
    /// Takes over the forms of all elements.
    pub(super) fn set_normals(&mut self, normals: &[Normal]) {
        let elements = &self.elements;
        self.normals.resize(elements.len(), [[0.0; LANES]; 9]);
        let of_block = |(out, elements): (&mut [Lanes; 9], &[u32; LANES])| {
            for (lane, &element) in elements.iter().enumerate() {
                if let Some(normal) = normals.get(element as usize) {
                    for (entry, value) in out.iter_mut().zip(normal) {
                        entry[lane] = *value;
                    }
                }
            }
        };
        let blocks = self.normals.par_iter_mut().zip(elements);
        blocks.with_min_len(16).for_each(of_block);
    }
}

// As in `fine`, there are no closures over lanes.

/// The values of the forms for the mode coefficients `a`.
#[inline(always)]
pub(super) fn volume_change<S: Simd>(
    simd: S,
    normal: &[Lanes; 9],
    shift: usize,
    a: &[[S::f32s; 8]; 3],
) -> S::f32s {
    let mut value = simd.splat_f32s(0.0);
    for (a, normal) in a.iter().zip(normal.as_chunks::<3>().0) {
        for axis in 0..3 {
            value = simd.mul_add_e_f32s(load::<S>(&normal[axis], shift), a[LINEAR[axis]], value);
        }
    }
    value
}

/// Adds what half the squares of the forms give for these values to the forces on the modes of component `i`.
#[inline(always)]
pub(super) fn add_pressure<S: Simd>(
    simd: S,
    normal: &[Lanes; 9],
    shift: usize,
    i: usize,
    change: S::f32s,
    force: &mut [S::f32s; 8],
) {
    for axis in 0..3 {
        let n = load::<S>(&normal[3 * i + axis], shift);
        force[LINEAR[axis]] = simd.mul_add_e_f32s(n, change, force[LINEAR[axis]]);
    }
}

/// What a form against changes of volume adds to the six components of the diagonal block at corner `n`.
#[inline(always)]
pub(super) fn volume_diagonal<S: Simd>(
    simd: S,
    normal: &[Lanes; 9],
    shift: usize,
    n: usize,
) -> [S::f32s; 6] {
    let zero = simd.splat_f32s(0.0);
    let mut q = [zero; 3];
    for (i, q) in q.iter_mut().enumerate() {
        for axis in 0..3 {
            let sign = simd.splat_f32s(sign(LINEAR[axis], n) as f32);
            *q = simd.mul_add_e_f32s(load::<S>(&normal[3 * i + axis], shift), sign, *q);
        }
    }
    let mut d = [zero; 6];
    for (d, (i, j)) in d.iter_mut().zip(SYMMETRIC) {
        *d = simd.mul_f32s(q[i], q[j]);
    }
    d
}
