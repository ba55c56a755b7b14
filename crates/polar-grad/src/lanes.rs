//! Many 3x3 matrices at once: one per SIMD lane, for any instruction set that [`pulp`] dispatches to.
//!
//! A matrix of lanes is `[S::f64s; 9]`, row by row: entry `3 i + j` holds M_ij of all lanes. The functions here are meant to be
//! called inside a [`pulp::WithSimd`] operation, so that a whole loop runs under one dispatch.

use crate::polar_rotation;
use nalgebra::Matrix3;
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

/// One 3x3 matrix per lane, row by row.
pub type LaneMatrix<S> = [<S as Simd>::f64s; 9];

/// `a b`.
#[inline(always)]
pub fn product<S: Simd>(simd: S, a: &LaneMatrix<S>, b: &LaneMatrix<S>) -> LaneMatrix<S> {
    let mut out = *a;
    for i in 0..3 {
        for j in 0..3 {
            let first = simd.mul_f64s(a[3 * i], b[j]);
            let second = simd.mul_add_e_f64s(a[3 * i + 1], b[3 + j], first);
            out[3 * i + j] = simd.mul_add_e_f64s(a[3 * i + 2], b[6 + j], second);
        }
    }
    out
}

/// `a^T b`.
#[inline(always)]
pub fn transposed_product<S: Simd>(simd: S, a: &LaneMatrix<S>, b: &LaneMatrix<S>) -> LaneMatrix<S> {
    let transposed = [a[0], a[3], a[6], a[1], a[4], a[7], a[2], a[5], a[8]];
    product(simd, &transposed, b)
}

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
    let doubtful = simd.not_m64s(good);
    if simd.first_true_m64s(doubtful) == S::F64_LANES {
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
    let flags = simd.select_f64s(good, simd.splat_f64s(1.0), simd.splat_f64s(0.0));
    let lane = |v: &S::f64s, i: usize| {
        pulp::bytemuck::cast_slice::<S::f64s, f64>(std::slice::from_ref(v))[i]
    };
    for i in 0..S::F64_LANES {
        if lane(&flags, i) != 0.0 {
            continue;
        }
        let r = polar_rotation(&Matrix3::from_fn(|row, column| {
            lane(&m[3 * row + column], i)
        }));
        for (k, out) in rotation.iter_mut().enumerate() {
            let lanes: &mut [f64] = pulp::bytemuck::cast_slice_mut(std::slice::from_mut(out));
            lanes[i] = r[(k / 3, k % 3)];
        }
    }
    rotation
}

#[inline(always)]
fn norm_squared<S: Simd>(simd: S, m: &LaneMatrix<S>) -> S::f64s {
    let mut sum = simd.mul_f64s(m[0], m[0]);
    for x in &m[1..] {
        sum = simd.mul_add_e_f64s(*x, *x, sum);
    }
    sum
}

/// `a b - c d`.
#[inline(always)]
fn minor<S: Simd>(simd: S, a: S::f64s, b: S::f64s, c: S::f64s, d: S::f64s) -> S::f64s {
    simd.mul_add_e_f64s(a, b, simd.neg_f64s(simd.mul_f64s(c, d)))
}

#[inline(always)]
fn cofactor<S: Simd>(simd: S, m: &LaneMatrix<S>) -> LaneMatrix<S> {
    let [first, second, third] = cofactor_first_row(simd, m);
    [
        first,
        second,
        third,
        minor(simd, m[2], m[7], m[1], m[8]),
        minor(simd, m[0], m[8], m[2], m[6]),
        minor(simd, m[1], m[6], m[0], m[7]),
        minor(simd, m[1], m[5], m[2], m[4]),
        minor(simd, m[2], m[3], m[0], m[5]),
        minor(simd, m[0], m[4], m[1], m[3]),
    ]
}

/// `a . b` of the first rows.
#[inline(always)]
fn dot3<S: Simd>(simd: S, a: &[S::f64s], b: &[S::f64s]) -> S::f64s {
    let first = simd.mul_f64s(a[0], b[0]);
    simd.mul_add_e_f64s(a[2], b[2], simd.mul_add_e_f64s(a[1], b[1], first))
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
    let scaled = |v, k| simd.mul_f64s(v, simd.splat_f64s(k));
    let start = simd.sqrt_f64s(scaled(cof2, 3.0));
    let mut x = simd.sqrt_f64s(simd.add_f64s(norm2, simd.add_f64s(start, start)));
    let (det8, cof4) = (scaled(det, 8.0), scaled(cof2, 4.0));
    for _ in 0..ROOT_STEPS {
        let a = minor(simd, x, x, norm2, simd.splat_f64s(1.0));
        let p = simd.sub_f64s(simd.mul_f64s(a, a), simd.mul_add_e_f64s(x, det8, cof4));
        let slope = simd.sub_f64s(simd.mul_f64s(scaled(x, 4.0), a), det8);
        x = simd.sub_f64s(x, simd.div_f64s(p, slope));
    }
    let half_x = scaled(x, 0.5);
    let a = minor(simd, x, x, norm2, simd.splat_f64s(1.0));
    let scale = simd.div_f64s(
        simd.splat_f64s(1.0),
        simd.sub_f64s(simd.mul_f64s(half_x, a), det),
    );
    let along = scaled(simd.mul_add_e_f64s(x, x, norm2), 0.5);
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

#[inline(always)]
fn cofactor_first_row<S: Simd>(simd: S, m: &LaneMatrix<S>) -> [S::f64s; 3] {
    [
        minor(simd, m[4], m[8], m[5], m[7]),
        minor(simd, m[5], m[6], m[3], m[8]),
        minor(simd, m[3], m[7], m[4], m[6]),
    ]
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
    let half = simd.splat_f64s(-0.5);
    let off = |i: usize, j: usize| simd.mul_f64s(half, simd.add_f64s(b[i], b[j]));
    // T = tr(S) I - S, by its six entries 00, 01, 02, 11, 12, 22.
    let t = [
        simd.add_f64s(b[4], b[8]),
        off(1, 3),
        off(2, 6),
        simd.add_f64s(b[0], b[8]),
        off(5, 7),
        simd.add_f64s(b[0], b[4]),
    ];
    let adjugate = [
        minor(simd, t[3], t[5], t[4], t[4]),
        minor(simd, t[2], t[4], t[1], t[5]),
        minor(simd, t[1], t[4], t[2], t[3]),
        minor(simd, t[0], t[5], t[2], t[2]),
        minor(simd, t[1], t[2], t[0], t[4]),
        minor(simd, t[0], t[3], t[1], t[1]),
    ];
    let determinant = dot3(simd, &t[..3], &adjugate[..3]);
    let bound = simd.mul_f64s(trace, simd.splat_f64s(DEFINITE));
    let bound2 = simd.mul_f64s(bound, trace);
    let bound3 = simd.mul_f64s(bound2, trace);
    let axial = [
        simd.sub_f64s(b[7], b[5]),
        simd.sub_f64s(b[2], b[6]),
        simd.sub_f64s(b[3], b[1]),
    ];
    let inverse = simd.div_f64s(simd.splat_f64s(1.0), determinant);
    let w = symmetric_times(simd, &adjugate, &axial).map(|w| simd.mul_f64s(w, inverse));
    let angle2 = dot3(simd, &w, &w);
    let above = |bound, value| simd.less_than_f64s(bound, value);
    let definite = simd.and_m64s(
        above(bound, t[0]),
        simd.and_m64s(above(bound2, adjugate[5]), above(bound3, determinant)),
    );
    let near = simd.less_than_f64s(angle2, simd.splat_f64s(ANGLE2));
    let turn = times_cross(simd, r, &w);
    let mut out = *r;
    for (o, t) in out.iter_mut().zip(&turn) {
        *o = simd.add_f64s(*o, *t);
    }
    (out, simd.and_m64s(definite, near))
}

/// A symmetric matrix, by its entries 00, 01, 02, 11, 12, 22, times a vector.
#[inline(always)]
pub fn symmetric_times<S: Simd>(simd: S, s: &[S::f64s; 6], v: &[S::f64s; 3]) -> [S::f64s; 3] {
    [
        dot3(simd, &[s[0], s[1], s[2]], v),
        dot3(simd, &[s[1], s[3], s[4]], v),
        dot3(simd, &[s[2], s[4], s[5]], v),
    ]
}

/// `R [w]_x`, the tangent of a rotation whose body turns by `w`.
#[inline(always)]
pub fn times_cross<S: Simd>(simd: S, r: &LaneMatrix<S>, w: &[S::f64s; 3]) -> LaneMatrix<S> {
    let mut out = *r;
    for row in 0..3 {
        let (x, y, z) = (r[3 * row], r[3 * row + 1], r[3 * row + 2]);
        out[3 * row] = minor(simd, y, w[2], z, w[1]);
        out[3 * row + 1] = minor(simd, z, w[0], x, w[2]);
        out[3 * row + 2] = minor(simd, x, w[1], y, w[0]);
    }
    out
}

/// `dR = R [B axial(R^T dM)]_x`: [`crate::RotationGradient::apply`], many at once. `factor` holds the entries 00, 01, 02, 11, 12,
/// 22 of B.
#[inline(always)]
pub fn rotation_tangent_lanes<S: Simd>(
    simd: S,
    rotation: &LaneMatrix<S>,
    factor: &[S::f64s; 6],
    d_m: &LaneMatrix<S>,
) -> LaneMatrix<S> {
    let n = transposed_product(simd, rotation, d_m);
    let axial = [
        simd.sub_f64s(n[7], n[5]),
        simd.sub_f64s(n[2], n[6]),
        simd.sub_f64s(n[3], n[1]),
    ];
    times_cross(simd, rotation, &symmetric_times(simd, factor, &axial))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{HARD_CLASSES, Random, SCALES};
    use crate::{RotationGradient, signed_svd};
    use pulp::{Arch, WithSimd};

    /// Runs a lane function over a list of matrices on one instruction set.
    struct Run<'a>(&'a [Matrix3<f64>]);

    impl WithSimd for Run<'_> {
        type Output = Vec<Matrix3<f64>>;

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
            let mut out = Vec::new();
            for chunk in self.0.chunks(S::F64_LANES) {
                let m = load::<S>(simd, chunk);
                store::<S>(&polar_rotation_lanes(simd, &m), chunk.len(), &mut out);
            }
            out
        }
    }

    fn load<S: Simd>(simd: S, chunk: &[Matrix3<f64>]) -> LaneMatrix<S> {
        let mut m = [simd.splat_f64s(0.0); 9];
        for (k, v) in m.iter_mut().enumerate() {
            let lanes: &mut [f64] = pulp::bytemuck::cast_slice_mut(std::slice::from_mut(v));
            for (lane, matrix) in lanes.iter_mut().zip(chunk.iter().cycle()) {
                *lane = matrix[(k / 3, k % 3)];
            }
        }
        m
    }

    fn store<S: Simd>(m: &LaneMatrix<S>, count: usize, out: &mut Vec<Matrix3<f64>>) {
        let entry = |k: usize, i: usize| {
            pulp::bytemuck::cast_slice::<S::f64s, f64>(std::slice::from_ref(&m[k]))[i]
        };
        out.extend((0..count).map(|i| Matrix3::from_fn(|r, c| entry(3 * r + c, i))));
    }

    /// Every instruction set this machine has, and the portable one.
    fn on_all_sets(matrices: &[Matrix3<f64>], check: impl Fn(&[Matrix3<f64>])) {
        check(&Arch::new().dispatch(Run(matrices)));
        check(&Run(matrices).with_simd(pulp::Scalar));
        #[cfg(target_arch = "x86_64")]
        {
            if let Some(v3) = pulp::x86::V3::try_new() {
                check(&Simd::vectorize(v3, Run(matrices)));
            }
            if let Some(v4) = pulp::x86::V4::try_new() {
                check(&Simd::vectorize(v4, Run(matrices)));
            }
        }
    }

    /// Planted hard cases at all scales, mixed with ordinary ones, at every length around the lane count.
    #[test]
    fn lanes_agree_with_the_signed_svd() {
        let mut random = Random::new(5);
        let mut matrices = Vec::new();
        for (_, sigma) in HARD_CLASSES {
            for scale in SCALES {
                let (u, v) = (random.rotation(), random.rotation());
                let diagonal = Matrix3::from_diagonal(&nalgebra::Vector3::from(*sigma));
                matrices.push(u * diagonal * v.transpose() * *scale);
                matrices.push(random.matrix());
            }
        }
        for length in (1..=17).chain([matrices.len()]) {
            let part = &matrices[..length];
            on_all_sets(part, |rotations| {
                assert_eq!(rotations.len(), length);
                for (m, r) in part.iter().zip(rotations) {
                    let defect = (r.transpose() * r - Matrix3::identity()).norm();
                    assert!(
                        defect < 4e-15 && r.determinant() > 0.0,
                        "{m} {r} {defect:e}"
                    );
                    let gradient = RotationGradient::at(m);
                    let gap = gradient.smallest_pair_sum / m.norm().max(f64::MIN_POSITIVE);
                    if gap > 1e-6 {
                        let off = (r - signed_svd(m).rotation()).norm();
                        assert!(off < 1e-14 / gap, "{m} {off:e} {gap:e}");
                    }
                }
            });
        }
    }
}
