//! The polar rotation of every lane.

#[cfg(test)]
mod tests;

use super::algebra::{
    axial, cofactor, cofactor_first_row, dot3, minor, minors_are_above, norm_squared, pair_sums,
    product, reciprocal, scaled, symmetric_adjugate, symmetric_times, times, times_cross,
    transposed_product,
};
use super::{LaneMatrix, all, for_each_failed, lane, matrix_of_lane, set_lane};
use crate::polar_rotation;
use pulp::{Simd, WithSimd};

/// How far the largest root is pursued beyond the [`ROOT_STEPS`] that every lane takes.
#[derive(Clone, Copy)]
struct RootEffort {
    /// Further steps for the lanes that need them.
    steps: usize,
    /// A relative step at which a lane is done.
    small: f64,
}

/// Halley steps for the largest root that every lane takes: all that ordinary deformations need.
const ROOT_STEPS: usize = 2;
/// Inverted lanes need one or two steps more. The cube of the last step, the next one, is small enough for the Newton-Schulz
/// step to square away.
const FIRST_EFFORT: RootEffort = RootEffort {
    steps: 4,
    small: 3e-4,
};
/// Where two roots almost coincide, each step takes a third of the way until it is below their distance.
const RETRY_EFFORT: RootEffort = RootEffort {
    steps: 20,
    small: 1e-10,
};
/// Newton-Schulz steps, each with a Newton step on SO(3), in the second attempt.
const RETRY_STEPS: usize = 6;
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
/// on SO(3)). A lane that cannot prove its own accuracy takes more steps, and if that does not suffice is done again by the scalar
/// function, so that no answer is ever worse.
#[inline(always)]
pub fn polar_rotation_lanes<S: Simd>(simd: S, m: &LaneMatrix<S>) -> LaneMatrix<S> {
    let norm2 = norm_squared(simd, m);
    let safe = has_safe_norm(simd, norm2);
    let (guess, trace) = optimal_attitude(simd, m, norm2, FIRST_EFFORT);
    let (orthogonal, near) = newton_schulz(simd, &guess);
    let (rotation, certain) = rotation_step(simd, m, &orthogonal, trace);
    let good = simd.and_m64s(safe, simd.and_m64s(near, certain));
    if all(simd, good) {
        return rotation;
    }
    // A copy, so that what all lanes share stays in registers.
    let mut mended = rotation;
    again(simd, m, &mut mended, good);
    mended
}

/// Lanes of the widest register.
const WIDEST: usize = 8;

/// Does the lanes that are not `good` by more steps, and those that are not then by the scalar function.
#[cold]
#[inline(never)]
fn again<S: Simd>(simd: S, m: &LaneMatrix<S>, rotation: &mut LaneMatrix<S>, good: S::m64s) {
    let mut retry = Retry {
        m: [[0.0; WIDEST]; 9],
        rotation: [[0.0; WIDEST]; 9],
        good: [0.0; WIDEST],
        lanes: S::F64_LANES,
    };
    for (row, value) in retry.m.iter_mut().zip(m) {
        for (i, x) in row.iter_mut().enumerate().take(S::F64_LANES) {
            *x = lane::<S>(value, i);
        }
    }
    // This function is not inlined, so the instruction set must be entered anew.
    simd.vectorize(&mut retry);
    for_each_failed(simd, good, |i| {
        let r: [f64; 9] = if retry.good[i] == 0.0 {
            let r = polar_rotation(&matrix_of_lane::<S>(m, i));
            std::array::from_fn(|k| r[(k / 3, k % 3)])
        } else {
            std::array::from_fn(|k| retry.rotation[k][i])
        };
        for (out, r) in rotation.iter_mut().zip(r) {
            set_lane::<S>(out, i, r);
        }
    });
}

/// The second attempt.
struct Retry {
    m: [[f64; WIDEST]; 9],
    rotation: [[f64; WIDEST]; 9],
    /// Not zero where the rotation is certain.
    good: [f64; WIDEST],
    lanes: usize,
}

impl WithSimd for &mut Retry {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for part in 0..self.lanes / S::F64_LANES {
            let mut m = [simd.splat_f64s(0.0); 9];
            for (value, row) in m.iter_mut().zip(&self.m) {
                *value = S::as_simd_f64s(row).0[part];
            }
            let (rotation, good) = retry(simd, &m);
            for (row, value) in self.rotation.iter_mut().zip(&rotation) {
                S::as_mut_simd_f64s(row).0[part] = *value;
            }
            let flags = simd.select_f64s(good, simd.splat_f64s(1.0), simd.splat_f64s(0.0));
            S::as_mut_simd_f64s(&mut self.good).0[part] = flags;
        }
    }
}

/// The fast path with more steps of every kind: each lane keeps its first rotation that is certain.
#[inline(always)]
fn retry<S: Simd>(simd: S, m: &LaneMatrix<S>) -> (LaneMatrix<S>, S::m64s) {
    let norm2 = norm_squared(simd, m);
    let safe = has_safe_norm(simd, norm2);
    let (mut rotation, trace) = optimal_attitude(simd, m, norm2, RETRY_EFFORT);
    let mut out = rotation;
    let mut good = simd.not_m64s(safe);
    for _ in 0..RETRY_STEPS {
        let (orthogonal, near) = newton_schulz(simd, &rotation);
        let (turned, certain) = rotation_step(simd, m, &orthogonal, trace);
        for k in 0..9 {
            out[k] = simd.select_f64s(good, out[k], turned[k]);
        }
        good = simd.or_m64s(good, simd.and_m64s(near, certain));
        if all(simd, good) {
            break;
        }
        rotation = turned;
    }
    (out, simd.and_m64s(good, safe))
}

#[inline(always)]
fn has_safe_norm<S: Simd>(simd: S, norm2: S::f64s) -> S::m64s {
    simd.and_m64s(
        simd.less_than_f64s(simd.splat_f64s(SAFE_NORM2[0]), norm2),
        simd.less_than_f64s(norm2, simd.splat_f64s(SAFE_NORM2[1])),
    )
}

/// Markley's FOAM, as in the scalar function: the rotation and `tr S`, up to rounding amplified by `|M| / (s_y + s_z)`.
#[inline(always)]
fn optimal_attitude<S: Simd>(
    simd: S,
    m: &LaneMatrix<S>,
    norm2: S::f64s,
    effort: RootEffort,
) -> (LaneMatrix<S>, S::f64s) {
    let cof = cofactor(simd, m);
    let det = dot3(simd, &m[..3], &cof[..3]);
    let cof2 = norm_squared(simd, &cof);
    let x = largest_root(simd, norm2, det, cof2, effort);
    let square = simd.mul_f64s(x, x);
    let a = simd.sub_f64s(square, norm2);
    let half_x = scaled(simd, x, 0.5);
    let scale = reciprocal(simd, minor(simd, half_x, a, det, simd.splat_f64s(1.0)));
    let along = scaled(simd, simd.add_f64s(square, norm2), 0.5);
    let cubic = product(simd, m, &transposed_product(simd, m, m));
    let mut rotation = *m;
    for i in 0..9 {
        let rest = simd.sub_f64s(simd.mul_f64s(cof[i], x), cubic[i]);
        rotation[i] = simd.mul_f64s(simd.mul_add_e_f64s(m[i], along, rest), scale);
    }
    (rotation, x)
}

/// The largest root of `(x^2 - |M|^2)^2 - 8 det(M) x - 4 |cof M|^2`, which is `tr S`, by Halley's method from above.
///
/// With `e = s_x s_y + s_x s_z + s_y s_z`, `x^2 = |M|^2 + 2 e` and `e^2 = |cof M|^2 + 2 det(M) x`. So `e^2` is at most
/// `3 |cof M|^2`, and at most `|cof M|^2` where the determinant is negative.
#[inline(always)]
fn largest_root<S: Simd>(
    simd: S,
    norm2: S::f64s,
    det: S::f64s,
    cof2: S::f64s,
    effort: RootEffort,
) -> S::f64s {
    let inverted = simd.less_than_f64s(det, simd.splat_f64s(0.0));
    let times = simd.select_f64s(inverted, simd.splat_f64s(4.0), simd.splat_f64s(12.0));
    let start = simd.sqrt_f64s(simd.mul_f64s(cof2, times));
    let mut x = simd.sqrt_f64s(simd.add_f64s(norm2, start));
    let polynomial = Quartic {
        norm2,
        det2: simd.add_f64s(det, det),
        det8: scaled(simd, det, 8.0),
        cof4: scaled(simd, cof2, 4.0),
    };
    let mut step = x;
    for _ in 0..ROOT_STEPS {
        step = polynomial.halley_step(simd, x);
        x = simd.sub_f64s(x, step);
    }
    let is_small =
        |step, x| simd.less_than_f64s(simd.abs_f64s(step), scaled(simd, x, effort.small));
    let mut done = is_small(step, x);
    for _ in 0..effort.steps {
        if all(simd, done) {
            break;
        }
        let step = polynomial.halley_step(simd, x);
        // A lane that is done stays, whatever the others need.
        x = simd.select_f64s(done, x, simd.sub_f64s(x, step));
        done = simd.or_m64s(done, is_small(step, x));
    }
    x
}

/// `p(x) = (x^2 - |M|^2)^2 - 8 det(M) x - 4 |cof M|^2`, by the multiples of its coefficients that a step needs.
#[derive(Clone, Copy)]
struct Quartic<S: Simd> {
    norm2: S::f64s,
    det2: S::f64s,
    det8: S::f64s,
    cof4: S::f64s,
}

impl<S: Simd> Quartic<S> {
    /// `p p' / (p'^2 - p p'' / 2)`, with `p' = 4 d` and `p'' = 4 h`.
    #[inline(always)]
    fn halley_step(&self, simd: S, x: S::f64s) -> S::f64s {
        let square = simd.mul_f64s(x, x);
        let a = simd.sub_f64s(square, self.norm2);
        let rest = simd.mul_add_e_f64s(x, self.det8, self.cof4);
        let p = simd.sub_f64s(simd.mul_f64s(a, a), rest);
        let d = simd.sub_f64s(simd.mul_f64s(x, a), self.det2);
        let h = simd.sub_f64s(simd.mul_f64s(square, simd.splat_f64s(3.0)), self.norm2);
        let curved = simd.mul_f64s(scaled(simd, p, 0.5), h);
        let slope2 = simd.mul_f64s(scaled(simd, d, 4.0), d);
        simd.div_f64s(simd.mul_f64s(p, d), simd.sub_f64s(slope2, curved))
    }
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
    let w = symmetric_times(simd, &adjugate, &axial(simd, &b));
    let w = times(simd, &w, inverse);
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
