//! The Hessian core of the shape-targeting energy: products, spectrum and filters.

use crate::gradient::{RotationGradient, cross_basis};
use crate::linear::{conjugate, mul, mul_tr, pair_sums, symmetrize, tr_mul};
use crate::symmetric::{Minors, eigen, inverse_cholesky_factor};
use nalgebra::{Matrix3, SMatrix};

/// What is done to the negative eigenvalues of a [`HessianCore`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Filter {
    /// Nothing: the true Hessian, which an adjoint needs.
    Exact,
    /// Each eigenvalue `x` becomes `max(x, 0)`: the nearest positive semi-definite matrix.
    Projected,
    /// Each eigenvalue `x` becomes `|x|`.
    Absolute,
}

/// The eigenvalues of a [`HessianCore`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spectrum {
    /// The three eigenvalues that depend on the state, ascending, each at most 1; the six further ones are 1.
    pub nontrivial: [f64; 3],
}

/// `C = I_9 - Ahat H_R Ahat`, the derivative of `F - R A` with respect to `F`, where `R` is the polar rotation of `F A` and `Ahat = I_3 (x) A`
/// (Eq. 14 of the supplement to Yang et al. 2022).
///
/// With `Z^T vec(dF) = axial(R^T dF A)`, `C = I_9 - Z B Z^T` and `Z^T Z = tr(A^2) I - A^2`. So `C <= I` always, six eigenvalues are
/// 1, and the others are `1 - mu_k` with `(tr(A^2) I - A^2) w_k = mu_k (tr(S) I - S) w_k`. Normalised to `w_j^T (tr(S) I - S) w_k = delta_jk` these give `B = sum_k w_k w_k^T`, and a
/// function of `C` that keeps the ones only weighs that sum: `B' = sum_k c(mu_k) w_k w_k^T`,
/// with `c = min(1, 1/mu)` for [`Filter::Projected`] and `c = 2 min(1, 1/mu) - 1` for [`Filter::Absolute`]. Products cost the same for all three.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HessianCore {
    /// The polar rotation of `F A` and its derivative; after filtering, [`RotationGradient::factor`] holds `B'` in place of `B`.
    pub gradient: RotationGradient,
    /// The symmetric actuation `A`.
    pub actuation: Matrix3<f64>,
    /// Which filter has been applied.
    pub filter: Filter,
}

impl HessianCore {
    /// The exact core at deformation gradient `f` and symmetric actuation `a` (which may be singular or indefinite).
    ///
    /// Finite as long as the entries of `A^2` and `F A` are.
    pub fn new(f: &Matrix3<f64>, a: &Matrix3<f64>) -> Self {
        Self {
            gradient: RotationGradient::at(&mul(f, a)),
            actuation: *a,
            filter: Filter::Exact,
        }
    }

    /// The tangent of `F - R A`, `dF - R [B axial(R^T dF A)]_x A`, for the tangent `d_f` of `F`.
    ///
    /// `C` is symmetric in the Frobenius inner product, so this is also its vector-Jacobian product.
    pub fn apply(&self, d_f: &Matrix3<f64>) -> Matrix3<f64> {
        d_f - mul(
            &self.gradient.apply(&mul(d_f, &self.actuation)),
            &self.actuation,
        )
    }

    /// The 9x9 matrix `C` in row-wise `vec`.
    pub fn to_matrix(&self) -> SMatrix<f64, 9, 9> {
        let z = cross_basis(&self.gradient.rotation, &self.actuation);
        SMatrix::identity() - z * self.gradient.factor * z.transpose()
    }

    /// The eigenvalues of `C`, after the filter that was applied.
    pub fn spectrum(&self) -> Spectrum {
        let k = self.reach();
        let t = self.gradient.pair_sums;
        let (_, y) = joint_axes(&k, &t);
        // Rayleigh quotients: their error is the square of the axes'.
        let mut nontrivial = [0, 1, 2].map(|i| {
            let y = y.column(i);
            let exact = y.dot(&((t - k) * y)) / y.dot(&(t * y));
            match self.filter {
                Filter::Exact => exact,
                Filter::Projected => exact.max(0.0),
                Filter::Absolute => exact.abs(),
            }
        });
        nontrivial.sort_by(f64::total_cmp);
        Spectrum { nontrivial }
    }

    /// The core with its negative eigenvalues changed by `filter`.
    ///
    /// A core without negative eigenvalues comes back bit for bit, and so does one that was filtered before: the filters
    /// leave positive semi-definite matrices alone. [`Filter::Projected`] stays finite and positive semi-definite (to rounding) as
    /// `s_y + s_z` goes to 0.
    pub fn filtered(&self, filter: Filter) -> Self {
        if filter == Filter::Exact || self.filter != Filter::Exact {
            return *self;
        }
        let mut core = *self;
        core.filter = filter;
        let (k, t) = (self.reach(), self.gradient.pair_sums);
        if Minors::of(&(t - k)).are_above(0.0, 1.0) {
            return core;
        }
        let projected = projected_factor(&k, &t);
        core.gradient.factor = match filter {
            Filter::Absolute => projected * 2.0 - self.gradient.factor,
            _ => projected,
        };
        core
    }

    /// `Z^T Z = tr(A^2) I - A^2`.
    fn reach(&self) -> Matrix3<f64> {
        pair_sums(&symmetrize(&tr_mul(&self.actuation, &self.actuation)))
    }
}

/// `theta` and axes `Y` (columns) with `Y^T (K + T) Y = I` and `Y^T K Y = diag(theta)`, for positive semi-definite `K` and `T`.
///
/// The sum is well conditioned where `T` alone (`s_y + s_z` near 0) or `K` alone (singular `A`) is not.
fn joint_axes(k: &Matrix3<f64>, t: &Matrix3<f64>) -> (nalgebra::Vector3<f64>, Matrix3<f64>) {
    let inverse = inverse_cholesky_factor(&(k + t));
    let (theta, q) = eigen(&conjugate_by(&inverse, k));
    (theta, tr_mul(&inverse, &q))
}

/// `L K L^T`, exactly symmetric.
fn conjugate_by(l: &Matrix3<f64>, k: &Matrix3<f64>) -> Matrix3<f64> {
    symmetrize(&mul(l, &mul_tr(k, l)))
}

/// `sum_k min(1, 1/mu_k) w_k w_k^T`.
///
/// In the axes of [`joint_axes`], `mu = theta / (1 - theta)` and `w = y / sqrt(1 - theta)`, so the sum is
/// that of `y y^T / max(theta, 1 - theta)`: no divisor is below one half.
fn projected_factor(k: &Matrix3<f64>, t: &Matrix3<f64>) -> Matrix3<f64> {
    let (theta, y) = joint_axes(k, t);
    conjugate(&y, &theta.map(|x| 1.0 / x.max(1.0 - x)))
}
