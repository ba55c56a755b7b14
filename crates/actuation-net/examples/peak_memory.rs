//! Peak memory of a forward and reverse pass over 50,000 points at width 128, as the Linux kernel counts it.
//!
//! Run with `cargo run --release -p actuation-net --example peak_memory`; it fails above 100 MiB.

use actuation_net::{ActuationNet, NetworkConfig, Width};

const POINTS: usize = 50_000;
const LIMIT_MIB: f64 = 100.0;

/// Largest resident size of this process so far in MiB, `None` where the system does not say.
fn peak_mib() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM"))?;
    let kib: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib / 1024.0)
}

fn main() -> Result<(), actuation_net::Error> {
    let net = ActuationNet::new(&NetworkConfig::new(23, Width::W128), 1)?;
    let points: Vec<f32> = (0..3 * POINTS)
        .map(|i| 2.0 * (i as f32 * 0.618_034).fract() - 1.0)
        .collect();
    let bar = vec![1.0 / POINTS as f32; 6 * POINTS];
    let before = peak_mib();
    let traced = net.trace(&[0.5; 23], &points)?;
    let gradient = traced.backward(&bar, &[1.0; 5]);
    let norm = gradient.iter().map(|g| g * g).sum::<f32>().sqrt();
    println!("gradient norm {norm:.3e} of {} parameters", gradient.len());
    match (before, peak_mib()) {
        (Some(before), Some(after)) => {
            println!("peak memory {after:.1} MiB, before the evaluation {before:.1} MiB");
            assert!(after < LIMIT_MIB, "more than {LIMIT_MIB} MiB");
        }
        _ => println!("this system does not tell a process its peak memory"),
    }
    Ok(())
}
