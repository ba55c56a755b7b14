//! `roofline`: what the machine can do at best, which bounds what any solver can.

use crate::error::Result;
use crate::files::{check_writable, write_json};
use crate::lanes::InstructionSet;
use crate::options::{parse_count, parse_threads};
use crate::system;
use crate::table::{print, row, say};
use clap::Args;
use pulp::{Simd, WithSimd};
use serde::Serialize;
use std::hint::black_box;
use std::path::PathBuf;
use std::sync::Barrier;
use std::time::Instant;

/// Independent chains of multiply-adds: more than latency times units of the processors around, and with their two operands
/// fewer than the 16 registers of AVX2.
const CHAINS: usize = 12;
/// Multiply-adds per chain in one measurement.
const LENGTH: usize = 4_000_000;
/// Bytes that one measurement of the bandwidth reads at least, so that starting and ending do not count.
const LEAST_BYTES: usize = 500_000_000;

/// Options of `roofline`.
#[derive(Args, Debug)]
pub struct RooflineArgs {
    /// Sizes of the memory that is read, in MB (10^6 bytes); sizes that fit a cache tell of the cache.
    #[arg(long, value_name = "LIST", default_value = "8,16,32,64,128,256", value_delimiter = ',', allow_hyphen_values = true, value_parser = parse_megabytes)]
    megabytes: Vec<usize>,
    /// Numbers of threads.
    #[arg(long, value_name = "LIST", default_value = "1,2", value_delimiter = ',', allow_hyphen_values = true, value_parser = parse_threads)]
    counts: Vec<usize>,
    /// Repetitions; the fastest is told.
    #[arg(long, value_name = "N", default_value_t = 7, allow_hyphen_values = true, value_parser = parse_count)]
    runs: usize,
    /// Write everything to this file.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Larger than the memory of the machines around.
const MOST_MEGABYTES: usize = 100_000;

fn parse_megabytes(text: &str) -> std::result::Result<usize, String> {
    let number = text
        .trim()
        .parse()
        .ok()
        .filter(|n| (1..=MOST_MEGABYTES).contains(n));
    number.ok_or_else(|| format!("give whole numbers from 1 to {MOST_MEGABYTES}"))
}

#[derive(Serialize)]
struct Report {
    processor: Option<String>,
    instruction_set: &'static str,
    load: Option<f64>,
    read: Vec<Read>,
    multiply_add: Vec<MultiplyAdd>,
}

#[derive(Serialize)]
struct Read {
    megabytes: usize,
    threads: usize,
    /// 10^9 bytes per second, all threads together.
    gigabytes_per_second: f64,
}

#[derive(Serialize)]
struct MultiplyAdd {
    number: &'static str,
    threads: usize,
    /// 10^9 operations per second, all threads together; a multiply-add counts as two.
    gigaflops: f64,
}

/// Measures, prints and writes.
///
/// # Errors
/// When the file cannot be written.
pub fn run(args: &RooflineArgs) -> Result<bool> {
    check_writable(args.json.as_deref())?;
    let set = InstructionSet::best();
    let load = system::load();
    let mut read = Vec::new();
    for &megabytes in &args.megabytes {
        // Written once, so that every page is there.
        let memory = vec![1.0_f64; megabytes * 1_000_000 / size_of::<f64>()];
        for &threads in &args.counts {
            let gigabytes_per_second = 1e-9 * read_rate(set, &memory, threads, args.runs);
            read.push(Read {
                megabytes,
                threads,
                gigabytes_per_second,
            });
        }
    }
    let mut multiply_add = Vec::new();
    for &threads in &args.counts {
        let f64s = || set.run(Chains64);
        let f32s = || set.run(Chains32);
        for (number, operation) in [("f64", &f64s as &Operation), ("f32", &f32s)] {
            let lanes = operation();
            let seconds = on_threads(threads, args.runs, |_| {
                black_box(operation());
            });
            let operations = 2 * CHAINS * LENGTH * lanes * threads;
            multiply_add.push(MultiplyAdd {
                number,
                threads,
                gigaflops: 1e-9 * operations as f64 / seconds,
            });
        }
    }
    let report = Report {
        processor: system::processor(),
        instruction_set: set.name(),
        load,
        read,
        multiply_add,
    };
    write_json(args.json.as_deref(), &report)?;
    print_report(&report);
    Ok(true)
}

/// Runs all chains once; the number of lanes.
type Operation<'a> = dyn Fn() -> usize + Sync + 'a;

/// Bytes per second that so many threads read together, each its own part of the memory, over and over.
fn read_rate(set: InstructionSet, memory: &[f64], threads: usize, runs: usize) -> f64 {
    let part = memory.len().div_ceil(threads);
    let parts: Vec<&[f64]> = memory.chunks(part).collect();
    let passes = LEAST_BYTES.div_ceil(size_of_val(memory));
    let seconds = on_threads(parts.len(), runs, |thread| {
        for _ in 0..passes {
            black_box(set.run(Sum(black_box(parts[thread]))));
        }
    });
    (passes * size_of_val(memory)) as f64 / seconds
}

/// Wall-clock seconds from when the first thread begins its work until the last one ends: of several runs the fastest.
///
/// The working threads look at the clock themselves. One that waited for them might wake up late on a busy machine, measure too
/// short a time, and the fastest run would be the one most wrong.
fn on_threads(threads: usize, runs: usize, work: impl Fn(usize) + Sync) -> f64 {
    let once = || {
        let (barrier, work) = (Barrier::new(threads), &work);
        let spans: Vec<(Instant, Instant)> = std::thread::scope(|scope| {
            let start = |thread| {
                let barrier = &barrier;
                scope.spawn(move || {
                    barrier.wait();
                    let begin = Instant::now();
                    work(thread);
                    (begin, Instant::now())
                })
            };
            let all: Vec<_> = (0..threads).map(start).collect();
            let joined = all.into_iter().map(|thread| thread.join());
            joined
                .map(|span| span.expect("the work does not panic"))
                .collect()
        });
        let begin = spans.iter().map(|span| span.0).min();
        let end = spans.iter().map(|span| span.1).max();
        begin
            .zip(end)
            .map_or(f64::INFINITY, |(begin, end)| (end - begin).as_secs_f64())
    };
    (0..runs).map(|_| once()).fold(f64::INFINITY, f64::min)
}

/// The sum of all numbers: one addition per number read, in eight chains.
struct Sum<'a>(&'a [f64]);

impl WithSimd for Sum<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let (vectors, _) = S::as_simd_f64s(self.0);
        let mut sums = [simd.splat_f64s(0.0); 8];
        let (groups, _) = vectors.as_chunks::<8>();
        for group in groups {
            for (sum, &vector) in sums.iter_mut().zip(group) {
                *sum = simd.add_f64s(*sum, vector);
            }
        }
        sums.into_iter().map(|sum| simd.reduce_sum_f64s(sum)).sum()
    }
}

/// `x <- x a + b` in many chains at once; `a` and `b` keep x within bounds, and the compiler does not know them.
macro_rules! chains {
    ($name:ident, $number:ty, $splat:ident, $multiply_add:ident, $lanes:ident) => {
        struct $name;

        impl WithSimd for $name {
            type Output = usize;

            #[inline(always)]
            fn with_simd<S: Simd>(self, simd: S) -> usize {
                let a = simd.$splat(black_box(0.5 as $number));
                let b = simd.$splat(black_box(0.25 as $number));
                let mut chains = [simd.$splat(black_box(1.0 as $number)); CHAINS];
                for _ in 0..LENGTH {
                    for x in &mut chains {
                        *x = simd.$multiply_add(*x, a, b);
                    }
                }
                black_box(chains);
                S::$lanes
            }
        }
    };
}

chains!(Chains64, f64, splat_f64s, mul_add_e_f64s, F64_LANES);
chains!(Chains32, f32, splat_f32s, mul_add_e_f32s, F32_LANES);

fn print_report(report: &Report) {
    say(&format!(
        "{}, {}\n",
        report.processor.as_deref().unwrap_or("unknown processor"),
        report.instruction_set
    ));
    let mut rows = vec![row(["read MB", "threads", "GB/s"])];
    rows.extend(report.read.iter().map(|r| {
        let rate = format!("{:.1}", r.gigabytes_per_second);
        row([&r.megabytes.to_string(), &r.threads.to_string(), &rate])
    }));
    rows.push(row(["multiply-add", "threads", "Gflop/s"]));
    rows.extend(report.multiply_add.iter().map(|r| {
        let rate = format!("{:.1}", r.gigaflops);
        row([r.number, &r.threads.to_string(), &rate])
    }));
    print(&rows);
}

#[cfg(test)]
mod tests {
    use super::on_threads;
    use std::time::Duration;

    /// The clock once stood in a thread that waited; on a busy machine it told less time than the work took.
    #[test]
    fn no_run_is_shorter_than_its_work() {
        let busy = || {
            let spin = std::time::Instant::now();
            while spin.elapsed() < Duration::from_millis(3) {
                std::hint::spin_loop();
            }
        };
        for threads in [1, 2, 4, 8] {
            let seconds = on_threads(threads, 20, |_| busy());
            assert!(seconds >= 3e-3, "{threads} threads: {seconds}");
        }
    }
}
