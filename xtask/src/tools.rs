//! Subcommands of cargo that are not part of it: installed once, where they are missing.

use std::process::{Command, Stdio};

/// Installs `cargo-SUBCOMMAND` where it is missing; an error says what to do by hand.
pub fn prepare(subcommand: &str) -> Result<(), String> {
    if is_there(subcommand) {
        return Ok(());
    }
    let name = format!("cargo-{subcommand}");
    eprintln!("installing {name}, once");
    if succeeds("cargo", &["install", "--locked", &name]) {
        return Ok(());
    }
    Err(format!(
        "{name} is missing and could not be installed: `cargo install --locked {name}`"
    ))
}

fn is_there(subcommand: &str) -> bool {
    let mut command = Command::new("cargo");
    command.args([subcommand, "--version"]);
    command.stdout(Stdio::null()).stderr(Stdio::null());
    command.status().is_ok_and(|status| status.success())
}

/// Whether a program ends well.
pub fn succeeds(program: &str, arguments: &[&str]) -> bool {
    let status = Command::new(program).args(arguments).status();
    status.is_ok_and(|status| status.success())
}
