//! The innermost loops of elasticity: one element, its samples side by side in SIMD lanes.
//!
//! Samples come in groups of eight. A group that is not full is filled with copies of its first sample whose weight is zero, so
//! that every lane holds ordinary numbers and no loop has a remainder.

use super::elasticity::Corners;
use nalgebra::{Matrix3, Vector3};
use polar_grad::HessianCore;
use polar_grad::lanes::{LaneMatrix, polar_rotation_lanes, product, rotation_tangent_lanes};
use pulp::Simd;

/// Samples in a group.
pub(super) const GROUP: usize = 8;

/// One number per sample of a group.
pub(super) type Lanes = [f64; GROUP];

/// Places of the six entries of a symmetric matrix in its nine, row by row.
const SYMMETRIC: [usize; 9] = [0, 1, 2, 1, 3, 4, 2, 4, 5];

/// What all elements share of one group of samples.
pub(super) struct SampleGroup {
    /// d w_n / d x_j for the eight corners.
    gradients: [[Lanes; 3]; 8],
    /// Stiffness times volume share.
    weights: Lanes,
}

impl SampleGroup {
    /// The groups for gradients and weights of all samples.
    pub(super) fn all(gradients: &[Corners], weights: &[f64]) -> Vec<Self> {
        let group = |(g, w): (&[Corners], &[f64])| Self {
            gradients: std::array::from_fn(|n| std::array::from_fn(|j| lanes(g, |g| g[n][j]))),
            weights: std::array::from_fn(|i| w.get(i).copied().unwrap_or(0.0)),
        };
        gradients
            .chunks(GROUP)
            .zip(weights.chunks(GROUP))
            .map(group)
            .collect()
    }
}

/// One number of each sample, filled up with the first.
fn lanes<T>(samples: &[T], entry: impl Fn(&T) -> f64) -> Lanes {
    std::array::from_fn(|i| entry(samples.get(i).unwrap_or(&samples[0])))
}

/// The actuation of a group: six entries of A.
#[derive(Clone, Copy)]
pub(super) struct Actuation(pub(super) [Lanes; 6]);

impl Actuation {
    /// From the entries b of up to eight samples, A = I + sym(b).
    pub(super) fn new(b: &[[f64; 6]]) -> Self {
        const IDENTITY: [f64; 6] = [1.0, 0.0, 0.0, 1.0, 0.0, 1.0];
        Self(std::array::from_fn(|k| lanes(b, |b| IDENTITY[k] + b[k])))
    }

    /// A of one sample.
    pub(super) fn matrix(&self, sample: usize) -> Matrix3<f64> {
        Matrix3::from_fn(|i, j| self.0[SYMMETRIC[3 * i + j]][sample])
    }
}

/// What a Hessian product needs of a group: rotations, and the six entries of B that make their tangents.
#[derive(Clone, Copy)]
pub(super) struct Linearisation {
    rotation: [Lanes; 9],
    factor: [Lanes; 6],
}

impl Linearisation {
    /// What memory holds before the first linearisation.
    pub(super) fn unset() -> Self {
        Self {
            rotation: [[0.0; GROUP]; 9],
            factor: [[0.0; GROUP]; 6],
        }
    }

    pub(super) fn new(cores: &[HessianCore]) -> Self {
        const PLACES: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
        Self {
            rotation: std::array::from_fn(|k| {
                lanes(cores, |c| c.gradient.rotation[(k / 3, k % 3)])
            }),
            factor: PLACES.map(|place| lanes(cores, |c| c.gradient.factor[place])),
        }
    }
}

/// The part of eight lanes that fits one register, part number `part`.
#[inline(always)]
fn load<S: Simd>(lanes: &Lanes, part: usize) -> S::f64s {
    S::as_simd_f64s(lanes).0[part]
}

#[inline(always)]
fn load_matrix<S: Simd>(symmetric: &[Lanes; 6], part: usize) -> LaneMatrix<S> {
    SYMMETRIC.map(|k| load::<S>(&symmetric[k], part))
}

/// Registers per group.
#[inline(always)]
pub(super) const fn parts<S: Simd>() -> usize {
    GROUP / S::F64_LANES
}

/// F = sum_n x_n (dw_n/dx)^T at the samples of one register.
#[inline(always)]
fn gradient<S: Simd>(simd: S, group: &SampleGroup, part: usize, x: &Corners) -> LaneMatrix<S> {
    let mut f = [simd.splat_f64s(0.0); 9];
    for (g, x) in group.gradients.iter().zip(x) {
        let g = [
            load::<S>(&g[0], part),
            load::<S>(&g[1], part),
            load::<S>(&g[2], part),
        ];
        for i in 0..3 {
            let x = simd.splat_f64s(x[i]);
            for j in 0..3 {
                f[3 * i + j] = simd.mul_add_e_f64s(x, g[j], f[3 * i + j]);
            }
        }
    }
    f
}

/// Adds the sum over the samples of `P g_n`, weights in P, to the forces.
#[inline(always)]
fn scatter<S: Simd>(
    simd: S,
    group: &SampleGroup,
    part: usize,
    p: &LaneMatrix<S>,
    force: &mut Corners,
) {
    for (g, force) in group.gradients.iter().zip(force) {
        let g = [
            load::<S>(&g[0], part),
            load::<S>(&g[1], part),
            load::<S>(&g[2], part),
        ];
        for i in 0..3 {
            let first = simd.mul_f64s(p[3 * i], g[0]);
            let second = simd.mul_add_e_f64s(p[3 * i + 1], g[1], first);
            let all = simd.mul_add_e_f64s(p[3 * i + 2], g[2], second);
            force[i] += simd.reduce_sum_f64s(all);
        }
    }
}

/// Adds the forces of one group and returns its energy: `sum w / 2 |F - R A|^2` with R the polar rotation of F A.
#[inline(always)]
pub(super) fn energy_gradient<S: Simd>(
    simd: S,
    group: &SampleGroup,
    actuation: &Actuation,
    x: &Corners,
    force: &mut Corners,
) -> f64 {
    let mut energy = 0.0;
    for part in 0..parts::<S>() {
        let a = load_matrix::<S>(&actuation.0, part);
        let w = load::<S>(&group.weights, part);
        let f = gradient(simd, group, part, x);
        let rotation = polar_rotation_lanes(simd, &product(simd, &f, &a));
        let target = product(simd, &rotation, &a);
        let mut p = f;
        let mut square = simd.splat_f64s(0.0);
        for (p, target) in p.iter_mut().zip(&target) {
            let misfit = simd.sub_f64s(*p, *target);
            square = simd.mul_add_e_f64s(misfit, misfit, square);
            *p = simd.mul_f64s(misfit, w);
        }
        energy += 0.5 * simd.reduce_sum_f64s(simd.mul_f64s(square, w));
        scatter(simd, group, part, &p, force);
    }
    energy
}

/// Adds the product of one group's Hessian with `x`: `sum w (dF - dR A) g_n`.
#[inline(always)]
pub(super) fn hessian_product<S: Simd>(
    simd: S,
    group: &SampleGroup,
    actuation: &Actuation,
    at: &Linearisation,
    x: &Corners,
    force: &mut Corners,
) {
    for part in 0..parts::<S>() {
        let a = load_matrix::<S>(&actuation.0, part);
        let w = load::<S>(&group.weights, part);
        let rotation = at.rotation.each_ref().map(|r| load::<S>(r, part));
        let factor = at.factor.each_ref().map(|b| load::<S>(b, part));
        let d_f = gradient(simd, group, part, x);
        let d_m = product(simd, &d_f, &a);
        let d_r = rotation_tangent_lanes(simd, &rotation, &factor, &d_m);
        let d_target = product(simd, &d_r, &a);
        let mut p = d_f;
        for (p, target) in p.iter_mut().zip(&d_target) {
            *p = simd.mul_f64s(simd.sub_f64s(*p, *target), w);
        }
        scatter(simd, group, part, &p, force);
    }
}

/// F = sum_n x_n (dw_n/dx)^T, the deformation gradient when `x` holds positions.
pub(super) fn deformation_gradient(x: &Corners, g: &Corners) -> Matrix3<f64> {
    let mut f = Matrix3::zeros();
    for (x, g) in x.iter().zip(g) {
        f.ger(1.0, x, g, 1.0);
    }
    f
}

/// All-zero forces.
pub(super) fn no_forces() -> Corners {
    [Vector3::zeros(); 8]
}
