#![doc = include_str!("../README.md")]

pub mod actuation;
mod body;
mod error;
mod improve;
mod nets;
mod pose;
mod shape;
mod starfish;

pub use body::StarfishBody;
pub use error::ShapeError;
pub use pose::{ArmPose, StarfishPose, held_radius, pose};
pub use shape::StarfishShape;
pub use starfish::starfish;
