//! The program behind `cargo xtask hard-cases`.

use clap::Parser;
use myofield_hard_cases::{Effort, Run, catalogue, markdown, summary};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

/// Runs the catalogue of hard cases and tells what held.
#[derive(Parser)]
#[command(name = "hard-cases", max_term_width = 100)]
struct Cli {
    /// Only cases whose names contain this.
    #[arg(default_value = "")]
    filter: String,
    /// As little of each case as still means something.
    #[arg(long)]
    quick: bool,
    /// Where the page is written when all cases are run; `docs/hard-cases.md` in the folder that one stands in unless given.
    #[arg(long, value_name = "FILE", default_value = "docs/hard-cases.md")]
    out: PathBuf,
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    let effort = if cli.quick {
        Effort::QUICK
    } else {
        Effort::FULL
    };
    let mut runs = Vec::new();
    for case in catalogue() {
        if !case.name.contains(&cli.filter) {
            continue;
        }
        let clock = Instant::now();
        let finding = case.run(&effort);
        let run = Run {
            section: case.section,
            name: case.name,
            story: case.story,
            finding,
            seconds: clock.elapsed().as_secs_f64(),
        };
        println!("{}", run.line());
        for note in &run.finding.notes {
            println!("       {note}");
        }
        runs.push(run);
    }
    if runs.is_empty() {
        eprintln!("error: no case has `{}` in its name", cli.filter);
        return ExitCode::from(2);
    }
    print!("\n{}", summary(&runs));
    if cli.filter.is_empty()
        && !cli.quick
        && let Err(error) =
            whole_file::write(&cli.out, |file| file.write_all(markdown(&runs).as_bytes()))
    {
        eprintln!("error: {}: {error}", cli.out.display());
        return ExitCode::FAILURE;
    }
    match runs.iter().all(|r| r.finding.broken.is_empty()) {
        true => ExitCode::SUCCESS,
        false => ExitCode::FAILURE,
    }
}
