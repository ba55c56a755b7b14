//! `methods`: every method on every size, each in a process of its own.

use crate::child::{Outcome, converged, measure_box, number};
use crate::error::Result;
use crate::files::{check_writable, write_json};
use crate::options::{
    Name, Size, method_names, parse_count, parse_method, parse_positive, parse_size,
};
use crate::system;
use crate::table::{optional, print, say, seconds};
use clap::Args;
use serde::Serialize;
use serde_json::Value;
use std::path::PathBuf;

/// Options of `methods`.
#[derive(Args, Debug)]
pub struct MethodsArgs {
    /// Sizes of the reference box: 8k, 30k, 128k, 250k, or cells such as 64x32x32.
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "8k,30k,128k,250k", value_parser = parse_size)]
    sizes: Vec<Size>,
    /// Methods; all unless given.
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = parse_method)]
    methods: Vec<Name>,
    /// Seconds that all of one cell of the table may take; a method that is over it is not tried on larger sizes.
    #[arg(long, value_name = "SECONDS", default_value_t = 300.0, allow_hyphen_values = true, value_parser = parse_positive)]
    limit: f64,
    /// Repetitions; medians are told. A step that has taken a tenth of the limit is not repeated.
    #[arg(long, value_name = "N", default_value_t = 5, allow_hyphen_values = true, value_parser = parse_count)]
    runs: usize,
    /// Write everything to this file.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// One cell of the table.
#[derive(Serialize)]
struct Cell {
    method: String,
    size: String,
    cells: [usize; 3],
    /// What `box` measured.
    measurement: Option<Value>,
    /// Why it did not.
    absent: Option<String>,
}

#[derive(Serialize)]
struct Report {
    sizes: Vec<String>,
    methods: Vec<String>,
    limit_s: f64,
    load: Option<f64>,
    table: Vec<Cell>,
}

/// Measures, prints and writes; whether everything that was measured converged.
///
/// # Errors
/// When the file cannot be written. A cell that fails tells so in its place.
pub fn run(args: &MethodsArgs) -> Result<bool> {
    check_writable(args.json.as_deref())?;
    let load = system::load();
    let methods: Vec<String> = if args.methods.is_empty() {
        method_names().into_iter().map(str::to_string).collect()
    } else {
        args.methods.iter().map(Name::to_string).collect()
    };
    let mut table = Vec::new();
    for method in &methods {
        // The smallest size so far that took too long.
        let mut over: Option<&Size> = None;
        for size in &args.sizes {
            let elements = |size: &Size| size.cells.iter().product::<usize>();
            let hopeless = over.filter(|over| elements(over) <= elements(size));
            let (measurement, absent) = match hopeless {
                Some(over) => (
                    None,
                    Some(format!("skipped: over {} s at {}", args.limit, over.name)),
                ),
                None => one(method, size, args),
            };
            if hopeless.is_none() && absent.as_ref().is_some_and(|a| a.starts_with("over")) {
                over = Some(size);
            }
            let cell = Cell {
                method: method.clone(),
                size: size.name.clone(),
                cells: size.cells,
                measurement,
                absent,
            };
            eprintln!("{method} {}: {}", size.name, told(&cell, forward));
            table.push(cell);
        }
    }
    let report = Report {
        sizes: args.sizes.iter().map(|size| size.name.clone()).collect(),
        methods,
        limit_s: args.limit,
        load,
        table,
    };
    write_json(args.json.as_deref(), &report)?;
    print_report(&report);
    let mut measured = report
        .table
        .iter()
        .filter_map(|cell| cell.measurement.as_ref());
    Ok(measured.all(converged))
}

fn one(method: &str, size: &Size, args: &MethodsArgs) -> (Option<Value>, Option<String>) {
    let cells = size.cells.map(|n| n.to_string()).join(",");
    let (runs, budget) = (args.runs.to_string(), (0.1 * args.limit).to_string());
    let options = [
        "--cells", &cells, "--method", method, "--runs", &runs, "--budget", &budget,
    ];
    match measure_box(&options.map(str::to_string), None, Some(args.limit)) {
        Ok(Outcome::Measured(value)) => (Some(value), None),
        Ok(Outcome::OverLimit) => (None, Some(format!("over {} s", args.limit))),
        Err(error) => (None, Some(error.to_string())),
    }
}

/// How an entry of a table reads.
type Entry = fn(&Value) -> String;

fn print_report(report: &Report) {
    let tables: [(&str, Entry); 4] = [
        ("forward s (iterations)", forward),
        ("adjoint s (iterations)", |m| {
            timed(m, "backward_s", "adjoint_iterations")
        }),
        ("setup s", |m| optional(number(m, "setup_s"), seconds)),
        ("peak MB", |m| {
            optional(number(m, "peak_mb"), |mb| format!("{mb:.0}"))
        }),
    ];
    for (title, entry) in tables {
        say("\n");
        let mut rows = vec![vec![title.to_string()]];
        rows[0].extend(report.sizes.iter().cloned());
        for (method, cells) in report
            .methods
            .iter()
            .zip(report.table.chunks(report.sizes.len()))
        {
            let mut row = vec![method.clone()];
            row.extend(cells.iter().map(|cell| told(cell, entry)));
            rows.push(row);
        }
        print(&rows);
    }
}

/// An entry of the table, or why there is none.
fn told(cell: &Cell, entry: impl Fn(&Value) -> String) -> String {
    match (&cell.measurement, &cell.absent) {
        (Some(measurement), _) => entry(measurement),
        (None, absent) => absent.clone().unwrap_or_else(|| "-".into()),
    }
}

/// Seconds and iterations of the forward solve, with its status where that is not converged.
fn forward(measurement: &Value) -> String {
    let text = timed(measurement, "forward_s", "iterations");
    match measurement["status"].as_str() {
        Some("converged") => text,
        status => format!("{text} {}", status.unwrap_or("no status")),
    }
}

fn timed(measurement: &Value, time: &str, iterations: &str) -> String {
    let time = optional(number(measurement, time), seconds);
    format!("{time} ({})", measurement[iterations])
}
