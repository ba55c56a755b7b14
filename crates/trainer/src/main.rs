//! The program `myofield`.
fn main() {}
