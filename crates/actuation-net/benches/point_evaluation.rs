//! Forward and reverse pass of one shape's field: the fused path against plain dfdx operations, both in f32.
//!
//! `plain` runs the same network through [`PlainNet`], which keeps every activation on the tape (at width 128 and 50,000
//! points several GiB), so fewer points are used for the other widths.

use std::hint::black_box;

use actuation_net::{
    ActuationNet, NetworkConfig, OutputCotangent, PlainNet, Width, instruction_set,
};
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};

const DESCRIPTOR: [f32; 4] = [0.5, -0.25, 1.0, 0.0];

/// A deterministic scatter of `n` points in the cube.
fn points(n: usize) -> Vec<f32> {
    let golden = [0.819_172_5, 0.671_043_6, 0.549_700_5];
    (0..3 * n)
        .map(|i| 2.0 * ((i / 3) as f32 * golden[i % 3]).fract() - 1.0)
        .collect()
}

fn point_evaluation(c: &mut Criterion) {
    println!("instruction set: {}", instruction_set());
    let mut group = c.benchmark_group("point_evaluation");
    group.sample_size(10);
    for (width, n) in [
        (Width::W128, 50_000),
        (Width::W64, 10_000),
        (Width::W256, 10_000),
    ] {
        let net = ActuationNet::new(&NetworkConfig::new(4, width), 1).unwrap();
        let plain = PlainNet::<f32>::from_net(&net);
        let points = points(n);
        let bar = OutputCotangent {
            actuation: vec![1.0 / n as f32; 6 * n],
            joint: [1.0; 5],
        };
        let label = format!("width {}, {n} points", width.size());
        group.throughput(Throughput::Elements(n as u64));
        group.bench_function(BenchmarkId::new("fused forward", &label), |b| {
            b.iter(|| net.evaluate(&DESCRIPTOR, black_box(&points)).unwrap())
        });
        group.bench_function(BenchmarkId::new("fused forward and reverse", &label), |b| {
            b.iter(|| {
                let traced = net.trace(&DESCRIPTOR, black_box(&points)).unwrap();
                traced.backward(&bar.actuation, &bar.joint)
            })
        });
        group.bench_function(BenchmarkId::new("plain forward", &label), |b| {
            b.iter(|| plain.evaluate(&DESCRIPTOR, black_box(&points)).unwrap())
        });
        group.bench_function(BenchmarkId::new("plain forward and reverse", &label), |b| {
            b.iter(|| {
                plain
                    .evaluate_vjp(&DESCRIPTOR, black_box(&points), |_| bar.clone())
                    .unwrap()
            })
        });
    }
    group.finish();
}

criterion_group!(benches, point_evaluation);
criterion_main!(benches);
