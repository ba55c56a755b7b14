//! The polar rotation of every lane.

use super::algebra::{
    axial, cofactor, cofactor_first_row, dot3, minor, minors_are_above, norm_squared, pair_sums,
    product, reciprocal, scaled, symmetric_adjugate, symmetric_times, times_cross,
    transposed_product,
};
use super::{LaneMatrix, all, for_each_failed, matrix_of_lane, set_lane};
use crate::polar_rotation;
use pulp::Simd;

/// Newton steps for the largest root. Fixed, as lanes go together; a lane that needs more fails its certificate.
const ROOT_STEPS: usize = 5;
/// Bound on `|R^T R - I|^2` before the Newton-Schulz step, which leaves the square of the defect: 2^-54.
const DEFECT2: f64 = 5.6e-17;
/// Bound on the squared angle of the last correction, which leaves an asymmetry of its square: 2^-54.
const ANGLE2: f64 = 5.6e-17;
/// How far the minors of `tr(S) I - S` must stay from zero, relative to `tr S`.
const DEFINITE: f64 = 1e-9;
/// Squared norms for which quartics of the entries stay far from overflow and underflow.
const SAFE_NORM2: [f64; 2] = [1e-40, 1e40];

/// The polar rotation of every lane: [`crate::polar_rotation`], many at once.
///
/// The fast path is that of the scalar function (largest root of the quaternion polynomial, a Newton-Schulz step, a Newton step
/// on SO(3)). A lane that cannot prove its own accuracy is done again by the scalar function, so that no answer is ever worse.
#[inline(always)]
pub fn polar_rotation_lanes<S: Simd>(simd: S, m: &LaneMatrix<S>) -> LaneMatrix<S> {
    let norm2 = norm_squared(simd, m);
    let mut good = simd.and_m64s(
        simd.less_than_f64s(simd.splat_f64s(SAFE_NORM2[0]), norm2),
        simd.less_than_f64s(norm2, simd.splat_f64s(SAFE_NORM2[1])),
    );
    let (guess, trace) = optimal_attitude(simd, m, norm2);
    let (orthogonal, near) = newton_schulz(simd, &guess);
    good = simd.and_m64s(good, near);
    let (rotation, certain) = rotation_step(simd, m, &orthogonal, trace);
    good = simd.and_m64s(good, certain);
    if all(simd, good) {
        return rotation;
    }
    again(simd, m, rotation, good)
}

/// Does the lanes that are not `good` by the scalar function.
#[cold]
#[inline(never)]
fn again<S: Simd>(
    simd: S,
    m: &LaneMatrix<S>,
    mut rotation: LaneMatrix<S>,
    good: S::m64s,
) -> LaneMatrix<S> {
    for_each_failed(simd, good, |i| {
        let r = polar_rotation(&matrix_of_lane::<S>(m, i));
        for (k, out) in rotation.iter_mut().enumerate() {
            set_lane::<S>(out, i, r[(k / 3, k % 3)]);
        }
    });
    rotation
}

/// Markley's FOAM, as in the scalar function: the rotation and `tr S`, up to rounding amplified by `|M| / (s_y + s_z)`.
#[inline(always)]
fn optimal_attitude<S: Simd>(
    simd: S,
    m: &LaneMatrix<S>,
    norm2: S::f64s,
) -> (LaneMatrix<S>, S::f64s) {
    let cof = cofactor(simd, m);
    let det = dot3(simd, &m[..3], &cof[..3]);
    let cof2 = norm_squared(simd, &cof);
    let start = simd.sqrt_f64s(scaled(simd, cof2, 3.0));
    let mut x = simd.sqrt_f64s(simd.add_f64s(norm2, simd.add_f64s(start, start)));
    let (det8, cof4) = (scaled(simd, det, 8.0), scaled(simd, cof2, 4.0));
    for _ in 0..ROOT_STEPS {
        let a = minor(simd, x, x, norm2, simd.splat_f64s(1.0));
        let p = simd.sub_f64s(simd.mul_f64s(a, a), simd.mul_add_e_f64s(x, det8, cof4));
        let slope = simd.sub_f64s(simd.mul_f64s(scaled(simd, x, 4.0), a), det8);
        x = simd.sub_f64s(x, simd.div_f64s(p, slope));
    }
    let half_x = scaled(simd, x, 0.5);
    let a = minor(simd, x, x, norm2, simd.splat_f64s(1.0));
    let scale = reciprocal(simd, simd.sub_f64s(simd.mul_f64s(half_x, a), det));
    let along = scaled(simd, simd.mul_add_e_f64s(x, x, norm2), 0.5);
    let cubic = product(simd, m, &transposed_product(simd, m, m));
    let mut rotation = *m;
    for i in 0..9 {
        let rest = minor(simd, cof[i], x, cubic[i], simd.splat_f64s(1.0));
        rotation[i] = simd.mul_f64s(simd.mul_add_e_f64s(m[i], along, rest), scale);
    }
    (rotation, x)
}

/// `R (3 I - R^T R) / 2`, and where that suffices.
#[inline(always)]
fn newton_schulz<S: Simd>(simd: S, r: &LaneMatrix<S>) -> (LaneMatrix<S>, S::m64s) {
    let mut defect = transposed_product(simd, r, r);
    for (i, d) in defect.iter_mut().enumerate() {
        let unit = simd.splat_f64s(if i % 4 == 0 { 1.0 } else { 0.0 });
        *d = simd.sub_f64s(unit, *d);
    }
    let small = simd.less_than_f64s(norm_squared(simd, &defect), simd.splat_f64s(DEFECT2));
    let c = cofactor_first_row(simd, r);
    let proper = simd.less_than_f64s(simd.splat_f64s(0.0), dot3(simd, &r[..3], &c));
    let correction = product(simd, r, &defect);
    let mut out = *r;
    for (o, c) in out.iter_mut().zip(&correction) {
        *o = simd.mul_add_e_f64s(*c, simd.splat_f64s(0.5), *o);
    }
    (out, simd.and_m64s(small, proper))
}

/// `R (I + [w]_x)` with `(tr(S) I - S) w = axial(R^T M)`, and where that suffices and is certain to be a maximum.
#[inline(always)]
fn rotation_step<S: Simd>(
    simd: S,
    m: &LaneMatrix<S>,
    r: &LaneMatrix<S>,
    trace: S::f64s,
) -> (LaneMatrix<S>, S::m64s) {
    let b = transposed_product(simd, r, m);
    let t = pair_sums(simd, &b);
    let (adjugate, determinant) = symmetric_adjugate(simd, &t);
    let inverse = reciprocal(simd, determinant);
    let w = symmetric_times(simd, &adjugate, &axial(simd, &b)).map(|w| simd.mul_f64s(w, inverse));
    let angle2 = dot3(simd, &w, &w);
    let definite = minors_are_above(simd, (t[0], adjugate[5], determinant), DEFINITE, trace);
    let near = simd.less_than_f64s(angle2, simd.splat_f64s(ANGLE2));
    let turn = times_cross(simd, r, &w);
    let mut out = *r;
    for (o, t) in out.iter_mut().zip(&turn) {
        *o = simd.add_f64s(*o, *t);
    }
    (out, simd.and_m64s(definite, near))
}
