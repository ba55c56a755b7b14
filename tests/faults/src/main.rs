//! `cargo xtask faults`: ends trainings in every way from outside, and prints what came of it.

use std::process::ExitCode;

#[cfg(unix)]
fn main() -> ExitCode {
    myofield_faults::command::main()
}

#[cfg(not(unix))]
fn main() -> ExitCode {
    eprintln!("error: signals, limits and leave to write are those of unix: run this there");
    ExitCode::FAILURE
}
