//! The derivative of the polar rotation of every lane.

use nalgebra::Matrix3;
use polar_grad::RotationGradient;
use polar_grad::lanes::{LaneMatrix, transposed_product};
use pulp::Simd;

/// Minors of T above this fraction of `(tr S)^k` make its inverse by cofactors accurate to about 1e-13.
const WELL_CONDITIONED: f64 = 1e-3;

/// The derivative of the rotation, lane by lane; symmetric matrices by their entries 00, 01, 02, 11, 12, 22.
pub(super) struct RotationFactor<S: Simd> {
    /// `B = T^-1`: `dR = R [B axial(R^T dM)]_x`.
    pub(super) factor: [S::f64s; 6],
}

/// B of every lane, with `T = tr(S) I - S` and `S = R^T M`. A lane whose T is near singular is done by the scalar function, which
/// raises what it divides by.
#[inline(always)]
pub(super) fn rotation_factor_lanes<S: Simd>(
    simd: S,
    rotation: &LaneMatrix<S>,
    m: &LaneMatrix<S>,
) -> RotationFactor<S> {
    let b = transposed_product(simd, rotation, m);
    let half = simd.splat_f64s(-0.5);
    let t = [
        simd.add_f64s(b[4], b[8]),
        simd.mul_f64s(half, simd.add_f64s(b[1], b[3])),
        simd.mul_f64s(half, simd.add_f64s(b[2], b[6])),
        simd.add_f64s(b[0], b[8]),
        simd.mul_f64s(half, simd.add_f64s(b[5], b[7])),
        simd.add_f64s(b[0], b[4]),
    ];
    let mut factor = [
        minor(simd, t[3], t[5], t[4], t[4]),
        minor(simd, t[2], t[4], t[1], t[5]),
        minor(simd, t[1], t[4], t[2], t[3]),
        minor(simd, t[0], t[5], t[2], t[2]),
        minor(simd, t[1], t[2], t[0], t[4]),
        minor(simd, t[0], t[3], t[1], t[1]),
    ];
    let mut determinant = simd.mul_f64s(t[0], factor[0]);
    determinant = simd.mul_add_e_f64s(t[1], factor[1], determinant);
    determinant = simd.mul_add_e_f64s(t[2], factor[2], determinant);
    let trace = simd.add_f64s(b[0], simd.add_f64s(b[4], b[8]));
    let bound = simd.mul_f64s(trace, simd.splat_f64s(WELL_CONDITIONED));
    let bound2 = simd.mul_f64s(bound, trace);
    let bound3 = simd.mul_f64s(bound2, trace);
    let well = simd.and_m64s(
        simd.less_than_f64s(bound, t[0]),
        simd.and_m64s(
            simd.less_than_f64s(bound2, factor[5]),
            simd.less_than_f64s(bound3, determinant),
        ),
    );
    let inverse = simd.div_f64s(simd.splat_f64s(1.0), determinant);
    for entry in &mut factor {
        *entry = simd.mul_f64s(*entry, inverse);
    }
    if simd.first_true_m64s(simd.not_m64s(well)) != S::F64_LANES {
        factor = again(simd, m, factor, well);
    }
    RotationFactor { factor }
}

/// `a b - c d`.
#[inline(always)]
fn minor<S: Simd>(simd: S, a: S::f64s, b: S::f64s, c: S::f64s, d: S::f64s) -> S::f64s {
    simd.negate_mul_add_e_f64s(c, d, simd.mul_f64s(a, b))
}

/// Does the lanes that are not `well` by the scalar function.
#[cold]
#[inline(never)]
fn again<S: Simd>(
    simd: S,
    m: &LaneMatrix<S>,
    mut factor: [S::f64s; 6],
    well: S::m64s,
) -> [S::f64s; 6] {
    const PLACES: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
    let flags = simd.select_f64s(well, simd.splat_f64s(1.0), simd.splat_f64s(0.0));
    let lane = |v: &S::f64s, i: usize| {
        pulp::bytemuck::cast_slice::<S::f64s, f64>(std::slice::from_ref(v))[i]
    };
    for i in 0..S::F64_LANES {
        if lane(&flags, i) != 0.0 {
            continue;
        }
        let m = Matrix3::from_fn(|row, column| lane(&m[3 * row + column], i));
        let b = RotationGradient::at(&m).factor;
        for (out, place) in factor.iter_mut().zip(PLACES) {
            let lanes: &mut [f64] = pulp::bytemuck::cast_slice_mut(std::slice::from_mut(out));
            lanes[i] = b[place];
        }
    }
    factor
}
