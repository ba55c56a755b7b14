//! 3x3 signed SVD, polar rotation and its exact derivative, and the spectrum of shape-targeting
//! energies.
//!
//! Everything is `f64`, allocation-free and without state; no function fails or panics on bad data
//! (see each item for what it does with non-finite input).
//!
//! | item | computes |
//! |---|---|
//! | [`signed_svd`] | `M = U diag(s) V^T` with `U`, `V` in SO(3) and `s_x >= s_y >= abs(s_z)` |
//! | [`polar_rotation`], [`polar`] | the rotation `R = U V^T`, and the symmetric stretch `S = R^T M` |
//! | [`RotationGradient`] | `dR/dM` as one symmetric 3x3 factor |
//! | [`HessianCore`] | `C = d(F - R A)/dF`, its spectrum, and its two positive semi-definite filters |
//! | [`shape_targeting_energy`] and its gradients | `1/2 abs(F - R A)^2` with `R` the polar rotation of `F A` |
//! | [`actuation_vjp`] | the product with the mixed derivative that an implicit adjoint needs |
//!
//! # Conventions
//! `vec` is row-wise: `vec(M)[3 i + j] = M_ij`. `[w]_x` is the cross-product matrix, `[w]_x y = w x
//! y`, and `axial(X) = (X_32 - X_23, X_13 - X_31, X_21 - X_12)`, so that `X - X^T = [axial(X)]_x`.
//! A symmetric 3x3 matrix is given by the six entries `(11, 12, 13, 22, 23, 33)`.
//!
//! # Example
//! ```
//! use nalgebra::Matrix3;
//! use polar_grad::RotationGradient;
//!
//! let m = Matrix3::new(1.1, 0.2, 0.0, -0.1, 0.9, 0.3, 0.0, 0.1, 1.2);
//! let gradient = RotationGradient::at(&m);
//! // Stretching M along itself does not turn it.
//! assert!(gradient.apply(&m).norm() < 1e-15);
//! // A small turn of M turns R by as much.
//! let turn = nalgebra::Vector3::new(0.1, -0.2, 0.3).cross_matrix();
//! assert!((gradient.apply(&(turn * m)) - turn * gradient.rotation).norm() < 1e-15);
//! ```
#![forbid(unsafe_code)]

/// The example of the read-me compiles and runs.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

mod gradient;
mod hessian;
#[cfg(feature = "simd")]
pub mod lanes;
mod linear;
mod polar;
mod scaling;
mod shape_targeting;
mod svd;
mod symmetric;
#[cfg(any(test, feature = "testing"))]
pub mod testing;
#[cfg(test)]
mod tests;

pub use gradient::{PAIR_SUM_FLOOR, PAIR_SUM_MIN, RotationGradient};
pub use hessian::{Filter, HessianCore, Spectrum};
#[cfg(feature = "simd")]
pub use lanes::batch;
pub use polar::{Polar, polar, polar_rotation};
pub use shape_targeting::{
    actuation_from_b, actuation_vjp, shape_targeting_actuation_gradient, shape_targeting_energy,
    shape_targeting_gradient, symmetric_cotangent, symmetric_entries,
};
pub use svd::{SignedSvd, signed_svd};
