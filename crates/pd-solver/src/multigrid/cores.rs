//! One core per element: what the Hessian of the energy at the element's centre, true or exactly projected, takes from the constant
//! matrix.
//!
//! With F at the centre and the mean A of the samples, the core of maths.md is `I - sum_kl B_kl l_k l_l^T`, where
//! `l_k : dF` is the k-th entry of axial(R^T dF A). With a Cholesky factor `B = C C^T` that is `I - sum_k m_k m_k^T`, and
//! `m_k = sum_l C_lk l_l` are the three matrices of the core. Eight elements go side by side.

use super::fine::CORE;
use super::modes::LINEAR;
use nalgebra::Vector3;
use polar_grad::lanes::{
    LaneMatrix, polar_rotation_lanes, product, projected_factor_lanes, rotation_factor_lanes,
};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// Elements side by side.
const GROUP: usize = 8;

/// Pivots below this share of the trace are left out: directions without weight.
const FLOOR: f64 = 1e-14;

/// Six entries of a symmetric matrix: 11, 12, 13, 22, 23, 33.
pub(super) type Symmetric = [f64; 6];

type Lanes = [f64; GROUP];

/// Which Hessian the cores are those of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Curvature {
    /// The Hessian as it is. Where elements are pressed together, single cores are indefinite, and in a slender body that balances what
    /// others are pulled; the sum is definite at a minimum.
    True,
    /// Every core projected to a positive semi-definite one: definite everywhere, but too stiff wherever something is pressed together.
    Projected,
}

/// Computes the cores of up to eight elements.
struct Cores<'a> {
    curvature: Curvature,
    elements: &'a [[u32; 8]],
    u: &'a [Vector3<f64>],
    /// Reciprocals of the edge lengths.
    inverse_sizes: &'a [Vector3<f64>],
    /// Mean A of each element.
    actuation: &'a [Symmetric],
    out: &'a mut [[f32; CORE]],
}

/// The cores of all elements of a level, whose reciprocals of edge lengths and mean A are given.
pub(super) fn set_cores(
    curvature: Curvature,
    elements: &[[u32; 8]],
    u: &[Vector3<f64>],
    (inverse_sizes, actuation): (&[Vector3<f64>], &[Symmetric]),
    out: &mut [[f32; CORE]],
) {
    let arch = Arch::new();
    let of_elements = inverse_sizes
        .par_chunks(GROUP)
        .zip(actuation.par_chunks(GROUP));
    out.par_chunks_mut(GROUP)
        .zip(elements.par_chunks(GROUP))
        .zip(of_elements)
        .with_min_len(8)
        .for_each(|((out, elements), (inverse_sizes, actuation))| {
            arch.dispatch(Cores {
                curvature,
                elements,
                u,
                inverse_sizes,
                actuation,
                out,
            });
        });
}

impl WithSimd for Cores<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let mut f = [[0.0; GROUP]; 9];
        let mut a = [[0.0; GROUP]; 6];
        for lane in 0..GROUP {
            // Lanes beyond the last element repeat the first.
            let element = if lane < self.elements.len() { lane } else { 0 };
            self.gather(element, lane, &mut f);
            for (out, a) in a.iter_mut().zip(&self.actuation[element]) {
                out[lane] = *a;
            }
        }
        let mut cores = [[0.0; GROUP]; CORE];
        for part in 0..GROUP / S::F64_LANES {
            core(simd, self.curvature, &f, &a, part, &mut cores);
        }
        for (lane, out) in self.out.iter_mut().enumerate() {
            for (out, core) in out.iter_mut().zip(&cores) {
                *out = core[lane] as f32;
            }
        }
    }
}

impl Cores<'_> {
    /// F at the centre of an element: differences between the mean corners of opposite faces.
    #[inline(always)]
    fn gather(&self, element: usize, lane: usize, f: &mut [Lanes; 9]) {
        let mut sums = [Vector3::zeros(); 3];
        for (n, &node) in self.elements[element].iter().enumerate() {
            let x = &self.u[node as usize];
            for (sum, bit) in sums.iter_mut().zip(LINEAR) {
                if n & bit == 0 {
                    *sum -= x;
                } else {
                    *sum += x;
                }
            }
        }
        let inverse = &self.inverse_sizes[element];
        for (j, sum) in sums.iter().enumerate() {
            for i in 0..3 {
                f[3 * i + j][lane] = 0.25 * inverse[j] * sum[i];
            }
        }
    }
}

#[inline(always)]
fn load<S: Simd>(lanes: &Lanes, part: usize) -> S::f64s {
    S::as_simd_f64s(lanes).0[part]
}

/// The cores of the elements in one register.
#[inline(always)]
fn core<S: Simd>(
    simd: S,
    curvature: Curvature,
    f: &[Lanes; 9],
    a: &[Lanes; 6],
    part: usize,
    out: &mut [Lanes; CORE],
) {
    let zero = simd.splat_f64s(0.0);
    let mut deformation = [zero; 9];
    for (out, f) in deformation.iter_mut().zip(f) {
        *out = load::<S>(f, part);
    }
    let mut actuation = [zero; 6];
    for (out, a) in actuation.iter_mut().zip(a) {
        *out = load::<S>(a, part);
    }
    let full: LaneMatrix<S> = [
        actuation[0],
        actuation[1],
        actuation[2],
        actuation[1],
        actuation[3],
        actuation[4],
        actuation[2],
        actuation[4],
        actuation[5],
    ];
    let m = product(simd, &deformation, &full);
    let r = polar_rotation_lanes(simd, &m);
    let rotation = rotation_factor_lanes(simd, &r, &m);
    let b = match curvature {
        Curvature::True => rotation.factor,
        Curvature::Projected => projected_factor_lanes(simd, &rotation.pair_sums, &actuation),
    };
    let c = cholesky(simd, &b);
    // l_k(i, j) = R(i, k + 2) A(j, k + 1) - R(i, k + 1) A(j, k + 2), indices modulo 3.
    let mut forms = [[zero; 9]; 3];
    for (k, form) in forms.iter_mut().enumerate() {
        let (up, down) = ((k + 2) % 3, (k + 1) % 3);
        for i in 0..3 {
            for j in 0..3 {
                let second = simd.mul_f64s(r[3 * i + down], full[3 * j + up]);
                let first = simd.mul_f64s(r[3 * i + up], full[3 * j + down]);
                form[3 * i + j] = simd.sub_f64s(first, second);
            }
        }
    }
    for entry in 0..9 {
        let l = [forms[0][entry], forms[1][entry], forms[2][entry]];
        let first = simd.mul_f64s(c[0], l[0]);
        let first = simd.mul_add_e_f64s(c[1], l[1], first);
        let m = [
            simd.mul_add_e_f64s(c[2], l[2], first),
            simd.mul_add_e_f64s(c[4], l[2], simd.mul_f64s(c[3], l[1])),
            simd.mul_f64s(c[5], l[2]),
        ];
        for (k, m) in m.into_iter().enumerate() {
            S::as_mut_simd_f64s(&mut out[9 * k + entry]).0[part] = m;
        }
    }
}

/// Lower Cholesky factor of positive semi-definite matrices: entries 00, 10, 20, 11, 21, 22.
#[inline(always)]
fn cholesky<S: Simd>(simd: S, b: &[S::f64s; 6]) -> [S::f64s; 6] {
    let trace = simd.add_f64s(b[0], simd.add_f64s(b[3], b[5]));
    let floor = simd.mul_f64s(trace, simd.splat_f64s(FLOOR));
    let (c00, inverse) = pivot(simd, b[0], floor);
    let c10 = simd.mul_f64s(b[1], inverse);
    let c20 = simd.mul_f64s(b[2], inverse);
    let rest = simd.sub_f64s(b[3], simd.mul_f64s(c10, c10));
    let (c11, inverse) = pivot(simd, rest, floor);
    let c21 = simd.mul_f64s(simd.sub_f64s(b[4], simd.mul_f64s(c20, c10)), inverse);
    let squares = simd.mul_add_e_f64s(c20, c20, simd.mul_f64s(c21, c21));
    let (c22, _) = pivot(simd, simd.sub_f64s(b[5], squares), floor);
    [c00, c10, c20, c11, c21, c22]
}

/// Root of a pivot and its reciprocal, both zero where the pivot is nothing but roundoff.
#[inline(always)]
fn pivot<S: Simd>(simd: S, value: S::f64s, floor: S::f64s) -> (S::f64s, S::f64s) {
    let zero = simd.splat_f64s(0.0);
    let positive = simd.less_than_f64s(floor, value);
    let safe = simd.select_f64s(positive, value, simd.splat_f64s(1.0));
    let root = simd.sqrt_f64s(safe);
    let inverse = simd.div_f64s(simd.splat_f64s(1.0), root);
    (
        simd.select_f64s(positive, root, zero),
        simd.select_f64s(positive, inverse, zero),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vector::NodalVector;
    use nalgebra::{Matrix3, SMatrix};
    use polar_grad::{Filter, HessianCore, testing::Random};

    /// `I - sum_k m_k m_k^T` is the core of the scalar code, true or projected, for every number of elements in a group.
    #[test]
    fn cores_are_those_of_the_scalar_code() {
        let mut random = Random::new(7);
        for (count, curvature) in
            (1..=GROUP).flat_map(|n| [(n, Curvature::True), (n, Curvature::Projected)])
        {
            let u: NodalVector = (0..8 * count)
                .map(|_| random.matrix().column(0).into_owned())
                .collect();
            let elements: Vec<[u32; 8]> = (0..count as u32)
                .map(|e| std::array::from_fn(|n| 8 * e + n as u32))
                .collect();
            let inverse_sizes = vec![Vector3::new(1.0, 2.0, 0.5); count];
            let actuation: Vec<Symmetric> = (0..count)
                .map(|_| {
                    let m = random.matrix();
                    [
                        1.0 + 0.3 * m[0],
                        0.3 * m[1],
                        0.2 * m[2],
                        1.0,
                        0.1 * m[3],
                        1.0 - 0.2 * m[4],
                    ]
                })
                .collect();
            let mut out = vec![[0.0; CORE]; count];
            Arch::new().dispatch(Cores {
                curvature,
                elements: &elements,
                u: &u,
                inverse_sizes: &inverse_sizes,
                actuation: &actuation,
                out: &mut out,
            });
            for (e, core) in out.iter().enumerate() {
                let x = elements[e].map(|n| u[n as usize]);
                let f = Matrix3::from_fn(|i, j| {
                    let side = |n: usize| if n & LINEAR[j] == 0 { -1.0 } else { 1.0 };
                    let sum: f64 = (0..8).map(|n| side(n) * x[n][i]).sum();
                    0.25 * inverse_sizes[e][j] * sum
                });
                let a = actuation[e];
                let a = Matrix3::new(a[0], a[1], a[2], a[1], a[3], a[4], a[2], a[4], a[5]);
                let mut expected = HessianCore::new(&f, &a);
                if curvature == Curvature::Projected {
                    expected = expected.filtered(Filter::Projected);
                }
                let expected = expected.to_matrix();
                let m = SMatrix::<f64, 3, 9>::from_fn(|k, entry| core[9 * k + entry] as f64);
                let error =
                    (SMatrix::<f64, 9, 9>::identity() - m.transpose() * m - expected).norm();
                let size = expected.norm();
                assert!(error < 1e-5 * size, "{curvature:?} {count} {e} {error:e}");
            }
        }
    }
}
