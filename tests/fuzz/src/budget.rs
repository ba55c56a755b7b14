//! Executions up to a budget, in a process of their own that may die.
//!
//! A stack overflow, an abort and an endless loop end a process before it can tell of its input. So the program starts itself as a worker,
//! which tells how far it is; where it dies, another worker runs the last stretch again and keeps each input in a file before it is read.

use std::collections::HashSet;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use crate::shrink::shrink;
use crate::targets::{SLACK, Target, tenfold};
use crate::watch::execute;

/// Executions between two words of a worker.
const STRETCH: u64 = 1024;
/// After so long a reader does not come back.
const HANGS: Duration = Duration::from_secs(10);
/// The stack that a reader has: that of a thread, which is smaller than that of a program.
const STACK: usize = 2 << 20;
/// Different harms after which a target is left alone.
const ENOUGH: usize = 10;

/// What a run is to do.
#[derive(Debug, Clone)]
pub struct Budget {
    /// Executions per target.
    pub executions: u64,
    /// Time per target, whichever ends first.
    pub time: Option<Duration>,
    /// Seed of the inputs.
    pub seed: u64,
    /// Where harmful inputs go.
    pub out: PathBuf,
}

/// What a worker has found so far; its words.
#[derive(Debug, Clone, Default)]
pub struct Tally {
    /// Executions.
    pub executions: u64,
    /// Inputs that were accepted.
    pub accepted: u64,
    /// Different kinds of errors.
    pub kinds: usize,
    /// The longest execution, in microseconds.
    pub longest_us: u64,
    /// Executions that held more than [`tenfold`], which the target allows.
    pub above_tenfold: u64,
    /// The most that was held beyond what any reader may, in bytes per thousand bytes of input.
    pub most_per_mille: u64,
    /// Harmful inputs that were kept.
    pub harms: Vec<(String, PathBuf)>,
}

/// Runs a target in workers until its budget is used up.
///
/// # Errors
/// When a worker cannot be started or its output cannot be read.
pub fn spend(target: &Target, budget: &Budget) -> std::io::Result<Tally> {
    let clock = Instant::now();
    let mut all = Tally::default();
    let mut at = 0;
    let current = budget
        .out
        .join(format!(".current-{}-{}", target.name, std::process::id()));
    let mut careful = None;
    while at < budget.executions && all.harms.len() < ENOUGH {
        let spent = clock.elapsed();
        if budget.time.is_some_and(|time| spent >= time) {
            break;
        }
        let (from, to) = careful.unwrap_or((at, budget.executions));
        let time = budget.time.map(|time| time - spent);
        let keep = careful.map(|_| current.as_path());
        let (tally, ended) = worker(target, budget, from..to, time, keep)?;
        at = from + tally.executions;
        all.executions += tally.executions;
        all.accepted += tally.accepted;
        all.kinds = all.kinds.max(tally.kinds);
        all.longest_us = all.longest_us.max(tally.longest_us);
        all.above_tenfold += tally.above_tenfold;
        all.most_per_mille = all.most_per_mille.max(tally.most_per_mille);
        for harm in tally.harms {
            if !all.harms.iter().any(|known| known.0 == harm.0) {
                all.harms.push(harm);
            }
        }
        match (ended, careful) {
            (true, None) => break,
            (true, Some(_)) => careful = None,
            (false, None) => careful = Some((at, budget.executions.min(at + 2 * STRETCH))),
            (false, Some(_)) => {
                // This is the one: it is in the file, and one more execution than was told.
                at += 1;
                all.executions += 1;
                let input = std::fs::read(&current)?;
                let path = keep_input(target, &budget.out, &input)?;
                all.harms.push((format!("died at input {at}"), path));
                careful = None;
            }
        }
    }
    if current.exists() {
        std::fs::remove_file(current)?;
    }
    Ok(all)
}

/// Starts a worker and listens; the flag tells whether it came to its end.
fn worker(
    target: &Target,
    budget: &Budget,
    range: std::ops::Range<u64>,
    time: Option<Duration>,
    keep: Option<&Path>,
) -> std::io::Result<(Tally, bool)> {
    let mut command = Command::new(std::env::current_exe()?);
    command
        .arg(target.name)
        .arg("--worker")
        .arg(format!("{},{}", range.start, range.end));
    command.arg("--seed").arg(budget.seed.to_string());
    command.arg("--out").arg(&budget.out);
    if let Some(time) = time {
        command.arg("--seconds").arg(time.as_secs_f64().to_string());
    }
    if let Some(keep) = keep {
        command.arg("--keep").arg(keep);
    }
    let mut child = command
        .stdout(Stdio::piped())
        .stderr(Stdio::inherit())
        .spawn()?;
    let words = BufReader::new(child.stdout.take().expect("it is piped"));
    let mut tally = Tally::default();
    for line in words.lines() {
        let line = line?;
        let mut fields = line.split('\t');
        match fields.next() {
            Some("at") => {
                let mut number = || {
                    fields
                        .next()
                        .and_then(|f| f.parse::<u64>().ok())
                        .unwrap_or(0)
                };
                tally.executions = number();
                tally.accepted = number();
                tally.kinds = number() as usize;
                tally.longest_us = number();
                tally.above_tenfold = number();
                tally.most_per_mille = number();
            }
            Some("harm") => {
                let path = fields.next().unwrap_or_default().into();
                let cause = fields.collect::<Vec<_>>().join(" ");
                eprintln!("{:>12} {cause}", target.name);
                tally.harms.push((cause, path));
            }
            _ => {}
        }
    }
    Ok((tally, child.wait()?.success()))
}

/// The work of a worker: inputs of a range, told on the standard output.
///
/// # Errors
/// When an input cannot be kept.
///
/// # Panics
/// When the thread of the readers cannot be started.
pub fn work(
    target: &Target,
    budget: &Budget,
    range: std::ops::Range<u64>,
    keep: Option<&Path>,
) -> std::io::Result<()> {
    // When the input under way began, in microseconds from the start; 0 while there is none.
    let began = AtomicU64::new(0);
    let clock = Instant::now();
    std::thread::scope(|scope| {
        // Ends the process, and with it itself.
        let watch = || loop {
            std::thread::sleep(Duration::from_millis(500));
            let start = began.load(Ordering::SeqCst);
            if start == u64::MAX {
                return;
            }
            if start > 0 && clock.elapsed() > Duration::from_micros(start) + HANGS {
                std::process::exit(9);
            }
        };
        scope.spawn(watch);
        let readers = std::thread::Builder::new().stack_size(STACK);
        let readers = readers.spawn_scoped(scope, || {
            let _ended = Ended(&began);
            stretch(target, budget, range, keep, &began, clock)
        });
        readers
            .expect("a thread is started")
            .join()
            .expect("harm is caught")
    })
}

/// Tells the watch that the readers have ended, by whatever way.
struct Ended<'a>(&'a AtomicU64);

impl Drop for Ended<'_> {
    fn drop(&mut self) {
        self.0.store(u64::MAX, Ordering::SeqCst);
    }
}

fn stretch(
    target: &Target,
    budget: &Budget,
    range: std::ops::Range<u64>,
    keep: Option<&Path>,
    began: &AtomicU64,
    clock: Instant,
) -> std::io::Result<()> {
    let source = target.source(budget.seed);
    let mut kinds = HashSet::new();
    let mut causes = HashSet::new();
    let mut tally = Tally::default();
    let tell = |tally: &Tally, kinds: usize| {
        println!(
            "at\t{}\t{}\t{kinds}\t{}\t{}\t{}",
            tally.executions,
            tally.accepted,
            tally.longest_us,
            tally.above_tenfold,
            tally.most_per_mille
        );
    };
    for index in range {
        let input = source.input(index);
        if let Some(keep) = keep {
            std::fs::write(keep, &input)?;
        }
        began.store(clock.elapsed().as_micros() as u64 + 1, Ordering::SeqCst);
        let executed = execute(target, &input);
        began.store(0, Ordering::SeqCst);
        tally.executions += 1;
        tally.longest_us = tally.longest_us.max(executed.time.as_micros() as u64);
        tally.above_tenfold += u64::from(executed.peak > tenfold(&input));
        let held = executed.peak.saturating_sub(SLACK) * 1000 / input.len().max(1);
        tally.most_per_mille = tally.most_per_mille.max(held as u64);
        match executed.result {
            Ok(outcome) => {
                tally.accepted += u64::from(outcome.accepted);
                kinds.insert(outcome.kind());
            }
            Err(harm) => {
                if causes.insert(harm.cause()) {
                    let small = shrink(target, &input, &harm);
                    let path = keep_input(target, &budget.out, &small)?;
                    let harm = harm.to_string().replace(['\n', '\t'], " ");
                    println!("harm\t{}\t{harm}", path.display());
                }
            }
        }
        if keep.is_some() || tally.executions.is_multiple_of(STRETCH) {
            tell(&tally, kinds.len());
            if budget.time.is_some_and(|time| clock.elapsed() > time) || causes.len() >= ENOUGH {
                break;
            }
        }
    }
    tell(&tally, kinds.len());
    std::io::stdout().flush()
}

/// Keeps an input in a file of its own, whole or not at all.
fn keep_input(target: &Target, out: &Path, input: &[u8]) -> std::io::Result<PathBuf> {
    use std::hash::{DefaultHasher, Hash, Hasher};
    let mut hasher = DefaultHasher::new();
    input.hash(&mut hasher);
    let path = out.join(format!("{}-{:016x}", target.name, hasher.finish()));
    whole_file::write(&path, |file| file.write_all(input))?;
    Ok(path)
}
