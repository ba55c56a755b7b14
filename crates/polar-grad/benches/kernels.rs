//! Time per 3x3 matrix of every kernel: in lanes on every instruction set of the machine, in batches, by the scalar functions, and
//! by nalgebra.

#[path = "../examples/kernels/suite.rs"]
mod suite;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use std::time::Duration;

fn kernels(c: &mut Criterion) {
    for mut kernel in suite::kernels() {
        let (group, class) = kernel.name.rsplit_once('/').expect("a class ends the name");
        let mut group = c.benchmark_group(group);
        // Many kernels, each of microseconds: short runs suffice.
        group.warm_up_time(Duration::from_millis(200));
        group.measurement_time(Duration::from_secs(1));
        group.sample_size(30);
        group.throughput(Throughput::Elements(suite::COUNT as u64));
        group.bench_function(BenchmarkId::from_parameter(class), |b| {
            b.iter(&mut kernel.run)
        });
        group.finish();
    }
}

criterion_group!(benches, kernels);
criterion_main!(benches);
