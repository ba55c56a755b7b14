//! Symmetric 3x3 matrices: eigenvalues, inverse, definiteness.

use crate::linear::cofactor;
use nalgebra::{Matrix3, Vector3};

/// Leading principal minors, which are positive exactly when the matrix is positive definite
/// (Sylvester), and the adjugate, which the inverse is made of.
pub(crate) struct Minors {
    pub(crate) first: f64,
    pub(crate) second: f64,
    pub(crate) determinant: f64,
    pub(crate) adjugate: Matrix3<f64>,
}

impl Minors {
    #[inline(always)]
    pub(crate) fn of(t: &Matrix3<f64>) -> Self {
        let adjugate = cofactor(t);
        let determinant = t[(0, 0)] * adjugate[(0, 0)]
            + t[(0, 1)] * adjugate[(0, 1)]
            + t[(0, 2)] * adjugate[(0, 2)];
        Self {
            first: t[(0, 0)],
            second: adjugate[(2, 2)],
            determinant,
            adjugate,
        }
    }

    /// Whether the matrix is positive definite with minors of order k above `margin * scale^k`;
    /// false for NaN.
    #[inline(always)]
    pub(crate) fn are_above(&self, margin: f64, scale: f64) -> bool {
        let scale2 = scale * scale;
        self.first > margin * scale
            && self.second > margin * scale2
            && self.determinant > margin * scale2 * scale
    }

    #[inline(always)]
    pub(crate) fn inverse(&self) -> Matrix3<f64> {
        self.adjugate * (1.0 / self.determinant)
    }
}

/// The sum of the two smallest eigenvalues of a symmetric matrix, to a few units in the last place
/// of its largest entry.
///
/// With the deviator `D = S - tr(S)/3 I`, the eigenvalues are `tr(S)/3 + 2 p cos(phi + 2 pi k /
/// 3)`, `p^2 = |D|^2 / 6`, `tan(3 phi) = sqrt(discriminant) / (sqrt(27) det D)`. The usual `acos`
/// loses half the digits at a double eigenvalue, because the discriminant `4 J_2^3 - 27 J_3^2`
/// cancels. Here it is the Gram determinant of `I`, `D` and `D^2`, which by Lagrange's identity is
/// a sum of squares, and the angle is well conditioned everywhere.
pub(crate) fn sum_of_two_smallest(s: &Matrix3<f64>) -> f64 {
    let trace = s.trace();
    let d = s - Matrix3::from_diagonal_element(trace / 3.0);
    let d2 = crate::linear::mul(&d, &d);
    let (x, y) = (deviatoric_coordinates(&d), deviatoric_coordinates(&d2));
    let mut gram = 0.0;
    for i in 0..5 {
        for j in 0..i {
            let minor = x[i] * y[j] - x[j] * y[i];
            gram += minor * minor;
        }
    }
    let p = (x.iter().map(|c| c * c).sum::<f64>() / 6.0).sqrt();
    let phi = (3.0 * gram).sqrt().atan2(27.0_f64.sqrt() * d.determinant()) / 3.0;
    2.0 / 3.0 * trace - 2.0 * p * phi.cos()
}

/// Coordinates of a symmetric matrix's deviator in an orthonormal basis (Frobenius inner product).
fn deviatoric_coordinates(x: &Matrix3<f64>) -> [f64; 5] {
    use std::f64::consts::{FRAC_1_SQRT_2, SQRT_2};
    let (a, b, c) = (x[(0, 0)], x[(1, 1)], x[(2, 2)]);
    let sixth = (1.0_f64 / 6.0).sqrt();
    [
        FRAC_1_SQRT_2 * (a - b),
        sixth * ((c - a) + (c - b)),
        SQRT_2 * x[(0, 1)],
        SQRT_2 * x[(0, 2)],
        SQRT_2 * x[(1, 2)],
    ]
}

/// Eigenvalues (unsorted) and eigenvectors (columns) of a symmetric matrix by cyclic Jacobi, to a
/// few units in the last place of the largest eigenvalue.
pub(crate) fn eigen(s: &Matrix3<f64>) -> (Vector3<f64>, Matrix3<f64>) {
    const MAX_SWEEPS: usize = 12;
    let (mut a, mut q) = (*s, Matrix3::identity());
    let negligible = f64::EPSILON * f64::EPSILON * s.norm_squared() / 16.0;
    for _ in 0..MAX_SWEEPS {
        let off = a[(0, 1)] * a[(0, 1)] + a[(0, 2)] * a[(0, 2)] + a[(1, 2)] * a[(1, 2)];
        if off <= negligible {
            break;
        }
        for (i, j, k) in [(0, 1, 2), (0, 2, 1), (1, 2, 0)] {
            annihilate(&mut a, &mut q, i, j, k);
        }
    }
    (a.diagonal(), q)
}

/// Rotates axes `i` and `j` so that entry `(i, j)` vanishes; `k` is the third axis.
#[inline(always)]
fn annihilate(a: &mut Matrix3<f64>, q: &mut Matrix3<f64>, i: usize, j: usize, k: usize) {
    let off = a[(i, j)];
    if off * off == 0.0 {
        return;
    }
    let JacobiRotation { cos, sin, tan } = JacobiRotation::new(a[(i, i)], a[(j, j)], off);
    a[(i, i)] -= tan * off;
    a[(j, j)] += tan * off;
    (a[(i, j)], a[(j, i)]) = (0.0, 0.0);
    let (x, y) = (a[(i, k)], a[(j, k)]);
    let (x, y) = (cos * x - sin * y, sin * x + cos * y);
    (a[(i, k)], a[(k, i)], a[(j, k)], a[(k, j)]) = (x, x, y, y);
    for r in 0..3 {
        let (x, y) = (q[(r, i)], q[(r, j)]);
        q[(r, i)] = cos * x - sin * y;
        q[(r, j)] = sin * x + cos * y;
    }
}

/// A relative eigenvalue below which a matrix counts as singular: about the square root of the
/// machine precision.
pub(crate) const SINGULAR: f64 = 1.0 / (1_u64 << 26) as f64;

/// The inverse `L^-1` of the Cholesky factor of a positive definite matrix `G = L L^T`; an almost
/// singular `G` is first raised by `SINGULAR` times its trace, so that `|L^-1|^2` does not amplify
/// rounding to more than about its square root.
pub(crate) fn inverse_cholesky_factor(g: &Matrix3<f64>) -> Matrix3<f64> {
    let trace = g.trace();
    let regular = (g / trace).determinant() > SINGULAR;
    let shift = if regular { 0.0 } else { SINGULAR * trace };
    let l_00 = (g[(0, 0)] + shift).sqrt();
    let l_10 = g[(1, 0)] / l_00;
    let l_20 = g[(2, 0)] / l_00;
    let l_11 = (g[(1, 1)] + shift - l_10 * l_10).sqrt();
    let l_21 = (g[(2, 1)] - l_20 * l_10) / l_11;
    let l_22 = (g[(2, 2)] + shift - l_20 * l_20 - l_21 * l_21).sqrt();
    let (i_00, i_11, i_22) = (1.0 / l_00, 1.0 / l_11, 1.0 / l_22);
    let i_10 = -l_10 * i_00 * i_11;
    let i_21 = -l_21 * i_11 * i_22;
    let i_20 = -(l_20 * i_00 + l_21 * i_10) * i_22;
    Matrix3::new(i_00, 0.0, 0.0, i_10, i_11, 0.0, i_20, i_21, i_22)
}

/// The plane rotation `[c s; -s c]` that diagonalises a symmetric 2x2 matrix.
pub(crate) struct JacobiRotation {
    pub(crate) cos: f64,
    pub(crate) sin: f64,
    pub(crate) tan: f64,
}

impl JacobiRotation {
    /// The smaller of the two rotations, at most an eighth of a turn; the square of `off` must not
    /// underflow to zero.
    #[inline(always)]
    pub(crate) fn new(first: f64, second: f64, off: f64) -> Self {
        let (difference, twice) = (second - first, 2.0 * off);
        let hypotenuse = (difference * difference + twice * twice).sqrt();
        let tan = twice / (difference + hypotenuse.copysign(difference));
        let cos = 1.0 / (1.0 + tan * tan).sqrt();
        Self {
            cos,
            sin: cos * tan,
            tan,
        }
    }
}
