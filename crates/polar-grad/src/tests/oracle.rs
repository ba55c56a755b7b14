//! The textbook 9x9 formulas, written with Kronecker products and explicit singular vectors.

use super::vec;
use crate::{SignedSvd, signed_svd};
use nalgebra::{Matrix3, SMatrix, SVector, SymmetricEigen};

type Matrix9 = SMatrix<f64, 9, 9>;

/// `H_R = sum_k 2 / (s_i + s_j) vec(Q_k) vec(Q_k)^T` with `Q_k = U T_k V^T / sqrt 2`.
pub(super) fn rotation_gradient(m: &Matrix3<f64>) -> Matrix9 {
    let SignedSvd { u, sigma: s, v } = signed_svd(m);
    let twists = [
        (
            s.x + s.y,
            Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        ),
        (
            s.y + s.z,
            Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -1.0, 0.0),
        ),
        (
            s.x + s.z,
            Matrix3::new(0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0),
        ),
    ];
    twists
        .iter()
        .fold(Matrix9::zeros(), |sum, (pair_sum, twist)| {
            let q = vec(&(u * twist * v.transpose())) / 2.0_f64.sqrt();
            sum + q * q.transpose() * (2.0 / pair_sum)
        })
}

/// `I_3 (x) A`.
pub(super) fn hat(a: &Matrix3<f64>) -> Matrix9 {
    Matrix3::identity().kronecker(a)
}

/// `X (x) I_3`, for `Rhat` and `Fhat`.
pub(super) fn outer_hat(x: &Matrix3<f64>) -> Matrix9 {
    x.kronecker(&Matrix3::identity())
}

/// `C = I_9 - Ahat H_R Ahat`.
pub(super) fn core(f: &Matrix3<f64>, a: &Matrix3<f64>) -> Matrix9 {
    Matrix9::identity() - hat(a) * rotation_gradient(&(f * a)) * hat(a)
}

/// `d vec(A) / d b`.
pub(super) fn duplication() -> SMatrix<f64, 9, 6> {
    let mut d = SMatrix::zeros();
    for (column, (i, j)) in [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]
        .into_iter()
        .enumerate()
    {
        d[(3 * i + j, column)] = 1.0;
        d[(3 * j + i, column)] = 1.0;
    }
    d
}

/// The symmetric matrix with `map` applied to its eigenvalues.
pub(super) fn map_eigenvalues(c: &Matrix9, map: impl Fn(f64) -> f64) -> Matrix9 {
    let eigen = SymmetricEigen::new(*c);
    let mapped: SVector<f64, 9> = eigen.eigenvalues.map(map);
    eigen.eigenvectors * Matrix9::from_diagonal(&mapped) * eigen.eigenvectors.transpose()
}

/// Eigenvalues, ascending.
pub(super) fn eigenvalues(c: &Matrix9) -> [f64; 9] {
    let mut values: [f64; 9] = SymmetricEigen::new(*c).eigenvalues.into();
    values.sort_by(f64::total_cmp);
    values
}
