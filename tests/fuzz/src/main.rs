//! The program behind `cargo xtask fuzz`.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use clap::Parser;
use myofield_fuzz::budget::{Budget, Tally, spend, work};
use myofield_fuzz::watch::execute;
use myofield_fuzz::{Target, targets};

/// Gives every reader files that are damaged on purpose, and tells which of them make it panic, hang or take too much memory.
#[derive(Parser)]
#[command(name = "cargo xtask fuzz")]
struct Cli {
    /// Readers to try; all of them unless given (see --list).
    targets: Vec<String>,
    /// Executions of each reader.
    #[arg(long, value_name = "N", default_value_t = 100_000)]
    executions: u64,
    /// Seconds for each reader, whichever ends first.
    #[arg(long, value_name = "S", value_parser = seconds)]
    seconds: Option<Duration>,
    /// Seed of the inputs: another one makes others.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Folder for harmful inputs.
    #[arg(long, value_name = "DIR", default_value = "fuzz-findings")]
    out: PathBuf,
    /// Reads one file, and tells how that goes.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["executions", "seconds", "seed"])]
    replay: Option<PathBuf>,
    /// Lists the readers.
    #[arg(long)]
    list: bool,
    /// Works on a range of inputs for the process that started this one.
    #[arg(long, hide = true, value_name = "FROM,TO", value_parser = range)]
    worker: Option<(u64, u64)>,
    /// Where a worker keeps the input that it is about to read.
    #[arg(long, hide = true, value_name = "FILE")]
    keep: Option<PathBuf>,
}

fn seconds(text: &str) -> Result<Duration, String> {
    let seconds = text.parse().map_err(|_| "write a number of seconds")?;
    Duration::try_from_secs_f64(seconds).map_err(|e| e.to_string())
}

fn range(text: &str) -> Result<(u64, u64), String> {
    let parts = text
        .split_once(',')
        .and_then(|(a, b)| Some((a.parse().ok()?, b.parse().ok()?)));
    parts.ok_or_else(|| "write FROM,TO".into())
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    match run(&cli) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}

/// Whether nothing did harm.
fn run(cli: &Cli) -> Result<bool, String> {
    let all = targets();
    if cli.list {
        all.iter().for_each(|target| println!("{}", target.name));
        return Ok(true);
    }
    let chosen = chosen(&all, &cli.targets)?;
    if let Some(file) = &cli.replay {
        let [target] = chosen[..] else {
            return Err("name the one reader that --replay is for".into());
        };
        let input =
            std::fs::read(file).map_err(|e| format!("cannot read {}: {e}", file.display()))?;
        return Ok(replay(target, &input));
    }
    let failed = |e: std::io::Error| format!("cannot work in {}: {e}", cli.out.display());
    std::fs::create_dir_all(&cli.out).map_err(failed)?;
    let budget = Budget {
        executions: cli.executions,
        time: cli.seconds,
        seed: cli.seed,
        out: cli.out.clone(),
    };
    if let Some((from, to)) = cli.worker {
        let [target] = chosen[..] else {
            return Err("a worker has one reader".into());
        };
        work(target, &budget, from..to, cli.keep.as_deref()).map_err(failed)?;
        return Ok(true);
    }
    println!(
        "reader        executions   accepted  outcomes  longest ms   per s  most held  above tenfold  harm"
    );
    let mut total = 0;
    let mut harmless = true;
    for target in chosen {
        let clock = Instant::now();
        let tally = spend(target, &budget).map_err(failed)?;
        total += tally.executions;
        harmless &= tally.harms.is_empty();
        tell(target, &tally, clock.elapsed());
    }
    println!("{total} executions, seed {}", cli.seed);
    if harmless {
        // Nothing was kept: a folder that was made for it goes again, one with other files stays.
        let _ = std::fs::remove_dir(&cli.out);
    }
    Ok(harmless)
}

fn chosen<'a>(all: &'a [Target], names: &[String]) -> Result<Vec<&'a Target>, String> {
    if names.is_empty() {
        return Ok(all.iter().collect());
    }
    let find = |name: &String| {
        let known = all.iter().map(|t| t.name).collect::<Vec<_>>().join(", ");
        all.iter()
            .find(|t| t.name == name)
            .ok_or(format!("there is no reader `{name}`; there are: {known}"))
    };
    names.iter().map(find).collect()
}

fn replay(target: &Target, input: &[u8]) -> bool {
    let executed = execute(target, input);
    let (time, peak) = (executed.time.as_secs_f64(), executed.peak);
    match &executed.result {
        Ok(outcome) if outcome.accepted => println!("accepted"),
        Ok(outcome) => println!("refused: {:?}", outcome.message),
        Err(harm) => println!("HARM: {harm}"),
    }
    println!(
        "{} bytes, {time:.6} s, {peak} bytes of memory at most",
        input.len()
    );
    executed.result.is_ok()
}

fn tell(target: &Target, tally: &Tally, time: Duration) {
    println!(
        "{:12} {:11} {:8.2} % {:9} {:11.1} {:7.0} {:9.1}x {:12.3} %  {}",
        target.name,
        tally.executions,
        100.0 * tally.accepted as f64 / tally.executions.max(1) as f64,
        tally.kinds,
        tally.longest_us as f64 / 1e3,
        tally.executions as f64 / time.as_secs_f64(),
        tally.most_per_mille as f64 / 1e3,
        100.0 * tally.above_tenfold as f64 / tally.executions.max(1) as f64,
        tally.harms.len(),
    );
    for (harm, path) in &tally.harms {
        println!(
            "  {harm}\n  again: cargo xtask fuzz {} --replay {}",
            target.name,
            path.display()
        );
    }
}
