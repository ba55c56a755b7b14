//! The inner loops of the fused point evaluation: matrix products and sine passes, compiled for several instruction sets.
//!
//! This is the crate's only module with unsafe code: calls of functions compiled for an instruction set that was detected
//! at run time, and the call of the matrix product on raw pointers after its bounds have been checked.
#![allow(unsafe_code)]

#[cfg(test)]
mod edges;
mod level;
mod product;
mod rows;
mod sine;

pub(crate) use level::Level;
pub use level::instruction_set;
pub(crate) use product::{MatrixView, Update, multiply};
pub(crate) use rows::{first_layer, scale_and_sum_rows, sine_cosine_rows, sine_rows};
