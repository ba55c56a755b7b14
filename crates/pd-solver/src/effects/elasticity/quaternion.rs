//! Rotations as unit quaternions `(w, x, y, z)`: four numbers to keep in memory instead of nine. Hessian products wait for memory,
//! not for arithmetic.

use polar_grad::lanes::LaneMatrix;
use pulp::Simd;

/// A quaternion per lane.
pub(super) type QuaternionLanes<S> = [<S as Simd>::f64s; 4];

/// The unit quaternion of every rotation, up to its sign.
///
/// The columns of `4 q q^T` are sums of the entries of R; that of the largest diagonal entry, at least 1, has no cancellation
/// (Shepperd 1978).
#[inline(always)]
pub(super) fn quaternion_of<S: Simd>(simd: S, r: &LaneMatrix<S>) -> QuaternionLanes<S> {
    let one = simd.splat_f64s(1.0);
    let add = [
        simd.add_f64s(r[7], r[5]),
        simd.add_f64s(r[2], r[6]),
        simd.add_f64s(r[3], r[1]),
    ];
    let sub = [
        simd.sub_f64s(r[7], r[5]),
        simd.sub_f64s(r[2], r[6]),
        simd.sub_f64s(r[3], r[1]),
    ];
    let (up, down) = (simd.add_f64s(one, r[0]), simd.sub_f64s(one, r[0]));
    let (sum, difference) = (simd.add_f64s(r[4], r[8]), simd.sub_f64s(r[4], r[8]));
    let diagonal = [
        simd.add_f64s(up, sum),
        simd.sub_f64s(up, sum),
        simd.add_f64s(down, difference),
        simd.sub_f64s(down, difference),
    ];
    let columns = [
        [sub[0], diagonal[1], add[2], add[1]],
        [sub[1], add[2], diagonal[2], add[0]],
        [sub[2], add[1], add[0], diagonal[3]],
    ];
    let mut best = diagonal[0];
    let mut q = [diagonal[0], sub[0], sub[1], sub[2]];
    for (column, diagonal) in columns.iter().zip(&diagonal[1..]) {
        let larger = simd.less_than_f64s(best, *diagonal);
        best = simd.select_f64s(larger, *diagonal, best);
        for (q, x) in q.iter_mut().zip(column) {
            *q = simd.select_f64s(larger, *x, *q);
        }
    }
    let mut square = simd.mul_f64s(q[0], q[0]);
    for x in &q[1..] {
        square = simd.mul_add_e_f64s(*x, *x, square);
    }
    let inverse = simd.div_f64s(one, simd.sqrt_f64s(square));
    for x in &mut q {
        *x = simd.mul_f64s(*x, inverse);
    }
    q
}

/// The rotation of every unit quaternion.
#[inline(always)]
pub(super) fn rotation_of<S: Simd>(simd: S, q: &QuaternionLanes<S>) -> LaneMatrix<S> {
    let one = simd.splat_f64s(1.0);
    let [w, x, y, z] = *q;
    let (x2, y2, z2) = (
        simd.add_f64s(x, x),
        simd.add_f64s(y, y),
        simd.add_f64s(z, z),
    );
    let (xy, xz, yz) = (
        simd.mul_f64s(x, y2),
        simd.mul_f64s(x, z2),
        simd.mul_f64s(y, z2),
    );
    let without_x = simd.negate_mul_add_e_f64s(x, x2, one);
    let without_y = simd.negate_mul_add_e_f64s(y, y2, one);
    [
        simd.negate_mul_add_e_f64s(z, z2, without_y),
        simd.negate_mul_add_e_f64s(w, z2, xy),
        simd.mul_add_e_f64s(w, y2, xz),
        simd.mul_add_e_f64s(w, z2, xy),
        simd.negate_mul_add_e_f64s(z, z2, without_x),
        simd.negate_mul_add_e_f64s(w, x2, yz),
        simd.negate_mul_add_e_f64s(w, y2, xz),
        simd.mul_add_e_f64s(w, x2, yz),
        simd.negate_mul_add_e_f64s(y, y2, without_x),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Rotation3, Unit, Vector3};
    use pulp::Scalar;

    /// There and back, for small turns, turns about every axis, and half turns, where one column after the other vanishes.
    #[test]
    fn rotations_survive() {
        let angles = [
            0.0,
            1e-9,
            1e-3,
            1.0,
            2.0,
            3.0,
            std::f64::consts::PI - 1e-6,
            std::f64::consts::PI,
        ];
        for axis in 0..27 {
            let axis =
                Vector3::from([axis / 9, axis / 3 % 3, axis % 3].map(|i| f64::from(i) - 1.0));
            for angle in angles {
                if axis == Vector3::zeros() {
                    continue;
                }
                let r = Rotation3::from_axis_angle(&Unit::new_normalize(axis), angle).into_inner();
                let rows: [f64; 9] = std::array::from_fn(|k| r[(k / 3, k % 3)]);
                let back = rotation_of(Scalar, &quaternion_of(Scalar, &rows));
                let error = (Matrix3::from_row_slice(&back) - r).norm();
                assert!(error < 2e-15, "{axis} {angle} {error:e}");
            }
        }
    }
}
