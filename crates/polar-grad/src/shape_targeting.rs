//! The shape-targeting energy of one sample, its gradients, and the vector-Jacobian product an
//! implicit adjoint needs.

use crate::hessian::{Filter, HessianCore};
use crate::linear::{mul, tr_mul};
use crate::polar::polar_rotation;
use nalgebra::Matrix3;

/// The energy density `psi(F, A) = 1/2 min_R |F - R A|^2` over rotations `R` (Frobenius norm),
/// attained at the polar rotation of `F A`.
///
/// Yang et al. 2022, Eq. 6 with the factor 1/2 of Eq. 11. `a` must be symmetric. Infinite where the squares are larger than
/// `f64::MAX`, NaN where an entry of `F A` is not finite.
pub fn shape_targeting_energy(f: &Matrix3<f64>, a: &Matrix3<f64>) -> f64 {
    0.5 * shape_targeting_gradient(f, a).norm_squared()
}

/// The gradient `d psi / d F = F - R A`. (The minimum over `R` is stationary, so `dR` does not
/// enter.) Finite as long as the entries of `F A` are and `R A` does not overflow.
pub fn shape_targeting_gradient(f: &Matrix3<f64>, a: &Matrix3<f64>) -> Matrix3<f64> {
    f - mul(&polar_rotation(&mul(f, a)), a)
}

/// The gradient `d psi / d b = -D^T vec(R^T (F - R A))` with respect to the six entries of `A = I +
/// sym(b)`.
pub fn shape_targeting_actuation_gradient(f: &Matrix3<f64>, a: &Matrix3<f64>) -> [f64; 6] {
    let rotation = polar_rotation(&mul(f, a));
    symmetric_cotangent(&-tr_mul(&rotation, &(f - mul(&rotation, a))))
}

/// The product `D^T (Rhat^T + Fhat^T H_R Ahat) vec(y)`, as six entries: MINUS the vector-Jacobian
/// product of `F - R A` with respect to `b`.
///
/// `d vec(F - R A) / d b = -(Rhat + Ahat H_R Fhat) D` (Eq. 15) with `Rhat = R (x) I_3`, `Fhat = F
/// (x) I_3`. When `H z = dL/du` is the adjoint equation and `y` is the gradient operator applied to
/// `z`, the loss gradient `dL/db` is this product times the quadrature weight, without a further
/// sign.
///
/// `core` is `HessianCore::new(f, a)`, `f` the same deformation gradient.
///
/// # Panics
/// When `core` has been filtered: an adjoint with a filtered derivative is silently wrong.
pub fn actuation_vjp(core: &HessianCore, f: &Matrix3<f64>, y: &Matrix3<f64>) -> [f64; 6] {
    assert!(
        core.filter == Filter::Exact,
        "the adjoint needs the exact core, but this one was filtered: {:?}",
        core.filter
    );
    let rotation_bar = core.gradient.apply(&mul(y, &core.actuation));
    symmetric_cotangent(&(tr_mul(&core.gradient.rotation, y) + tr_mul(f, &rotation_bar)))
}

/// The actuation `A = I + sym(b)` of six entries `(11, 12, 13, 22, 23, 33)` (Eq. 20).
pub fn actuation_from_b(b: &[f64; 6]) -> Matrix3<f64> {
    let [xx, xy, xz, yy, yz, zz] = *b;
    Matrix3::new(1.0 + xx, xy, xz, xy, 1.0 + yy, yz, xz, yz, 1.0 + zz)
}

/// The entries `(11, 12, 13, 22, 23, 33)` of the symmetric part of `m`.
pub fn symmetric_entries(m: &Matrix3<f64>) -> [f64; 6] {
    let s = crate::linear::symmetrize(m);
    [
        s[(0, 0)],
        s[(0, 1)],
        s[(0, 2)],
        s[(1, 1)],
        s[(1, 2)],
        s[(2, 2)],
    ]
}

/// `D^T vec(m_bar)`: the cotangent of the six entries of a symmetric matrix, given that of its
/// nine; each off-diagonal entry collects both of its places.
pub fn symmetric_cotangent(m_bar: &Matrix3<f64>) -> [f64; 6] {
    let m = |i: usize, j: usize| m_bar[(i, j)];
    [
        m(0, 0),
        m(0, 1) + m(1, 0),
        m(0, 2) + m(2, 0),
        m(1, 1),
        m(1, 2) + m(2, 1),
        m(2, 2),
    ]
}
