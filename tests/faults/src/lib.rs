//! What may end a training from outside, at any moment: kill -9, a full disk, a folder that becomes read-only, a limit on the size of
//! files, a second training in the same folder. Each is done to a small scene again and again; the run is then resumed, and has to end
//! with the bytes of one undisturbed. What is asked of a trained run is killed too, and asked again.
//!
//! `cargo xtask faults` runs all of it and prints a table; the tests of this package run a little of each.
#![cfg(unix)]

pub mod asked;
pub mod command;
pub mod disk;
pub mod kills;
pub mod leave;
pub mod limit;
pub mod same;
pub mod second;
pub mod setting;
pub mod state;

/// What went wrong, for people; a run that differs names its first differences.
pub type Result<T> = std::result::Result<T, String>;

/// What came of one kind of fault.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Verdict {
    /// It was done, all runs ended with the same bytes, and this is what was met on the way.
    Held(String),
    /// This machine or this user cannot do it, for this reason.
    Skipped(String),
}
