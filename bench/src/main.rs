//! The program that `cargo xtask bench` starts: whole solves, kernels and the machine itself, measured into tables and JSON.

mod case;
mod child;
mod commands;
mod error;
mod files;
mod lanes;
mod lists;
mod measure;
mod options;
mod system;
mod table;
mod timing;

use clap::{Parser, Subcommand};
use commands::{body, effects, kernels, methods, roofline, solid_box, threads, warm};
use std::process::ExitCode;

/// Measures solves, kernels and the machine. Timings are medians of wall-clock seconds; every command writes --json FILE.
#[derive(Parser)]
#[command(
    name = "myofield-bench",
    bin_name = "cargo xtask bench",
    version,
    max_term_width = 100
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// The reference box: setup, forward, backward, accuracy, memory.
    Box(solid_box::BoxArgs),
    /// The inside of a closed surface, beside a box of as many elements.
    Body(body::BodyArgs),
    /// Every method on every size: seconds, iterations, setup, memory.
    Methods(methods::MethodsArgs),
    /// Nanoseconds per 3x3 matrix and per sample of the innermost loops.
    Kernels(kernels::KernelsArgs),
    /// A solve that starts from the equilibrium of a slightly different actuation, beside one from rest.
    Warm(warm::WarmArgs),
    /// What each effect costs on the reference box, alone and all together, beside none.
    Effects(effects::EffectsArgs),
    /// The reference box on one thread and on more.
    Threads(threads::ThreadsArgs),
    /// What the machine can do at best: bytes read and multiply-adds per second.
    Roofline(roofline::RooflineArgs),
}

/// The measurement was made, and a solve in it did not reach its tolerance.
const NOT_CONVERGED: u8 = 3;

fn main() -> ExitCode {
    let done = match Cli::parse().command {
        Command::Box(args) => solid_box::run(&args),
        Command::Body(args) => body::run(&args),
        Command::Methods(args) => methods::run(&args),
        Command::Kernels(args) => kernels::run(&args),
        Command::Warm(args) => warm::run(&args),
        Command::Effects(args) => effects::run(&args),
        Command::Threads(args) => threads::run(&args),
        Command::Roofline(args) => roofline::run(&args),
    };
    match done {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => {
            eprintln!("note: not everything converged: see the statuses");
            ExitCode::from(NOT_CONVERGED)
        }
        Err(error) => {
            eprintln!("error: {}", surface_mesh::printable(&error.to_string()));
            ExitCode::FAILURE
        }
    }
}
