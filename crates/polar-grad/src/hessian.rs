//! The Hessian core of the shape-targeting energy: products, spectrum and filters.

use crate::gradient::{RotationGradient, cross_basis};
use crate::linear::{conjugate, mul, mul_tr, pair_sums, symmetrize, tr_mul};
use crate::polar::polar;
use crate::scaling::Scaling;
use crate::symmetric::{Minors, SINGULAR, eigen, inverse_cholesky_factor};
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
    /// The three eigenvalues that depend on the state, ascending, each at most 1; the six further
    /// ones are 1.
    pub nontrivial: [f64; 3],
}

/// `C = I_9 - Ahat H_R Ahat`, the derivative of `F - R A` with respect to `F`, where `R` is the
/// polar rotation of `F A` and `Ahat = I_3 (x) A` (Eq. 14 of the supplement to Yang et al. 2022).
///
/// With `Z^T vec(dF) = axial(R^T dF A)`, `C = I_9 - Z B Z^T` and `Z^T Z = tr(A^2) I - A^2`. So `C
/// <= I` always, six eigenvalues are 1, and the others are `1 - mu_k` with `(tr(A^2) I - A^2) w_k =
/// mu_k (tr(S) I - S) w_k`. Normalised to `w_j^T (tr(S) I - S) w_k = delta_jk` these give `B =
/// sum_k w_k w_k^T`, and a function of `C` that keeps the ones only weighs that sum: `B' = sum_k
/// c(mu_k) w_k w_k^T`, with `c = min(1, 1/mu)` for [`Filter::Projected`] and `c = 2 min(1, 1/mu) -
/// 1` for [`Filter::Absolute`]. Products cost the same for all three.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HessianCore {
    /// The polar rotation of `F A` and its derivative; after filtering,
    /// [`RotationGradient::factor`] holds `B'` in place of `B`.
    pub gradient: RotationGradient,
    /// The symmetric actuation `A`.
    pub actuation: Matrix3<f64>,
    /// Which filter has been applied.
    pub filter: Filter,
}

impl HessianCore {
    /// The exact core at deformation gradient `f` and symmetric actuation `a` (which may be
    /// singular or indefinite).
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
    /// `C` is symmetric in the Frobenius inner product, so this is also its vector-Jacobian
    /// product.
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

    /// The eigenvalues of `C`, after the filter that was applied; NaN where the core is.
    ///
    /// Exact to rounding of the largest of them, and never above 1 before [`Filter::Absolute`]. One that is larger than `f64::MAX` in
    /// size is given as that.
    pub fn spectrum(&self) -> Spectrum {
        // Sums of the largest numbers overflow; quotients do not notice a common factor.
        let Some((_, [k, t])) = Scaling::to_unit_alike(&self.reach(), &self.gradient.pair_sums)
        else {
            return Spectrum {
                nontrivial: [f64::NAN; 3],
            };
        };
        // Scaling K and T alike keeps the axes well determined when one is far larger than the
        // other.
        let balance = |x: &Matrix3<f64>| x / x.trace().max(f64::MIN_POSITIVE);
        let y = joint_axes(&balance(&k), &balance(&t));
        // The error of a Rayleigh quotient is the square of its axis's.
        let mut nontrivial = [0, 1, 2].map(|i| {
            let y = y.column(i);
            let exact = y.dot(&((t - k) * y)) / y.dot(&(t * y));
            // `K` is positive semi-definite, but its rounding, over a `T` at its floor, may say otherwise.
            let exact = exact.clamp(-f64::MAX, 1.0);
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
    /// A positive definite core keeps its matrix bit for bit, and so does one that was filtered
    /// before: the filters leave positive semi-definite matrices alone. [`Filter::Projected`] stays
    /// finite and positive semi-definite to rounding as `s_y + s_z` goes to 0. (Only when `A` has
    /// rank one, or nearly, may rounding reach 1e-6.)
    pub fn filtered(&self, filter: Filter) -> Self {
        if filter == Filter::Exact || self.filter != Filter::Exact {
            return *self;
        }
        let mut core = *self;
        core.filter = filter;
        let (k, t) = (self.reach(), self.gradient.pair_sums);
        // An actuation of rank one meets a B so large that its rounding alone would show in C.
        let moderate = (t / 4.0).trace() * (core.gradient.factor * 4.0).trace() < 1.0 / SINGULAR;
        if moderate && is_definite(&k, &t) {
            return core;
        }
        let projected = projected_factor(&k, &t);
        core.gradient.factor = match filter {
            Filter::Absolute => projected * 2.0 - self.gradient.factor,
            _ => projected,
        };
        core
    }

    fn reach(&self) -> Matrix3<f64> {
        reach(&self.actuation)
    }
}

/// `K = Z^T Z = tr(A^2) I - A^2`.
pub(crate) fn reach(actuation: &Matrix3<f64>) -> Matrix3<f64> {
    pair_sums(&symmetrize(&tr_mul(actuation, actuation)))
}

/// Axes `Y` (columns) with `Y^T (K + T) Y = I` and `Y^T K Y` diagonal, for positive semi-definite
/// `K` and `T`.
///
/// The sum is well conditioned where `T` alone (`s_y + s_z` near 0) or `K` alone (singular `A`) is
/// not.
fn joint_axes(k: &Matrix3<f64>, t: &Matrix3<f64>) -> Matrix3<f64> {
    let inverse = inverse_cholesky_factor(&(k + t));
    let (_, q) = eigen(&congruent(&inverse, k));
    tr_mul(&inverse, &q)
}

/// `L X L^T`, exactly symmetric.
fn congruent(l: &Matrix3<f64>, x: &Matrix3<f64>) -> Matrix3<f64> {
    symmetrize(&mul(l, &mul_tr(x, l)))
}

/// Whether `T - K` is positive definite, in any unit of length: its determinant is a cube, which would overflow at 1e103 already.
fn is_definite(k: &Matrix3<f64>, t: &Matrix3<f64>) -> bool {
    let scaled = Scaling::to_unit_alike(k, t);
    scaled.is_some_and(|(_, [k, t])| Minors::of(&(t - k)).are_above(0.0, 1.0))
}

/// `sum_k min(1, 1/mu_k) w_k w_k^T`; NaN when an entry is not finite.
///
/// With `K + T = L L^T` and `X = L^-1 (K - T) L^-T`, whose eigenvalues are `x = (mu - 1) / (mu +
/// 1)`, this is `L^-T 2 (I + |X|)^-1 L^-1`: nothing is divided by a small number.
pub(crate) fn projected_factor(k: &Matrix3<f64>, t: &Matrix3<f64>) -> Matrix3<f64> {
    let Some((scaling, [k, t])) = Scaling::to_unit_alike(k, t) else {
        return Matrix3::repeat(f64::NAN);
    };
    let inverse = inverse_cholesky_factor(&(k + t));
    let magnitude = absolute_value(&congruent(&inverse, &(k - t)));
    let weights = Minors::of(&(Matrix3::identity() + magnitude)).inverse() * 2.0;
    congruent(&inverse.transpose(), &weights) * scaling.down
}

/// A determinant of a matrix of size one beyond this has a certain sign.
const CERTAIN_DETERMINANT: f64 = 1e-13;

/// `|X|`, the symmetric matrix with the absolute eigenvalues of `X`, to rounding, for entries of at most about one.
///
/// The stretch of `X` or `-X`, whichever has no negative determinant; by eigenvectors where rounding decides which one that is.
fn absolute_value(x: &Matrix3<f64>) -> Matrix3<f64> {
    let determinant = x.determinant();
    if determinant.abs() > CERTAIN_DETERMINANT {
        return polar(&(x * determinant.signum())).stretch;
    }
    let (values, axes) = eigen(x);
    conjugate(&axes, &values.abs())
}
