//! `box` in a process of its own, so that peaks of memory are apart and one that takes too long can be ended.

use crate::error::{BenchError, Result};
use serde_json::Value;
use std::fs::File;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// How often to look whether a process has ended.
const POLL: Duration = Duration::from_millis(20);

/// How a measurement in a process of its own ended.
pub enum Outcome {
    /// The JSON of `box`.
    Measured(Value),
    /// It was ended after the limit.
    OverLimit,
}

/// Runs `box` with `options` and takes its JSON. `threads` sets the size of the process's thread pool, `limit` the seconds that it
/// may take.
///
/// # Errors
/// When it does not start, or ends without a measurement.
pub fn measure_box(
    options: &[String],
    threads: Option<usize>,
    limit: Option<f64>,
) -> Result<Outcome> {
    let failed = |reason: String| BenchError::Child { reason };
    let system = |cause: std::io::Error| failed(cause.to_string());
    let folder = tempfile::tempdir().map_err(system)?;
    let (json, said) = (folder.path().join("box.json"), folder.path().join("said"));
    let program = std::env::current_exe().map_err(system)?;
    let mut command = Command::new(program);
    command.arg("box").args(options).arg("--json").arg(&json);
    if let Some(threads) = threads {
        command.env("RAYON_NUM_THREADS", threads.to_string());
    }
    command.stdin(Stdio::null()).stdout(Stdio::null());
    command.stderr(File::create(&said).map_err(system)?);
    let mut child = command.spawn().map_err(system)?;
    if !ended_within(&mut child, limit).map_err(system)? {
        return Ok(Outcome::OverLimit);
    }
    // The file is whole or absent; a solve that does not converge leaves one, with its status in it.
    match std::fs::read(&json) {
        Ok(text) => {
            let value = serde_json::from_slice(&text).map_err(|cause| failed(cause.to_string()))?;
            Ok(Outcome::Measured(value))
        }
        Err(_) => {
            let said = std::fs::read_to_string(&said).unwrap_or_default();
            Err(failed(first_words(&said)))
        }
    }
}

/// The line of error, or else where a process panicked and why: the first two lines of what it said.
fn first_words(said: &str) -> String {
    if let Some(error) = said.lines().find_map(|line| line.strip_prefix("error: ")) {
        return error.to_string();
    }
    let mut lines = said.lines().filter(|line| !line.trim().is_empty());
    let first = lines.next().unwrap_or("it said nothing");
    format!("{first} {}", lines.next().unwrap_or_default())
        .trim_end()
        .to_string()
}

/// Waits for a process to end; ends it after `limit` seconds, and tells whether it ended by itself.
fn ended_within(child: &mut Child, limit: Option<f64>) -> std::io::Result<bool> {
    let Some(limit) = limit else {
        return child.wait().map(|_| true);
    };
    let clock = Instant::now();
    while clock.elapsed().as_secs_f64() < limit {
        if child.try_wait()?.is_some() {
            return Ok(true);
        }
        std::thread::sleep(POLL);
    }
    child.kill()?;
    child.wait()?;
    Ok(false)
}

/// A number of a measurement.
pub fn number(measurement: &Value, key: &str) -> Option<f64> {
    measurement[key].as_f64()
}

/// Whether forward and adjoint of a measurement met their tolerances.
pub fn converged(measurement: &Value) -> bool {
    let adjoint = measurement["adjoint_status"].as_str();
    measurement["status"] == "converged" && adjoint.is_some_and(|s| s.starts_with("converged"))
}

#[cfg(test)]
mod tests {
    use super::first_words;

    #[test]
    fn what_a_process_said_is_cut_to_the_point() {
        assert_eq!(first_words(""), "it said nothing");
        assert_eq!(
            first_words("note: a\nerror: too large\nmore\n"),
            "too large"
        );
        let panic = "\nthread 'main' panicked at a.rs:1:1:\nwhy\nstack backtrace:\n";
        assert_eq!(
            first_words(panic),
            "thread 'main' panicked at a.rs:1:1: why"
        );
    }
}
