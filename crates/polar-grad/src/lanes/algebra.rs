//! Products, minors and factors of one 3x3 matrix per lane.

use super::{LaneMatrix, SymmetricLanes};
use pulp::Simd;

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

/// `a b - c d`.
#[inline(always)]
pub(super) fn minor<S: Simd>(simd: S, a: S::f64s, b: S::f64s, c: S::f64s, d: S::f64s) -> S::f64s {
    simd.negate_mul_add_e_f64s(c, d, simd.mul_f64s(a, b))
}

/// `a . b` of the first three entries.
#[inline(always)]
pub(super) fn dot3<S: Simd>(simd: S, a: &[S::f64s], b: &[S::f64s]) -> S::f64s {
    let first = simd.mul_f64s(a[0], b[0]);
    simd.mul_add_e_f64s(a[2], b[2], simd.mul_add_e_f64s(a[1], b[1], first))
}

/// `k v` for a constant k.
#[inline(always)]
pub(super) fn scaled<S: Simd>(simd: S, v: S::f64s, k: f64) -> S::f64s {
    simd.mul_f64s(v, simd.splat_f64s(k))
}

/// `1 / v`.
#[inline(always)]
pub(super) fn reciprocal<S: Simd>(simd: S, v: S::f64s) -> S::f64s {
    simd.div_f64s(simd.splat_f64s(1.0), v)
}

/// `k v` for all entries of a vector or matrix.
///
/// A loop, not `map`: what the compiler does not inline, like the closures of `map`, loses the instruction set.
#[inline(always)]
pub(super) fn times<S: Simd, const N: usize>(
    simd: S,
    v: &[S::f64s; N],
    k: S::f64s,
) -> [S::f64s; N] {
    let mut out = *v;
    for x in &mut out {
        *x = simd.mul_f64s(*x, k);
    }
    out
}

/// The sum of the squares of all entries.
#[inline(always)]
pub(super) fn norm_squared<S: Simd>(simd: S, m: &[S::f64s]) -> S::f64s {
    let mut sum = simd.mul_f64s(m[0], m[0]);
    for x in &m[1..] {
        sum = simd.mul_add_e_f64s(*x, *x, sum);
    }
    sum
}

/// `det(M) M^-T`.
#[inline(always)]
pub(super) fn cofactor<S: Simd>(simd: S, m: &LaneMatrix<S>) -> LaneMatrix<S> {
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

/// The first row of `det(M) M^-T`.
#[inline(always)]
pub(super) fn cofactor_first_row<S: Simd>(simd: S, m: &LaneMatrix<S>) -> [S::f64s; 3] {
    [
        minor(simd, m[4], m[8], m[5], m[7]),
        minor(simd, m[5], m[6], m[3], m[8]),
        minor(simd, m[3], m[7], m[4], m[6]),
    ]
}

/// `axial(X)`, the vector of `X - X^T`.
#[inline(always)]
pub(super) fn axial<S: Simd>(simd: S, x: &LaneMatrix<S>) -> [S::f64s; 3] {
    [
        simd.sub_f64s(x[7], x[5]),
        simd.sub_f64s(x[2], x[6]),
        simd.sub_f64s(x[3], x[1]),
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

/// A symmetric matrix times a vector.
#[inline(always)]
pub fn symmetric_times<S: Simd>(simd: S, s: &SymmetricLanes<S>, v: &[S::f64s; 3]) -> [S::f64s; 3] {
    [
        dot3(simd, &[s[0], s[1], s[2]], v),
        dot3(simd, &[s[1], s[3], s[4]], v),
        dot3(simd, &[s[2], s[4], s[5]], v),
    ]
}

/// The square of a symmetric matrix.
#[inline(always)]
pub fn symmetric_square<S: Simd>(simd: S, s: &SymmetricLanes<S>) -> SymmetricLanes<S> {
    let rows = [[s[0], s[1], s[2]], [s[1], s[3], s[4]], [s[2], s[4], s[5]]];
    let entry = |i: usize, j: usize| dot3(simd, &rows[i], &rows[j]);
    [
        entry(0, 0),
        entry(0, 1),
        entry(0, 2),
        entry(1, 1),
        entry(1, 2),
        entry(2, 2),
    ]
}

/// `tr(X) I - X` of a symmetric matrix; its eigenvalues are the sums of two of `X`'s.
#[inline(always)]
pub fn symmetric_pair_sums<S: Simd>(simd: S, x: &SymmetricLanes<S>) -> SymmetricLanes<S> {
    [
        simd.add_f64s(x[3], x[5]),
        simd.neg_f64s(x[1]),
        simd.neg_f64s(x[2]),
        simd.add_f64s(x[0], x[5]),
        simd.neg_f64s(x[4]),
        simd.add_f64s(x[0], x[3]),
    ]
}

/// `tr(X) I - X` of the symmetric part of any matrix.
#[inline(always)]
pub(super) fn pair_sums<S: Simd>(simd: S, x: &LaneMatrix<S>) -> SymmetricLanes<S> {
    let off = |i: usize, j: usize| scaled(simd, simd.add_f64s(x[i], x[j]), -0.5);
    [
        simd.add_f64s(x[4], x[8]),
        off(1, 3),
        off(2, 6),
        simd.add_f64s(x[0], x[8]),
        off(5, 7),
        simd.add_f64s(x[0], x[4]),
    ]
}

/// The adjugate of a symmetric matrix and its determinant: the inverse is their quotient, and the matrix is positive definite
/// exactly when its first entry, the adjugate's last entry and the determinant are positive (Sylvester).
#[inline(always)]
pub fn symmetric_adjugate<S: Simd>(simd: S, t: &SymmetricLanes<S>) -> (SymmetricLanes<S>, S::f64s) {
    let adjugate = [
        minor(simd, t[3], t[5], t[4], t[4]),
        minor(simd, t[2], t[4], t[1], t[5]),
        minor(simd, t[1], t[4], t[2], t[3]),
        minor(simd, t[0], t[5], t[2], t[2]),
        minor(simd, t[1], t[2], t[0], t[4]),
        minor(simd, t[0], t[3], t[1], t[1]),
    ];
    let determinant = dot3(simd, &t[..3], &adjugate[..3]);
    (adjugate, determinant)
}

/// The inverse of a symmetric matrix by its adjugate; not finite where the determinant is zero.
#[inline(always)]
pub fn symmetric_inverse<S: Simd>(simd: S, t: &SymmetricLanes<S>) -> SymmetricLanes<S> {
    let (adjugate, determinant) = symmetric_adjugate(simd, t);
    let inverse = reciprocal(simd, determinant);
    times(simd, &adjugate, inverse)
}

/// Whether the leading minors of a symmetric matrix, `(first, second, determinant)`, are above `margin * scale^k`, k being
/// their order; false for NaN.
#[inline(always)]
pub(super) fn minors_are_above<S: Simd>(
    simd: S,
    minors: (S::f64s, S::f64s, S::f64s),
    margin: f64,
    scale: S::f64s,
) -> S::m64s {
    let bound = scaled(simd, scale, margin);
    let bound2 = simd.mul_f64s(bound, scale);
    let bound3 = simd.mul_f64s(bound2, scale);
    simd.and_m64s(
        simd.less_than_f64s(bound, minors.0),
        simd.and_m64s(
            simd.less_than_f64s(bound2, minors.1),
            simd.less_than_f64s(bound3, minors.2),
        ),
    )
}

/// `L^-1` for a symmetric positive definite `G = L L^T` with `L` lower triangular: the entries 00, 10, 20, 11, 21, 22 of `L^-1`.
/// Not finite where `G` is not positive definite.
#[inline(always)]
pub fn inverse_cholesky_factor<S: Simd>(simd: S, g: &SymmetricLanes<S>) -> SymmetricLanes<S> {
    let inverse_root = |x| reciprocal(simd, simd.sqrt_f64s(x));
    let i_00 = inverse_root(g[0]);
    let l_10 = simd.mul_f64s(g[1], i_00);
    let l_20 = simd.mul_f64s(g[2], i_00);
    let i_11 = inverse_root(simd.negate_mul_add_e_f64s(l_10, l_10, g[3]));
    let l_21 = simd.mul_f64s(simd.negate_mul_add_e_f64s(l_20, l_10, g[4]), i_11);
    let rest = simd.negate_mul_add_e_f64s(l_20, l_20, g[5]);
    let i_22 = inverse_root(simd.negate_mul_add_e_f64s(l_21, l_21, rest));
    let i_10 = simd.neg_f64s(simd.mul_f64s(l_10, simd.mul_f64s(i_00, i_11)));
    let i_21 = simd.neg_f64s(simd.mul_f64s(l_21, simd.mul_f64s(i_11, i_22)));
    let below = simd.mul_add_e_f64s(l_20, i_00, simd.mul_f64s(l_21, i_10));
    let i_20 = simd.neg_f64s(simd.mul_f64s(below, i_22));
    [i_00, i_10, i_20, i_11, i_21, i_22]
}

/// `L X L^T` for lower triangular `L` (entries 00, 10, 20, 11, 21, 22) and symmetric `X`.
#[inline(always)]
pub fn lower_congruence<S: Simd>(
    simd: S,
    l: &SymmetricLanes<S>,
    x: &SymmetricLanes<S>,
) -> SymmetricLanes<S> {
    let rows = [[x[0], x[1], x[2]], [x[1], x[3], x[4]], [x[2], x[4], x[5]]];
    // Rows of L X.
    let first = times(simd, &rows[0], l[0]);
    let pair = |j: usize| simd.mul_add_e_f64s(l[3], rows[1][j], simd.mul_f64s(l[1], rows[0][j]));
    let second = [pair(0), pair(1), pair(2)];
    let third = symmetric_times(simd, x, &[l[2], l[4], l[5]]);
    let last = [l[2], l[4], l[5]];
    [
        simd.mul_f64s(first[0], l[0]),
        simd.mul_add_e_f64s(first[1], l[3], simd.mul_f64s(first[0], l[1])),
        dot3(simd, &first, &last),
        simd.mul_add_e_f64s(second[1], l[3], simd.mul_f64s(second[0], l[1])),
        dot3(simd, &second, &last),
        dot3(simd, &third, &last),
    ]
}

/// `L^T X L` for lower triangular `L` (entries 00, 10, 20, 11, 21, 22) and symmetric `X`.
#[inline(always)]
pub fn upper_congruence<S: Simd>(
    simd: S,
    l: &SymmetricLanes<S>,
    x: &SymmetricLanes<S>,
) -> SymmetricLanes<S> {
    let pair = |a, b, c, d| simd.mul_add_e_f64s(a, b, simd.mul_f64s(c, d));
    // Columns of X L.
    let first = symmetric_times(simd, x, &[l[0], l[1], l[2]]);
    let second = [
        pair(x[1], l[3], x[2], l[4]),
        pair(x[3], l[3], x[4], l[4]),
        pair(x[4], l[3], x[5], l[4]),
    ];
    let corner = simd.mul_f64s(x[5], l[5]);
    [
        dot3(simd, &first, &[l[0], l[1], l[2]]),
        pair(l[3], first[1], l[4], first[2]),
        simd.mul_f64s(l[5], first[2]),
        pair(l[3], second[1], l[4], second[2]),
        simd.mul_f64s(l[5], second[2]),
        simd.mul_f64s(l[5], corner),
    ]
}
