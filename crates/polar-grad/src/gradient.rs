//! The derivative of the polar rotation.

use crate::linear::{axial, conjugate, mul_cross, pair_sums, symmetrize, tr_mul};
use crate::polar::certified_rotation;
use crate::scaling::Scaling;
use crate::svd::svd_of_scaled;
use crate::symmetric::{Minors, sum_of_two_smallest};
use nalgebra::{Matrix3, SMatrix, Vector3};

/// Sums `s_i + s_j` below this fraction of `s_x` are raised to it where they are divided by: 2^-40.
/// The sums themselves are known to about 2^-51 of `s_x`.
pub const PAIR_SUM_FLOOR: f64 = 1.0 / (1_u64 << 40) as f64;

/// Sums `s_i + s_j` below this are raised to it where they are divided by, so that the derivative
/// at the zero matrix is finite: 2^-511.
pub const PAIR_SUM_MIN: f64 = f64::from_bits((1023 - 511) << 52);

/// Minors of `tr(S) I - S` above this fraction of `(tr S)^k` make its inverse by cofactors accurate
/// to about 1e-13.
const WELL_CONDITIONED: f64 = 1e-3;

/// The polar rotation `R` of `M = R S` and its derivative, `dR = R [B axial(R^T dM)]_x` with `B =
/// (tr(S) I - S)^-1`.
///
/// Differentiating `M = R S` with `dR = R [w]_x` gives `R^T dM - dM^T R = [w]_x S + S [w]_x =
/// [(tr(S) I - S) w]_x`. The eigenvalues of `tr(S) I - S` are the sums `s_i + s_j` of signed
/// singular values, so the derivative is finite and smooth at rest, at equal singular values and
/// under inversion, where derivatives of the singular vectors are not; it is singular only where
/// `s_y + s_z = 0` and `R` itself jumps.
///
/// References: T. Kim, D. Eberle, "Dynamic deformables" (SIGGRAPH course, 2020/2022), the rotation
/// gradient.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RotationGradient {
    /// The polar rotation `R`, equal to [`crate::polar_rotation`] to the last bit.
    pub rotation: Matrix3<f64>,
    /// `B`, symmetric, of unit `1/M`: the inverse of [`Self::pair_sums`].
    pub factor: Matrix3<f64>,
    /// `tr(S) I - S`, symmetric positive definite: its eigenvalues are `s_i + s_j`, raised to at
    /// least [`PAIR_SUM_FLOOR`] times `s_x` and at least [`PAIR_SUM_MIN`]. One that exceeds `f64::MAX` is that here, though not in
    /// [`Self::factor`].
    pub pair_sums: Matrix3<f64>,
    /// `s_y + s_z >= 0`, the distance to where `R` is not unique, as it is (not raised).
    pub smallest_pair_sum: f64,
}

impl RotationGradient {
    /// The rotation and its derivative at `m`; finite for every finite `m` (NaN in every entry
    /// otherwise).
    pub fn at(m: &Matrix3<f64>) -> Self {
        let certified = certified_rotation(m);
        match certified.and_then(|rotation| Self::well_conditioned(m, rotation)) {
            Some(gradient) => gradient,
            None => Self::by_svd(m, certified),
        }
    }

    /// The derivative from a known rotation, or `None` near `s_y + s_z = 0`.
    #[inline]
    pub(crate) fn well_conditioned(m: &Matrix3<f64>, rotation: Matrix3<f64>) -> Option<Self> {
        let stretch = symmetrize(&tr_mul(&rotation, m));
        let pair_sums = pair_sums(&stretch);
        let minors = Minors::of(&pair_sums);
        minors
            .are_above(WELL_CONDITIONED, stretch.trace())
            .then(|| Self {
                rotation,
                factor: minors.inverse(),
                pair_sums,
                smallest_pair_sum: sum_of_two_smallest(&stretch),
            })
    }

    /// The derivative from the signed SVD, with the floors applied; the rotation is the certified
    /// one where there is one, so that it equals that of [`crate::polar_rotation`] to the last bit.
    #[cold]
    #[inline(never)]
    fn by_svd(m: &Matrix3<f64>, certified: Option<Matrix3<f64>>) -> Self {
        let Some((scaling, scaled)) = Scaling::to_unit(m) else {
            return Self::not_a_number();
        };
        let svd = svd_of_scaled(&scaled);
        let s = svd.sigma;
        let floor = (PAIR_SUM_FLOOR * s.x).max(PAIR_SUM_MIN * scaling.down);
        let sums = Vector3::new(s.y + s.z, s.x + s.z, s.x + s.y);
        let raised = sums.map(|x| x.max(floor));
        // Eigenvalues, not entries, are what must not exceed the largest number: the matrix stays definite.
        let finite = raised.map(|x| x.min(f64::MAX * scaling.down));
        Self {
            rotation: certified.unwrap_or_else(|| svd.rotation()),
            factor: conjugate(&svd.v, &raised.map(|x| 1.0 / x)) * scaling.down,
            pair_sums: conjugate(&svd.v, &finite).map(|x| scaling.restore(x)),
            smallest_pair_sum: scaling.restore(sums.x),
        }
    }

    fn not_a_number() -> Self {
        let nan = Matrix3::repeat(f64::NAN);
        Self {
            rotation: nan,
            factor: nan,
            pair_sums: nan,
            smallest_pair_sum: f64::NAN,
        }
    }

    /// The tangent `dR = R [B axial(R^T dM)]_x` for the tangent `d_m` of `M`.
    ///
    /// The map is symmetric in the Frobenius inner product, so this is also its vector-Jacobian
    /// product.
    pub fn apply(&self, d_m: &Matrix3<f64>) -> Matrix3<f64> {
        mul_cross(
            &self.rotation,
            &(self.factor * axial(&tr_mul(&self.rotation, d_m))),
        )
    }

    /// The 9x9 matrix `H_R = d vec(R) / d vec(M)` in row-wise `vec`, symmetric positive
    /// semi-definite of rank three.
    pub fn to_matrix(&self) -> SMatrix<f64, 9, 9> {
        let z = cross_basis(&self.rotation, &Matrix3::identity());
        z * self.factor * z.transpose()
    }
}

/// The 9x3 matrix with columns `vec(R [e_k]_x A)`.
pub(crate) fn cross_basis(rotation: &Matrix3<f64>, a: &Matrix3<f64>) -> SMatrix<f64, 9, 3> {
    let blocks = [Vector3::x(), Vector3::y(), Vector3::z()].map(|e| mul_cross(rotation, &e) * a);
    SMatrix::from_fn(|row, k| blocks[k][(row / 3, row % 3)])
}
