//! The program from the outside, on boxes so small that they take no time.

mod bad_options;
mod common;
mod machine;
mod solves;
