//! Hostile input for every reader of the workspace.
//!
//! A [`Target`] is a reader: [`targets()`] lists those that user files reach. Inputs are made, not guided: [`Source`] either builds a file of
//! the target's format with values replaced one by one ([`formats`]), or takes a seed file, and then damages bytes ([`damage`]). Nothing
//! measures which code an input reaches, as that needs a nightly compiler or a C++ one; the share of accepted inputs and the number of
//! different outcomes tell whether inputs get anywhere. Input number `i` of a seed depends on nothing that was run before, so any can be made again.
//!
//! [`watch::execute`] runs a reader on an input and tells a panic, a second of waiting, or memory beyond [`Target::allowance`].

pub mod budget;
pub mod damage;
pub mod formats;
pub mod shrink;
pub mod targets;
pub mod watch;

pub use targets::{Outcome, Source, Target, targets};

/// Where the inputs lie that once did harm, in a folder for each target; they begin the seeds of every run and are replayed by the tests.
pub fn corpus() -> &'static std::path::Path {
    std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/corpus"))
}
