//! Nanoseconds per 3x3 matrix of every kernel, one thread: a table, and with `--json FILE` an object `{name: nanoseconds}`.
//!
//! `cargo run --release -p polar-grad --features simd --example kernels [-- --json FILE] [PATTERN]` times the kernels whose names
//! contain the pattern. Each number is the median of several passes.

mod suite;

use std::collections::BTreeMap;
use std::error::Error;
use std::time::Instant;

/// Passes over the list whose median is reported.
const PASSES: usize = 41;

fn main() -> Result<(), Box<dyn Error>> {
    let (mut json, mut pattern) = (None, String::new());
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        if argument == "--json" {
            json = Some(arguments.next().ok_or("--json needs a file")?);
        } else {
            pattern = argument;
        }
    }
    let mut results = BTreeMap::new();
    println!("{:<44} {:>10}", "kernel / code / matrices", "ns/matrix");
    for mut kernel in suite::kernels() {
        if !kernel.name.contains(&pattern) {
            continue;
        }
        let nanoseconds = median(&mut kernel.run) / suite::COUNT as f64;
        println!("{:<44} {nanoseconds:>10.1}", kernel.name);
        results.insert(kernel.name, (nanoseconds * 100.0).round() / 100.0);
    }
    if let Some(file) = json {
        std::fs::write(file, serde_json::to_string_pretty(&results)?)?;
    }
    Ok(())
}

/// The median time of one pass in nanoseconds, after a first one that is not counted.
fn median(run: &mut dyn FnMut()) -> f64 {
    run();
    let mut times: Vec<f64> = (0..PASSES)
        .map(|_| {
            let start = Instant::now();
            run();
            start.elapsed().as_secs_f64() * 1e9
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[PASSES / 2]
}
