//! Unrolled 3x3 products and the axial/cross-product correspondence.

use nalgebra::{Matrix3, Vector3};

/// `A B`.
#[inline(always)]
pub(crate) fn mul(a: &Matrix3<f64>, b: &Matrix3<f64>) -> Matrix3<f64> {
    Matrix3::from_fn(|i, j| a[(i, 0)] * b[(0, j)] + a[(i, 1)] * b[(1, j)] + a[(i, 2)] * b[(2, j)])
}

/// `A^T B`.
#[inline(always)]
pub(crate) fn tr_mul(a: &Matrix3<f64>, b: &Matrix3<f64>) -> Matrix3<f64> {
    Matrix3::from_fn(|i, j| a[(0, i)] * b[(0, j)] + a[(1, i)] * b[(1, j)] + a[(2, i)] * b[(2, j)])
}

/// `A B^T`.
#[inline(always)]
pub(crate) fn mul_tr(a: &Matrix3<f64>, b: &Matrix3<f64>) -> Matrix3<f64> {
    Matrix3::from_fn(|i, j| a[(i, 0)] * b[(j, 0)] + a[(i, 1)] * b[(j, 1)] + a[(i, 2)] * b[(j, 2)])
}

/// `axial(X)`, the vector of `X - X^T`.
#[inline(always)]
pub(crate) fn axial(x: &Matrix3<f64>) -> Vector3<f64> {
    Vector3::new(
        x[(2, 1)] - x[(1, 2)],
        x[(0, 2)] - x[(2, 0)],
        x[(1, 0)] - x[(0, 1)],
    )
}

/// `A [w]_x`: its columns are `A (w x e_j)`.
#[inline(always)]
pub(crate) fn mul_cross(a: &Matrix3<f64>, w: &Vector3<f64>) -> Matrix3<f64> {
    let (x, y, z) = (a.column(0), a.column(1), a.column(2));
    Matrix3::from_columns(&[y * w.z - z * w.y, z * w.x - x * w.z, x * w.y - y * w.x])
}

/// The cofactor matrix, `det(A) A^-T`; its columns are cross products of `A`'s.
#[inline(always)]
pub(crate) fn cofactor(a: &Matrix3<f64>) -> Matrix3<f64> {
    let m = |i: usize, j: usize| a[(i, j)];
    Matrix3::new(
        m(1, 1) * m(2, 2) - m(1, 2) * m(2, 1),
        m(1, 2) * m(2, 0) - m(1, 0) * m(2, 2),
        m(1, 0) * m(2, 1) - m(1, 1) * m(2, 0),
        m(2, 1) * m(0, 2) - m(2, 2) * m(0, 1),
        m(2, 2) * m(0, 0) - m(2, 0) * m(0, 2),
        m(2, 0) * m(0, 1) - m(2, 1) * m(0, 0),
        m(0, 1) * m(1, 2) - m(0, 2) * m(1, 1),
        m(0, 2) * m(1, 0) - m(0, 0) * m(1, 2),
        m(0, 0) * m(1, 1) - m(0, 1) * m(1, 0),
    )
}

/// `1/2 (A + A^T)`.
#[inline(always)]
pub(crate) fn symmetrize(a: &Matrix3<f64>) -> Matrix3<f64> {
    let (xy, xz, yz) = (
        0.5 * (a[(0, 1)] + a[(1, 0)]),
        0.5 * (a[(0, 2)] + a[(2, 0)]),
        0.5 * (a[(1, 2)] + a[(2, 1)]),
    );
    Matrix3::new(a[(0, 0)], xy, xz, xy, a[(1, 1)], yz, xz, yz, a[(2, 2)])
}

/// `tr(X) I - X` of a symmetric matrix; its eigenvalues are the sums of two of `X`'s.
#[inline(always)]
pub(crate) fn pair_sums(x: &Matrix3<f64>) -> Matrix3<f64> {
    Matrix3::new(
        x[(1, 1)] + x[(2, 2)],
        -x[(0, 1)],
        -x[(0, 2)],
        -x[(1, 0)],
        x[(0, 0)] + x[(2, 2)],
        -x[(1, 2)],
        -x[(2, 0)],
        -x[(2, 1)],
        x[(0, 0)] + x[(1, 1)],
    )
}

/// `X diag(d) X^T`, exactly symmetric.
#[inline(always)]
pub(crate) fn conjugate(x: &Matrix3<f64>, d: &Vector3<f64>) -> Matrix3<f64> {
    let scaled = Matrix3::from_fn(|i, k| x[(i, k)] * d[k]);
    symmetrize(&mul_tr(&scaled, x))
}
