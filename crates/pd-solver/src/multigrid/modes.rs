//! The eight modes of a box element: products of -1 and 1 along its axes (constant, three linear, four hourglass).

use hex_mesh::{Quadrature, QuadratureRule, corner_offset};
use nalgebra::Vector3;

/// The modes that are linear along x, y and z.
pub(super) const LINEAR: [usize; 3] = [4, 2, 1];

/// The modes that change sign along two axes, by the axis along which they are constant.
pub(super) const BILINEAR: [usize; 3] = [3, 5, 6];

/// The mode that changes sign along all three.
pub(super) const TRILINEAR: usize = 7;

/// Means over an element, with coordinates in [-1, 1], of the square of a coordinate and of the square of the product of two.
pub(super) const MEAN_SQUARES: [f64; 2] = [1.0 / 3.0, 1.0 / 9.0];

/// Value of a mode at a corner: bit `a` of the mode says whether it changes sign along axis `a`, x being the highest bit.
pub(super) fn sign(mode: usize, corner: usize) -> f64 {
    let offset = corner_offset(corner);
    (0..3)
        .filter(|&a| mode & LINEAR[a] != 0)
        .map(|a| 2.0 * offset[a] as f64 - 1.0)
        .product()
}

/// Stiffness of each mode's coefficient `sum_n sign_n x_n`, for a box of unit stiffness times volume: the constant matrix of
/// full integration is `sum_m stiffness_m sign_m sign_m^T`.
pub(super) fn stiffness(size: &Vector3<f64>) -> [f64; 8] {
    let rule = QuadratureRule::new(Quadrature::Eight);
    let gradients = rule.gradients(1.0);
    std::array::from_fn(|mode| {
        let energy: f64 = gradients
            .iter()
            .zip(&rule.weights)
            .map(|(at, weight)| {
                let slope: Vector3<f64> = (0..8).map(|n| at[n] * sign(mode, n)).sum();
                weight * slope.component_div(size).norm_squared()
            })
            .sum();
        energy / 64.0
    })
}
