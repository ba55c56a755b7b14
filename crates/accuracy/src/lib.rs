#![doc = include_str!("../README.md")]

pub mod choice;
pub mod draw;
mod error;
pub mod estimates;
mod kept;
pub mod manufactured;
pub mod recommend;
pub mod study;
pub mod subject;
pub mod table;
pub mod training;
pub mod transfer;

pub use error::{AccuracyError, Result};
