//! The command line: every fault, and a table of what came of it.

use crate::setting::Setting;
use crate::{Result, Verdict, asked, disk, kills, leave, limit, second};
use clap::Parser;
use std::path::PathBuf;
use std::process::ExitCode;

/// Kills trainings at random moments, fills their disk, takes their leave to write; every run is resumed and has to end with the bytes
/// of one undisturbed. Kills evaluations and comparisons too, which have to damage nothing. Ends with exit code 1 where one does not.
#[derive(Parser)]
#[command(name = "myofield-faults", max_term_width = 100)]
struct Cli {
    /// How many kills.
    #[arg(long, default_value_t = 200)]
    kills: u32,
    /// How many trainings each other fault ends, and how often each question to a trained run is killed.
    #[arg(long, default_value_t = 8)]
    faults: u32,
    /// Settles the moments.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// The program `myofield` (the one beside this program unless given).
    #[arg(long, value_name = "FILE")]
    program: Option<PathBuf>,
}

/// Does what the command line says.
pub fn main() -> ExitCode {
    match run(&Cli::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(cli: &Cli) -> Result<()> {
    let program = match &cli.program {
        Some(program) => program.clone(),
        None => beside()?,
    };
    let setting = Setting::new(&program)?;
    let (files, bytes) = setting.size();
    let seconds = setting.whole().as_secs_f64();
    println!(
        "undisturbed    {seconds:.1} s, {files} files, {:.1} MB",
        bytes as f64 / 1e6
    );
    tell("two trainings", &second::train_twice(&setting)?);
    let count = usize::try_from(cli.faults).map_err(|e| e.to_string())?;
    tell("file size", &limit::limit_files(&setting, count)?);
    tell(
        "full disk",
        &disk::fill_disks(&setting, cli.faults, cli.seed)?,
    );
    tell(
        "read-only",
        &leave::take_leave(&setting, cli.faults, cli.seed)?,
    );
    let kills = kills::kill_trainings(&setting, cli.kills, cli.seed, |kills| {
        eprintln!(
            "{:>14} kills, {} runs with the same bytes",
            kills.count, kills.runs
        );
    })?;
    tell("kill -9", &kills.verdict());
    tell(
        "of questions",
        &asked::kill_questions(&setting, cli.faults, cli.seed)?,
    );
    println!("every run ended with the same bytes, but for what a clock said");
    Ok(())
}

fn tell(name: &str, verdict: &Verdict) {
    match verdict {
        Verdict::Held(what) => println!("{name:<14} {what}"),
        Verdict::Skipped(reason) => println!("{name:<14} skipped: {reason}"),
    }
}

fn beside() -> Result<PathBuf> {
    let own = std::env::current_exe().map_err(|e| e.to_string())?;
    let program = own.with_file_name(format!("myofield{}", std::env::consts::EXE_SUFFIX));
    match program.exists() {
        true => Ok(program),
        false => Err(format!(
            "{} is not there: build it by `cargo build --release -p trainer`, or name it by --program",
            program.display()
        )),
    }
}
