//! Deformation gradients at all samples of an element, and the forces of all stresses, by sum factorisation of the tensor rule.
//!
//! The derivative along an axis of a trilinear function is the difference of two opposite faces, bilinear in the other two axes:
//! it has `n^2` values at the `n^3` samples, and each is found by interpolating four edges along one axis after the other.

use super::block::{CornerLanes, Lanes};
use hex_mesh::{Quadrature, QuadratureRule};
use polar_grad::lanes::LaneMatrix;
use pulp::Simd;

/// `N` Gauss points along each axis.
pub(super) struct TensorRule<const N: usize> {
    /// Points along an axis, in `[0, 1]`.
    points: [f64; N],
    /// Weights along an axis, of sum 1.
    weights: [f64; N],
}

/// Derivatives of one component at all samples: `[axis][p][q]`, where p and q number the points along the other two axes in
/// rising order.
type ComponentGradients<S, const N: usize> = [[[<S as Simd>::f64s; N]; N]; 3];

/// Derivatives of three components at all samples, or the stresses summed along the axis that each derivative does not depend on.
pub(super) struct Gradients<S: Simd, const N: usize>([ComponentGradients<S, N>; 3]);

/// Corner `side` along `axis` of the edge at `[p][q]` of the other two axes.
const fn corner(axis: usize, side: usize, p: usize, q: usize) -> usize {
    match axis {
        0 => 4 * side + 2 * p + q,
        1 => 4 * p + 2 * side + q,
        _ => 4 * p + 2 * q + side,
    }
}

/// The points of a sample along the two axes other than `axis`.
#[inline(always)]
const fn others(axis: usize, sample: [usize; 3]) -> [usize; 2] {
    match axis {
        0 => [sample[1], sample[2]],
        1 => [sample[0], sample[2]],
        _ => [sample[0], sample[1]],
    }
}

impl<const N: usize> TensorRule<N> {
    /// Samples per element.
    pub(super) const SAMPLES: usize = N * N * N;

    /// The rule along the axes of a quadrature rule with N points each.
    ///
    /// # Panics
    /// When the rule has another number of points.
    pub(super) fn new(quadrature: Quadrature) -> Self {
        let rule = QuadratureRule::new(quadrature);
        assert_eq!(rule.len(), Self::SAMPLES, "samples of the rule");
        // The first points differ along z only. Weights along an axis sum to 1, so these sum to that of x and y.
        let shared: f64 = rule.weights[..N].iter().sum();
        Self {
            points: std::array::from_fn(|k| rule.points[k].z),
            weights: std::array::from_fn(|k| rule.weights[k] / shared),
        }
    }

    /// Weight of a sample, given by its points along x, y and z.
    #[inline(always)]
    pub(super) fn weight(&self, sample: [usize; 3]) -> f64 {
        self.weights[sample[0]] * self.weights[sample[1]] * self.weights[sample[2]]
    }

    /// Points along x, y and z of a sample, by its number: z fastest.
    #[inline(always)]
    pub(super) fn sample(number: usize) -> [usize; 3] {
        [number / (N * N), number / N % N, number % N]
    }

    /// `d x_i / d X_j` at all samples of the elements of one register, from the vectors at the corners.
    #[inline(always)]
    pub(super) fn gradients<S: Simd>(
        &self,
        simd: S,
        x: &CornerLanes,
        inverse_size: &[Lanes; 3],
        part: usize,
    ) -> Gradients<S, N> {
        let zero = simd.splat_f64s(0.0);
        let mut out = [[[[zero; N]; N]; 3]; 3];
        for axis in 0..3 {
            let inverse = inverse_size[axis].part::<S>(part);
            for i in 0..3 {
                let mut edges = [[zero; 2]; 2];
                for p in 0..2 {
                    for q in 0..2 {
                        let low = x[i][corner(axis, 0, p, q)].part::<S>(part);
                        let high = x[i][corner(axis, 1, p, q)].part::<S>(part);
                        edges[p][q] = simd.mul_f64s(simd.sub_f64s(high, low), inverse);
                    }
                }
                out[i][axis] = self.interpolate(simd, &edges);
            }
        }
        Gradients(out)
    }

    /// Adds to the corners the forces of stresses that were summed by [`Gradients::add`], times `scale`.
    #[inline(always)]
    pub(super) fn add_forces<S: Simd>(
        &self,
        simd: S,
        stresses: &Gradients<S, N>,
        inverse_size: &[Lanes; 3],
        scale: S::f64s,
        part: usize,
        force: &mut CornerLanes,
    ) {
        for axis in 0..3 {
            let scale = simd.mul_f64s(scale, inverse_size[axis].part::<S>(part));
            for (force, stresses) in force.iter_mut().zip(&stresses.0) {
                let edges = self.spread(simd, &stresses[axis]);
                for (p, edges) in edges.iter().enumerate() {
                    for (q, edge) in edges.iter().enumerate() {
                        let edge = simd.mul_f64s(*edge, scale);
                        let low = force[corner(axis, 0, p, q)].part_mut::<S>(part);
                        *low = simd.sub_f64s(*low, edge);
                        let high = force[corner(axis, 1, p, q)].part_mut::<S>(part);
                        *high = simd.add_f64s(*high, edge);
                    }
                }
            }
        }
    }

    /// From the edges of two axes to the points along them.
    #[inline(always)]
    fn interpolate<S: Simd>(&self, simd: S, edges: &[[S::f64s; 2]; 2]) -> [[S::f64s; N]; N] {
        let mut out = [[edges[0][0]; N]; N];
        let low_along_p = simd.sub_f64s(edges[1][0], edges[0][0]);
        let high_along_p = simd.sub_f64s(edges[1][1], edges[0][1]);
        for (out, t) in out.iter_mut().zip(&self.points) {
            let t = simd.splat_f64s(*t);
            let low = simd.mul_add_e_f64s(t, low_along_p, edges[0][0]);
            let high = simd.mul_add_e_f64s(t, high_along_p, edges[0][1]);
            let along_q = simd.sub_f64s(high, low);
            for (out, t) in out.iter_mut().zip(&self.points) {
                *out = simd.mul_add_e_f64s(simd.splat_f64s(*t), along_q, low);
            }
        }
        out
    }

    /// The transposed of [`TensorRule::interpolate`].
    #[inline(always)]
    fn spread<S: Simd>(&self, simd: S, points: &[[S::f64s; N]; N]) -> [[S::f64s; 2]; 2] {
        let zero = simd.splat_f64s(0.0);
        // Sums over the points, and over the points times their place: [along p][along q].
        let mut sums = [[zero; 2]; 2];
        for (row, t) in points.iter().zip(&self.points) {
            let mut along_q = [zero; 2];
            for (x, t) in row.iter().zip(&self.points) {
                along_q[0] = simd.add_f64s(along_q[0], *x);
                along_q[1] = simd.mul_add_e_f64s(simd.splat_f64s(*t), *x, along_q[1]);
            }
            let t = simd.splat_f64s(*t);
            for (k, along_q) in along_q.into_iter().enumerate() {
                sums[0][k] = simd.add_f64s(sums[0][k], along_q);
                sums[1][k] = simd.mul_add_e_f64s(t, along_q, sums[1][k]);
            }
        }
        let [[all, q], [p, both]] = sums;
        let low_p = simd.sub_f64s(all, p);
        let high_q = simd.sub_f64s(q, both);
        [
            [simd.sub_f64s(low_p, high_q), high_q],
            [simd.sub_f64s(p, both), both],
        ]
    }
}

impl<S: Simd, const N: usize> Gradients<S, N> {
    /// No stress at all.
    #[inline(always)]
    pub(super) fn zero(simd: S) -> Self {
        Self([[[[simd.splat_f64s(0.0); N]; N]; 3]; 3])
    }

    /// The matrix at a sample.
    #[inline(always)]
    pub(super) fn at(&self, sample: [usize; 3]) -> LaneMatrix<S> {
        let mut out = [self.0[0][0][0][0]; 9];
        for axis in 0..3 {
            let [p, q] = others(axis, sample);
            for i in 0..3 {
                out[3 * i + axis] = self.0[i][axis][p][q];
            }
        }
        out
    }

    /// Adds `weight` times the stress at a sample.
    #[inline(always)]
    pub(super) fn add(&mut self, simd: S, sample: [usize; 3], weight: f64, stress: &LaneMatrix<S>) {
        let weight = simd.splat_f64s(weight);
        for axis in 0..3 {
            let [p, q] = others(axis, sample);
            for i in 0..3 {
                let sum = &mut self.0[i][axis][p][q];
                *sum = simd.mul_add_e_f64s(weight, stress[3 * i + axis], *sum);
            }
        }
    }
}
