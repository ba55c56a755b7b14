//! Tests of the whole crate against planted answers, finite differences and dense 9x9 formulas.

mod gradient;
mod hessian;
mod oracle;
mod polar;
mod shape_targeting;
mod svd;
mod symmetric;

use nalgebra::{Matrix3, SMatrix, SVector};

/// `max |R^T R - I|`, or infinity when `R` is improper or not finite.
fn distance_from_rotation(r: &Matrix3<f64>) -> f64 {
    let defect = (r.transpose() * r - Matrix3::identity()).amax();
    if r.iter().all(|x| x.is_finite()) && r.determinant() > 0.0 {
        defect
    } else {
        f64::INFINITY
    }
}

/// The matrix divided by the power of two that makes its largest entry about one (exact), and that
/// entry's size.
fn normalised(m: &Matrix3<f64>) -> Matrix3<f64> {
    crate::scaling::Scaling::to_unit(m)
        .expect("the matrix must be finite")
        .1
}

/// The Jacobian of `f` at `x` by fourth-order central differences with step `h`.
fn differences<const M: usize, const N: usize>(
    f: impl Fn(&SVector<f64, N>) -> SVector<f64, M>,
    x: &SVector<f64, N>,
    h: f64,
) -> SMatrix<f64, M, N> {
    let mut jacobian = SMatrix::<f64, M, N>::zeros();
    for i in 0..N {
        let at = |k: f64| {
            let mut moved = *x;
            moved[i] += k * h;
            f(&moved)
        };
        let slope = ((at(1.0) - at(-1.0)) * 8.0 - (at(2.0) - at(-2.0))) / (12.0 * h);
        jacobian.set_column(i, &slope);
    }
    jacobian
}

/// Row-wise `vec`.
fn vec(m: &Matrix3<f64>) -> SVector<f64, 9> {
    SVector::from_fn(|i, _| m[(i / 3, i % 3)])
}

/// The inverse of [`vec`].
fn mat(v: &SVector<f64, 9>) -> Matrix3<f64> {
    Matrix3::from_row_slice(v.as_slice())
}
