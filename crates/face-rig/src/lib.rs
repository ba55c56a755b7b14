//! Mandible joint with derivatives, and blendshape weights by bounded least squares.
//!
//! Two independent tools a face needs before and beside its soft tissue:
//!
//! - [`Joint`] turns five parameters (two rotations, three translations) into the rigid motion of the jaw, with exact
//!   products for gradients, a global fit to observed motion, and a pivot estimated from several motions.
//! - [`BlendBasis`] describes a deformed surface by the weights of known shapes, each weight kept inside its bounds.
//!
//! ```
//! use face_rig::{BlendBasis, Bounds, Joint};
//! use nalgebra::Vector3;
//!
//! let joint = Joint::new(Vector3::new(0.0, 1.0, -2.0));
//! let chin = [Vector3::new(0.0, -4.0, 6.0)];
//! let opened = joint.positions([0.3, 0.0, 0.0, 0.0, 0.2], &chin);
//! assert!(opened[0].y < chin[0].y);
//!
//! let smile = vec![Vector3::x(), Vector3::zeros()];
//! let frown = vec![Vector3::zeros(), Vector3::y()];
//! let basis = BlendBasis::new(vec![smile, frown])?;
//! let target = [Vector3::x() * 0.5, Vector3::y() * 3.0];
//! let fit = basis.fit(&target, &Bounds::uniform(2, 0.0, 1.0), 0.0)?;
//! assert!((fit.weights[0] - 0.5).abs() < 1e-9 && fit.weights[1] == 1.0);
//! # Ok::<(), face_rig::RigError>(())
//! ```

/// Compiles the example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

mod active_set;
mod blend;
mod choice;
mod error;
mod joint;
mod joint_fit;

pub use active_set::Activity;
pub use blend::{BlendBasis, BlendFit, Bounds, RIDGE};
pub use choice::BasisChoice;
pub use error::RigError;
pub use joint::{Joint, JointParameters};
pub use joint_fit::{JointFit, MotionFit, PivotFit};
