//! The positive semi-definite projection of the Hessian core of every lane.

use super::algebra::{
    dot3, inverse_cholesky_factor, lower_congruence, minor, reciprocal, scaled, symmetric_adjugate,
    symmetric_inverse, symmetric_pair_sums, symmetric_square, times, upper_congruence,
};
use super::{SymmetricLanes, all, for_each_failed, set_symmetric, symmetric_of_lane};
use crate::hessian::{projected_factor, reach};
use crate::symmetric::SINGULAR;
use pulp::Simd;

/// Traces whose reciprocals neither overflow nor underflow.
const SAFE_TRACE: [f64; 2] = [1e-290, 1e290];
/// A deviator below this is rounding of a multiple of the identity.
const NO_DEVIATOR: f64 = 1e-30;
/// Coefficients of a cubic in `d` within 8.2e-5 of the root of `z^3 - 3 z = d` in `[sqrt(3), 2]`, for `0 <= d <= 2`
/// (interpolation at Chebyshev points).
const LARGEST_ROOT: [f64; 4] = [
    1.732_132_659_066_383_5,
    0.165_330_350_220_845_4,
    -0.020_345_598_711_443_85,
    0.002_329_920_974_370_48,
];
/// Newton steps after that cubic: errors of 5.8e-9, then rounding.
const ROOT_STEPS: usize = 2;

/// The factor `B'` whose core `I - Z B' Z^T` is the exact positive semi-definite projection of `C = I - Z T^-1 Z^T`, in every
/// lane: [`crate::RotationGradient::factor`] after [`crate::HessianCore::filtered`] with [`crate::Filter::Projected`].
///
/// `pair_sums` is `T` of [`super::RotationFactor`], `actuation` the symmetric `A`, `Z^T vec(dF) = axial(R^T dF A)`, so that
/// `K = Z^T Z = tr(A^2) I - A^2`. With `K + T = L L^T` and `X = L^-1 (K - T) L^-T`, `B' = L^-T 2 (I + |X|)^-1 L^-1`. (Where the
/// core is positive definite, that is `T^-1` up to rounding.) A lane where `K + T` is almost singular is done by scalar code.
/// Finite as long as the entries of `T` and `A^2` are; NaN otherwise.
#[inline(always)]
pub fn projected_factor_lanes<S: Simd>(
    simd: S,
    pair_sums: &SymmetricLanes<S>,
    actuation: &SymmetricLanes<S>,
) -> SymmetricLanes<S> {
    let reach = symmetric_pair_sums(simd, &symmetric_square(simd, actuation));
    let mut sum = reach;
    let mut difference = reach;
    for k in 0..6 {
        sum[k] = simd.add_f64s(reach[k], pair_sums[k]);
        difference[k] = simd.sub_f64s(reach[k], pair_sums[k]);
    }
    let trace = simd.add_f64s(sum[0], simd.add_f64s(sum[3], sum[5]));
    let unit = reciprocal(simd, trace);
    let sum = times(simd, &sum, unit);
    let difference = times(simd, &difference, unit);
    let (_, determinant) = symmetric_adjugate(simd, &sum);
    let good = simd.and_m64s(
        simd.less_than_f64s(simd.splat_f64s(SINGULAR), determinant),
        simd.and_m64s(
            simd.less_than_f64s(simd.splat_f64s(SAFE_TRACE[0]), trace),
            simd.less_than_f64s(trace, simd.splat_f64s(SAFE_TRACE[1])),
        ),
    );
    let inverse = inverse_cholesky_factor(simd, &sum);
    let mut weights = absolute_value(simd, &lower_congruence(simd, &inverse, &difference));
    for k in [0, 3, 5] {
        weights[k] = simd.add_f64s(weights[k], simd.splat_f64s(1.0));
    }
    let weights = symmetric_inverse(simd, &weights);
    let twice = scaled(simd, unit, 2.0);
    let projected = times(simd, &upper_congruence(simd, &inverse, &weights), twice);
    if all(simd, good) {
        return projected;
    }
    again(simd, pair_sums, actuation, projected, good)
}

/// Does the lanes that are not `good` by scalar code.
#[cold]
#[inline(never)]
fn again<S: Simd>(
    simd: S,
    pair_sums: &SymmetricLanes<S>,
    actuation: &SymmetricLanes<S>,
    mut projected: SymmetricLanes<S>,
    good: S::m64s,
) -> SymmetricLanes<S> {
    for_each_failed(simd, good, |i| {
        let a = symmetric_of_lane::<S>(actuation, i);
        let t = symmetric_of_lane::<S>(pair_sums, i);
        set_symmetric::<S>(&mut projected, i, &projected_factor(&reach(&a), &t));
    });
    projected
}

/// `|X|`, the symmetric matrix with the absolute eigenvalues of `X`, to rounding of the largest entry of `X`, which must not be
/// far above 1.
///
/// Newton's interpolation of `|x|` at the eigenvalues, without eigenvectors. The deviator `D = (X - m I) / p`, `|D|^2 = 6`, has
/// the eigenvalues `2 cos(phi + 2 pi k / 3)`. The one apart from the two others is a well conditioned root of
/// `z^3 - 3 z = det D`; the distance between the others comes from the Gram determinant of `I`, `D` and `D^2`, a sum of squares,
/// which keeps its digits where they coincide. The divided differences `(|a| - |b|) / (a - b) = (a + b) / (|a| + |b|)` lie in
/// `[-1, 1]` and divide by no difference; the second one divides by the distance of the single eigenvalue, at least `0.8 p`.
#[inline(always)]
fn absolute_value<S: Simd>(simd: S, x: &SymmetricLanes<S>) -> SymmetricLanes<S> {
    let splat = |k: f64| simd.splat_f64s(k);
    let add = |a, b| simd.add_f64s(a, b);
    let sub = |a, b| simd.sub_f64s(a, b);
    let mul = |a, b| simd.mul_f64s(a, b);
    let mean = scaled(simd, add(x[0], add(x[3], x[5])), 1.0 / 3.0);
    let mut deviator = *x;
    for k in [0, 3, 5] {
        deviator[k] = sub(x[k], mean);
    }
    let size = scaled(simd, squared_norm(simd, &deviator), 1.0 / 6.0);
    let size = simd.max_f64s(simd.sqrt_f64s(size), splat(NO_DEVIATOR));
    let unit = reciprocal(simd, size);
    let d = times(simd, &deviator, unit);
    let square = symmetric_square(simd, &d);

    // Eigenvalues of D: `single`, and `-single / 2` plus and minus `half`.
    let (_, determinant) = symmetric_adjugate(simd, &d);
    let positive = simd.less_than_f64s(splat(0.0), determinant);
    let z = largest_root(simd, simd.abs_f64s(determinant));
    let single = simd.select_f64s(positive, z, simd.neg_f64s(z));
    let sine = simd.sqrt_f64s(gram(simd, &d, &square));
    let slope = simd.mul_add_e_f64s(z, z, splat(-1.0));
    // 2 sin(3 phi) = sqrt(gram) / 3, sin(3 phi) = sin(phi) (4 cos(phi)^2 - 1).
    let half = simd.div_f64s(scaled(simd, sine, 0.75_f64.sqrt() / 3.0), slope);
    let middle = scaled(simd, single, -0.5);
    let (first, second) = (add(middle, half), sub(middle, half));

    let at = |y| simd.mul_add_e_f64s(y, size, mean);
    let (x_1, x_2, x_3) = (at(first), at(second), at(single));
    let (size_1, size_2, size_3) = (simd.abs_f64s(x_1), simd.abs_f64s(x_2), simd.abs_f64s(x_3));
    let divided = |a, b, size_a, size_b| {
        let sum = simd.max_f64s(add(size_a, size_b), splat(f64::MIN_POSITIVE));
        simd.div_f64s(add(a, b), sum)
    };
    let slope_12 = divided(x_1, x_2, size_1, size_2);
    let slope_23 = divided(x_2, x_3, size_2, size_3);
    let curvature = simd.div_f64s(sub(slope_23, slope_12), sub(single, first));
    // |x_1| I + p slope (D - y_1 I) + p curvature (D - y_1 I)(D - y_2 I), gathered by powers of D.
    let of_square = mul(size, curvature);
    let linear = minor(simd, size, slope_12, of_square, add(first, second));
    let constant = minor(
        simd,
        of_square,
        mul(first, second),
        mul(size, slope_12),
        first,
    );
    let constant = add(size_1, constant);
    let mut out = d;
    for (k, out) in out.iter_mut().enumerate() {
        *out = simd.mul_add_e_f64s(square[k], of_square, mul(linear, *out));
        if matches!(k, 0 | 3 | 5) {
            *out = add(*out, constant);
        }
    }
    out
}

/// The root of `z^3 - 3 z = d` in `[sqrt(3), 2]`, for `0 <= d <= 2`.
#[inline(always)]
fn largest_root<S: Simd>(simd: S, d: S::f64s) -> S::f64s {
    let mut z = simd.splat_f64s(LARGEST_ROOT[3]);
    for k in [2, 1, 0] {
        z = simd.mul_add_e_f64s(z, d, simd.splat_f64s(LARGEST_ROOT[k]));
    }
    let three = simd.splat_f64s(3.0);
    for _ in 0..ROOT_STEPS {
        let square = simd.mul_f64s(z, z);
        let value = simd.mul_add_e_f64s(simd.sub_f64s(square, three), z, simd.neg_f64s(d));
        let slope = simd.mul_add_e_f64s(square, three, simd.splat_f64s(-3.0));
        z = simd.sub_f64s(z, simd.div_f64s(value, slope));
    }
    z
}

/// `|X|^2`.
#[inline(always)]
fn squared_norm<S: Simd>(simd: S, x: &SymmetricLanes<S>) -> S::f64s {
    let (diagonal, off) = ([x[0], x[3], x[5]], [x[1], x[2], x[4]]);
    let twice = scaled(simd, dot3(simd, &off, &off), 2.0);
    simd.add_f64s(dot3(simd, &diagonal, &diagonal), twice)
}

/// The Gram determinant of the deviators of two symmetric matrices, by Lagrange's identity.
#[inline(always)]
fn gram<S: Simd>(simd: S, a: &SymmetricLanes<S>, b: &SymmetricLanes<S>) -> S::f64s {
    let (x, y) = (
        deviatoric_coordinates(simd, a),
        deviatoric_coordinates(simd, b),
    );
    let mut sum = simd.splat_f64s(0.0);
    for i in 0..5 {
        for j in 0..i {
            let area = minor(simd, x[i], y[j], x[j], y[i]);
            sum = simd.mul_add_e_f64s(area, area, sum);
        }
    }
    sum
}

/// Coordinates of a symmetric matrix's deviator in an orthonormal basis (Frobenius inner product).
#[inline(always)]
fn deviatoric_coordinates<S: Simd>(simd: S, x: &SymmetricLanes<S>) -> [S::f64s; 5] {
    use std::f64::consts::{FRAC_1_SQRT_2, SQRT_2};
    let sixth = (1.0_f64 / 6.0).sqrt();
    let rest = simd.add_f64s(simd.sub_f64s(x[5], x[0]), simd.sub_f64s(x[5], x[3]));
    [
        scaled(simd, simd.sub_f64s(x[0], x[3]), FRAC_1_SQRT_2),
        scaled(simd, rest, sixth),
        scaled(simd, x[1], SQRT_2),
        scaled(simd, x[2], SQRT_2),
        scaled(simd, x[4], SQRT_2),
    ]
}
