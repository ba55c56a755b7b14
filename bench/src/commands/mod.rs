//! One file per command.

pub mod body;
pub mod effects;
pub mod kernels;
pub mod methods;
pub mod roofline;
pub mod solid_box;
pub mod threads;
pub mod warm;
