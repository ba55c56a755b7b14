//! Trilinear shape functions of the unit cube.
//!
//! Corner `c = 4 a + 2 b + c'` sits at `(a, b, c')` in `{0, 1}^3`: x slowest, z fastest.

use nalgebra::Vector3;

/// Position of corner `corner` in the unit cube, as 0 or 1 along each axis.
///
/// # Panics
/// When `corner` is above 7.
#[must_use]
pub const fn corner_offset(corner: usize) -> [usize; 3] {
    assert!(corner < 8, "a cube has corners 0 to 7");
    [corner >> 2 & 1, corner >> 1 & 1, corner & 1]
}

/// The two linear shape functions along one axis: `[1 - x, x]`.
fn linear(x: f64) -> [f64; 2] {
    [1.0 - x, x]
}

/// Trilinear weights `N_c(xi)` of the eight corners at `xi`, in cube coordinates (the cube is `[0, 1]^3`).
///
/// They sum to 1 everywhere; outside the cube they extrapolate, and some are negative.
#[must_use]
pub fn trilinear_weights(xi: &Vector3<f64>) -> [f64; 8] {
    let [x, y, z] = [linear(xi.x), linear(xi.y), linear(xi.z)];
    std::array::from_fn(|corner| {
        let [a, b, c] = corner_offset(corner);
        x[a] * y[b] * z[c]
    })
}

/// Gradients `dN_c / d xi` of the eight corner weights at `xi`, in cube coordinates.
///
/// Divide by the edge length for gradients in space.
#[must_use]
pub fn trilinear_gradients(xi: &Vector3<f64>) -> [Vector3<f64>; 8] {
    const SLOPE: [f64; 2] = [-1.0, 1.0];
    let [x, y, z] = [linear(xi.x), linear(xi.y), linear(xi.z)];
    std::array::from_fn(|corner| {
        let [a, b, c] = corner_offset(corner);
        Vector3::new(
            SLOPE[a] * y[b] * z[c],
            x[a] * SLOPE[b] * z[c],
            x[a] * y[b] * SLOPE[c],
        )
    })
}
