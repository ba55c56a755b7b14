//! Signed (rotation-variant) SVD by one-sided Jacobi.

use crate::linear::{conjugate, mul_tr};
use crate::scaling::Scaling;
use crate::symmetric::JacobiRotation;
use nalgebra::{Matrix3, Vector3};

/// Columns count as orthogonal when their cosine is below this; the rounding of the dot product
/// itself is 3 * 2^-53.
const ORTHOGONAL: f64 = 1.0 / (1_u64 << 51) as f64;
/// Quadratic convergence needs three to five sweeps; the bound only ends loops on numbers at the
/// underflow limit.
const MAX_SWEEPS: usize = 12;

/// The signed singular value decomposition `M = U diag(sigma) V^T` of a 3x3 matrix.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SignedSvd {
    /// Left singular vectors, a rotation (`det U = +1`).
    pub u: Matrix3<f64>,
    /// Singular values, `sigma.x >= sigma.y >= |sigma.z|`; `sigma.z` carries the sign of `det M`.
    pub sigma: Vector3<f64>,
    /// Right singular vectors, a rotation (`det V = +1`).
    pub v: Matrix3<f64>,
}

impl SignedSvd {
    /// The rotation `R = U V^T` of the polar decomposition.
    pub fn rotation(&self) -> Matrix3<f64> {
        mul_tr(&self.u, &self.v)
    }

    /// The symmetric stretch `S = V diag(sigma) V^T` of the polar decomposition `M = R S`.
    pub fn stretch(&self) -> Matrix3<f64> {
        conjugate(&self.v, &self.sigma)
    }

    fn not_a_number() -> Self {
        let nan = Matrix3::repeat(f64::NAN);
        Self {
            u: nan,
            sigma: Vector3::repeat(f64::NAN),
            v: nan,
        }
    }
}

/// The signed SVD of any finite matrix: `U` and `V` are rotations, the last singular value carries
/// the sign of `det M`.
///
/// One-sided Jacobi on the columns of `M`, scaled by a power of two: `U`, `V` are orthogonal and `U
/// diag(sigma) V^T = M` to a few units in the last place of the largest singular value, for every
/// rank, at every tie and from denormal entries to entries near overflow. (A singular value that
/// exceeds `f64::MAX` is returned as `f64::MAX`.)
///
/// Where the decomposition is not unique the result is still a deterministic function of the
/// entries: columns that are already orthogonal are only sorted, stably, so that `V` is a signed
/// permutation (`V = I` for a rotation, a multiple of one, and the zero matrix); for rank one `U
/// V^T` is the smallest rotation that turns `v_1` to `u_1`; for the zero matrix `U = V = I`.
///
/// A matrix with a non-finite entry gives NaN in every entry of the result.
///
/// Reference: J. Demmel, K. Veselic, "Jacobi's method is more accurate than QR", SIAM J. Matrix
/// Anal. Appl. 13 (1992); the sign convention is that of G. Irving, J. Teran, R. Fedkiw,
/// "Invertible finite elements for robust simulation of large deformation" (2004).
pub fn signed_svd(m: &Matrix3<f64>) -> SignedSvd {
    let Some((scaling, scaled)) = Scaling::to_unit(m) else {
        return SignedSvd::not_a_number();
    };
    let svd = svd_of_scaled(&scaled);
    SignedSvd {
        sigma: svd.sigma.map(|s| scaling.restore(s)),
        ..svd
    }
}

/// The signed SVD of a matrix whose largest entry is about one, or zero.
pub(crate) fn svd_of_scaled(m: &Matrix3<f64>) -> SignedSvd {
    let mut columns = [0, 1, 2].map(|j| Column {
        image: m.column(j).into(),
        axis: Matrix3::identity().column(j).into(),
    });
    for _ in 0..MAX_SWEEPS {
        let mut rotated = false;
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            rotated |= orthogonalise(&mut columns, p, q);
        }
        if !rotated {
            break;
        }
    }
    let v = Matrix3::from_columns(&columns.map(|c| c.axis));
    let (u, sigma) = left_factor(columns);
    SignedSvd { u, sigma, v }
}

/// A column of `V` and its image, the same column of `M V`.
#[derive(Clone, Copy)]
struct Column {
    image: Vector3<f64>,
    axis: Vector3<f64>,
}

impl Column {
    fn combine(a: f64, x: &Self, b: f64, y: &Self) -> Self {
        Self {
            image: x.image * a + y.image * b,
            axis: x.axis * a + y.axis * b,
        }
    }
}

/// Sorts columns `p < q` by length and makes their images orthogonal; true when that changed
/// anything.
#[inline(always)]
fn orthogonalise(columns: &mut [Column; 3], p: usize, q: usize) -> bool {
    let norms2 = [p, q].map(|j| columns[j].image.norm_squared());
    let unsorted = norms2[1] > norms2[0];
    if unsorted {
        // A quarter turn, so that V stays a rotation.
        let longer = columns[q];
        columns[q] = Column {
            image: -columns[p].image,
            axis: -columns[p].axis,
        };
        columns[p] = longer;
    }
    let (longer2, shorter2) = (norms2[0].max(norms2[1]), norms2[0].min(norms2[1]));
    let dot = columns[p].image.dot(&columns[q].image);
    if dot * dot <= ORTHOGONAL * ORTHOGONAL * longer2 * shorter2 {
        return unsorted;
    }
    let JacobiRotation { cos, sin, .. } = JacobiRotation::new(longer2, shorter2, dot);
    let (x, y) = (columns[p], columns[q]);
    columns[p] = Column::combine(cos, &x, -sin, &y);
    columns[q] = Column::combine(sin, &x, cos, &y);
    true
}

/// `U` and the singular values from orthogonal images sorted by length.
fn left_factor([x, y, z]: [Column; 3]) -> (Matrix3<f64>, Vector3<f64>) {
    let x_norm = x.image.norm();
    if x_norm == 0.0 {
        return (Matrix3::identity(), Vector3::zeros());
    }
    let u_x = x.image / x_norm;
    let u_y = second_left_vector(&u_x, &y.image).unwrap_or_else(|| carried(&u_x, &x.axis, &y.axis));
    let u_z = u_x.cross(&u_y);
    // The comparisons hold in exact arithmetic; the last bit must not break what is promised.
    let s_y = u_y.dot(&y.image).clamp(0.0, x_norm);
    let s_z = u_z.dot(&z.image).clamp(-s_y, s_y);
    (
        Matrix3::from_columns(&[u_x, u_y, u_z]),
        Vector3::new(x_norm, s_y, s_z),
    )
}

/// The unit vector along `y` made orthogonal to `u_x`; `None` when `y` is zero, or so small that
/// its direction was lost to underflow.
fn second_left_vector(u_x: &Vector3<f64>, y: &Vector3<f64>) -> Option<Vector3<f64>> {
    let largest = y.amax();
    if largest < f64::MIN_POSITIVE {
        return None;
    }
    let y = (y / largest).normalize();
    let residual = y - u_x * u_x.dot(&y);
    let norm = residual.norm();
    (norm > 0.5).then(|| residual / norm)
}

/// Where the smallest rotation that takes `v_x` to `u_x` takes `v_y`; a half turn about `v_y` when
/// `u_x = -v_x`.
fn carried(u_x: &Vector3<f64>, v_x: &Vector3<f64>, v_y: &Vector3<f64>) -> Vector3<f64> {
    let sum = u_x + v_x;
    let norm2 = sum.norm_squared();
    let turned = if norm2 > 1e-12 {
        v_y - sum * (2.0 * u_x.dot(v_y) / norm2)
    } else {
        *v_y
    };
    (turned - u_x * u_x.dot(&turned)).normalize()
}
