//! The rotation of the polar decomposition: a certified fast path and the signed SVD behind it.

use crate::linear::{axial, cofactor, mul, mul_cross, pair_sums, symmetrize, tr_mul};
use crate::scaling::Scaling;
use crate::svd::{signed_svd, svd_of_scaled};
use crate::symmetric::Minors;
use nalgebra::Matrix3;

/// Squared norms for which quartics of the entries stay far from overflow and underflow.
const SAFE_NORM2: std::ops::Range<f64> = 1e-40..1e40;
/// Newton steps for the largest root; quadratic convergence needs two to six.
const MAX_ROOT_STEPS: usize = 12;
/// A relative root step whose square, the next one, is small enough for the Newton-Schulz step to
/// square away.
const ROOT_STEP: f64 = 1e-5;
/// Bound on `|R^T R - I|^2` before the Newton-Schulz step, which leaves the square of the defect:
/// 2^-54.
const DEFECT2: f64 = 5.6e-17;
/// Bound on the squared angle of the last correction, which leaves an asymmetry of its square:
/// 2^-54.
const ANGLE2: f64 = 5.6e-17;
/// How far the minors of `tr(S) I - S` must stay from zero, relative to `tr S`, for its sign to be
/// beyond rounding.
const DEFINITE: f64 = 1e-9;

/// The polar decomposition `M = R S` with `R` in SO(3) and `S` symmetric.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Polar {
    /// The rotation `R`, `det R = +1`.
    pub rotation: Matrix3<f64>,
    /// The symmetric stretch `S = R^T M`; its eigenvalues are the signed singular values, so it is
    /// indefinite when `det M < 0`.
    pub stretch: Matrix3<f64>,
}

/// The polar decomposition `M = R S`, `R = polar_rotation(M)` and `S` the symmetric part of `R^T
/// M`.
///
/// NaN in every entry when `m` has a non-finite entry. An entry of `S` that exceeds `f64::MAX` is
/// returned as `f64::MAX`.
pub fn polar(m: &Matrix3<f64>) -> Polar {
    match certified_rotation(m) {
        Some(rotation) => Polar {
            rotation,
            stretch: symmetrize(&tr_mul(&rotation, m)),
        },
        None => polar_by_svd(m),
    }
}

#[cold]
#[inline(never)]
fn polar_by_svd(m: &Matrix3<f64>) -> Polar {
    let Some((scaling, scaled)) = Scaling::to_unit(m) else {
        let nan = Matrix3::repeat(f64::NAN);
        return Polar {
            rotation: nan,
            stretch: nan,
        };
    };
    // Composed before it is scaled back: `s_x` may exceed `f64::MAX` where no entry of `S` does.
    let svd = svd_of_scaled(&scaled);
    Polar {
        rotation: svd.rotation(),
        stretch: svd.stretch().map(|x| scaling.restore(x)),
    }
}

/// The rotation nearest to `m`: the `R` in SO(3) that maximises `tr(R^T M)`, so that `R^T M` is
/// symmetric and `tr(S) I - S` is positive semi-definite.
///
/// `R` is orthogonal to about 1e-15 and `R^T M` symmetric to about 1e-15 of `|M|` for every finite
/// `m`. The fast path (largest root of the quaternion characteristic polynomial, one Newton-Schulz
/// step, one Newton step on SO(3)) is taken only when it proves this itself; otherwise the answer
/// comes from [`signed_svd`].
///
/// `R` is unique unless `s_y + s_z = 0`; there it is `U V^T` of [`signed_svd`] with that function's
/// documented choices: the identity for the zero matrix, the smallest rotation from `v_1` to `u_1`
/// for rank one. A matrix with a non-finite entry gives NaN in every entry.
///
/// References: F. L. Markley, "Attitude determination using vector observations: a fast optimal
/// matrix algorithm" (1993), for the polynomial and the rotation; N. J. Higham, V. Noferini, "An
/// algorithm to compute the polar decomposition of a 3x3 matrix" (2016), for its conditioning.
#[inline]
pub fn polar_rotation(m: &Matrix3<f64>) -> Matrix3<f64> {
    match certified_rotation(m) {
        Some(rotation) => rotation,
        None => rotation_by_svd(m),
    }
}

#[cold]
#[inline(never)]
fn rotation_by_svd(m: &Matrix3<f64>) -> Matrix3<f64> {
    signed_svd(m).rotation()
}

/// The polar rotation by the fast path, or `None` when it cannot prove its own accuracy.
#[inline]
pub(crate) fn certified_rotation(m: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let norm2 = m.norm_squared();
    if !SAFE_NORM2.contains(&norm2) {
        return None;
    }
    let (guess, trace) = optimal_attitude(m, norm2);
    let rotation = newton_schulz(&guess)?;
    rotation_step(m, &rotation, trace)
}

/// Markley's FOAM: the polar rotation and `tr S = s_x + s_y + s_z`, both up to rounding amplified
/// by `|M| / (s_y + s_z)`.
///
/// `tr S` is the largest root of `(x^2 - |M|^2)^2 - 8 det(M) x - 4 |cof M|^2`, found by Newton's
/// method from above. (Laguerre's method takes fewer steps, but its square root makes it slower:
/// 149 against 128 ns for the whole rotation, no gain under inversion.)
#[inline(always)]
fn optimal_attitude(m: &Matrix3<f64>, norm2: f64) -> (Matrix3<f64>, f64) {
    let cof = cofactor(m);
    let det = m[(0, 0)] * cof[(0, 0)] + m[(0, 1)] * cof[(0, 1)] + m[(0, 2)] * cof[(0, 2)];
    let cof_norm2 = cof.norm_squared();
    let mut x = (norm2 + 2.0 * (3.0 * cof_norm2).sqrt()).sqrt();
    for _ in 0..MAX_ROOT_STEPS {
        let a = x * x - norm2;
        let step = (a * a - 8.0 * det * x - 4.0 * cof_norm2) / (4.0 * x * a - 8.0 * det);
        x -= step;
        if step.abs() <= ROOT_STEP * x {
            break;
        }
    }
    let scale = 1.0 / (0.5 * x * (x * x - norm2) - det);
    let cubic = mul(m, &tr_mul(m, m));
    let rotation = (m * (0.5 * (x * x + norm2)) + cof * x - cubic) * scale;
    (rotation, x)
}

/// One Newton-Schulz step `R (3 I - R^T R) / 2`; `None` when `R` is too far from a rotation for one
/// step to suffice.
#[inline(always)]
fn newton_schulz(r: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let defect = Matrix3::identity() - tr_mul(r, r);
    let proper = r.determinant() > 0.0;
    (defect.norm_squared() < DEFECT2 && proper).then(|| r + mul(r, &defect) * 0.5)
}

/// One Newton step on SO(3) towards a symmetric `R^T M`: `R (I + [w]_x)` with `(tr(S) I - S) w =
/// axial(R^T M)`; `None` when that is too far, or `tr(S) I - S` is not clearly positive definite.
#[inline(always)]
pub(crate) fn rotation_step(
    m: &Matrix3<f64>,
    r: &Matrix3<f64>,
    trace: f64,
) -> Option<Matrix3<f64>> {
    let b = tr_mul(r, m);
    let minors = Minors::of(&pair_sums(&symmetrize(&b)));
    let w = minors.adjugate * axial(&b) * (1.0 / minors.determinant);
    (minors.are_above(DEFINITE, trace) && w.norm_squared() < ANGLE2).then(|| r + mul_cross(r, &w))
}
