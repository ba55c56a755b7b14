//! Modulated SIREN networks that map a shape descriptor and a point to an actuation, with a fused kernel and exact gradients.
//!
//! One network holds three parts (Yang et al. 2022, supplement 10.3):
//! * an encoder, shape descriptor (basis weights) -> latent code `z`;
//! * the actuation field `N_A`, a point `x` in `[-1, 1]^3` -> six entries `b`, by four modulated SIREN layers
//!   `h' = sin(omega W diag(1 + a(z)) h + b)` with `a` affine, and a linear head;
//! * the bone network `N_B`, `z` -> the five numbers of the mandible joint.
//!
//! The actuation is `A = I + sym(b)` with `b` in the order 11, 12, 13, 22, 23, 33.
//!
//! ```
//! use actuation_net::{ActuationNet, NetworkConfig, Width};
//!
//! # fn main() -> Result<(), actuation_net::Error> {
//! let net = ActuationNet::new(&NetworkConfig::new(3, Width::W64), 1)?;
//! let points = [0.0, 0.5, -0.5, 0.25, 0.25, 0.25];
//! let traced = net.trace(&[1.0, 0.0, 0.2], &points)?;
//! assert_eq!(traced.output().actuation.len(), 2 * 6);
//! // Whatever comes between (a physics solver, a loss) hands back the cotangent of the output.
//! let gradient = traced.backward(&[1.0; 12], &[0.0; 5]);
//! assert_eq!(gradient.len(), net.parameter_count());
//! # Ok(())
//! # }
//! ```
//!
//! [`ExplicitDecoder`] is what the field is compared with: encoder and bone network are the same, but fully connected layers give the
//! actuation of all elements of one grid at once.
//!
//! Results are the same bit for bit for every number of threads on one kind of processor; another instruction set
//! (see [`instruction_set`]) rounds differently.

mod adam;
mod config;
mod decoder;
mod error;
mod field;
mod kernel;
mod layout;
mod model;
mod net;
mod plain;
mod tensor_file;
mod weights;

pub use adam::{Adam, AdamState};
pub use config::{NetworkConfig, ResolutionRange, Width};
pub use decoder::{DecoderConfig, ExplicitDecoder, TracedDecoder};
pub use error::Error;
pub use kernel::instruction_set;
pub use layout::ParameterTensor;
pub use net::{ActuationNet, LatentTrace, Output, OutputCotangent, Traced};
pub use plain::{PlainNet, Real};
pub use tensor_file::TensorFile;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct ReadmeExample;

/// Entries of the actuation per point: `b` in the order 11, 12, 13, 22, 23, 33.
pub const ACTUATION_SIZE: usize = 6;

/// Entries of the mandible joint: `theta_x, theta_y, t_x, t_y, t_z`.
pub const JOINT_SIZE: usize = 5;
