//! Thin dispatcher.
fn main() {}
