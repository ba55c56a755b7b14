//! `threads`: the reference box in processes with different numbers of threads.

use crate::child::{Outcome, converged, measure_box, number};
use crate::error::{BenchError, Result};
use crate::files::{check_writable, write_json};
use crate::options::{Name, parse_cells, parse_count, parse_method, parse_threads};
use crate::table::{optional, print, row, say, seconds};
use clap::Args;
use serde::Serialize;
use serde_json::Value;
use std::path::PathBuf;

/// Options of `threads`.
#[derive(Args, Debug)]
pub struct ThreadsArgs {
    /// Elements along x, y and z.
    #[arg(long, value_name = "NX,NY,NZ", default_value = "32,16,16", allow_hyphen_values = true, value_parser = parse_cells)]
    cells: [usize; 3],
    /// Numbers of threads; the first one is what the others are compared with.
    #[arg(long, value_name = "LIST", default_value = "1,2", value_delimiter = ',', allow_hyphen_values = true, value_parser = parse_threads)]
    counts: Vec<usize>,
    /// Method of the forward solve; the solver's default unless given.
    #[arg(long, value_name = "M", default_value_t = Name::default(), value_parser = parse_method)]
    method: Name,
    /// Repetitions; medians are told.
    #[arg(long, value_name = "N", default_value_t = 5, allow_hyphen_values = true, value_parser = parse_count)]
    runs: usize,
    /// Write everything to this file.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

#[derive(Serialize)]
struct Report {
    counts: Vec<usize>,
    /// Seconds of the first count over those of each.
    forward_speedup: Vec<Option<f64>>,
    backward_speedup: Vec<Option<f64>>,
    setup_speedup: Vec<Option<f64>>,
    /// Whether all counts gave the same positions to the last bit.
    same_bits: bool,
    /// What `box` measured with each.
    measurements: Vec<Value>,
}

/// Measures, prints and writes; whether everything converged.
///
/// # Errors
/// When a process gives no measurement, or the file cannot be written.
pub fn run(args: &ThreadsArgs) -> Result<bool> {
    check_writable(args.json.as_deref())?;
    let cells = args.cells.map(|n| n.to_string()).join(",");
    let (method, runs) = (args.method.to_string(), args.runs.to_string());
    let options = ["--cells", &cells, "--method", &method, "--runs", &runs];
    let options = options.map(str::to_string);
    let mut measurements = Vec::new();
    for &threads in &args.counts {
        match measure_box(&options, Some(threads), None)? {
            Outcome::Measured(value) => measurements.push(value),
            Outcome::OverLimit => {
                return Err(BenchError::Child {
                    reason: "it was ended, though no limit was set".into(),
                });
            }
        }
    }
    let speedup = |key: &str| -> Vec<Option<f64>> {
        let first = number(&measurements[0], key);
        let ratio = |m: &Value| Some(first? / number(m, key)?);
        measurements.iter().map(ratio).collect()
    };
    let first = &measurements[0]["positions_hash"];
    let report = Report {
        counts: args.counts.clone(),
        forward_speedup: speedup("forward_s"),
        backward_speedup: speedup("backward_s"),
        setup_speedup: speedup("setup_s"),
        same_bits: first.is_string() && measurements.iter().all(|m| m["positions_hash"] == *first),
        measurements,
    };
    write_json(args.json.as_deref(), &report)?;
    print_report(&report);
    Ok(report.measurements.iter().all(converged))
}

fn print_report(report: &Report) {
    let mut rows = vec![row([
        "threads",
        "setup s",
        "forward s",
        "backward s",
        "forward speed-up",
    ])];
    for ((count, m), speedup) in (report.counts.iter())
        .zip(&report.measurements)
        .zip(&report.forward_speedup)
    {
        let time = |key| optional(number(m, key), seconds);
        rows.push(vec![
            count.to_string(),
            time("setup_s"),
            time("forward_s"),
            time("backward_s"),
            optional(*speedup, |s| format!("{s:.2}")),
        ]);
    }
    print(&rows);
    say(&format!("same bits: {}\n", report.same_bits));
}
