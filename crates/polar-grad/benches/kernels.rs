//! Time per 3x3 matrix of every kernel, on ordinary deformations and on inverted ones, with
//! nalgebra's SVD as the baseline.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use nalgebra::{Matrix3, Vector3};
use polar_grad::{
    Filter, HessianCore, RotationGradient, actuation_from_b, polar_rotation, signed_svd,
};
use std::hint::black_box;

const COUNT: usize = 256;

/// Entries in `[-1, 1)` from a linear congruential generator.
struct Entries(u64);

impl Entries {
    fn next(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}

/// Turned matrices near the identity; `inverted` mirrors and flattens them.
fn deformations(inverted: bool) -> Vec<Matrix3<f64>> {
    let mut entries = Entries(1);
    (0..COUNT)
        .map(|_| {
            let turn = nalgebra::Rotation3::new(Vector3::from_fn(|_, _| 2.0 * entries.next()));
            let stretch = Matrix3::identity() + Matrix3::from_fn(|_, _| 0.2 * entries.next());
            let mirror = Vector3::new(1.0, 1.0, if inverted { -0.3 } else { 1.0 });
            turn * stretch * Matrix3::from_diagonal(&mirror)
        })
        .collect()
}

/// One benchmark: `kernel` over all matrices of a class.
fn bench<T>(
    c: &mut Criterion,
    name: &str,
    class: &str,
    matrices: &[Matrix3<f64>],
    kernel: impl Fn(&Matrix3<f64>) -> T,
) {
    let mut group = c.benchmark_group(name);
    group.throughput(Throughput::Elements(matrices.len() as u64));
    group.bench_function(BenchmarkId::from_parameter(class), |b| {
        b.iter(|| {
            for m in matrices {
                black_box(kernel(m));
            }
        })
    });
    group.finish();
}

fn kernels(c: &mut Criterion) {
    for (class, inverted) in [("ordinary", false), ("inverted", true)] {
        let m = deformations(inverted);
        let a = actuation_from_b(&[0.2, 0.05, 0.0, -0.1, 0.05, -0.15]);
        bench(c, "nalgebra_svd", class, &m, |m| m.svd(true, true));
        bench(c, "signed_svd", class, &m, signed_svd);
        bench(c, "polar_rotation", class, &m, polar_rotation);
        bench(c, "rotation_gradient", class, &m, RotationGradient::at);
        bench(c, "hessian_core", class, &m, |m| HessianCore::new(m, &a));
        bench(c, "hessian_core_projected", class, &m, |m| {
            HessianCore::new(m, &a).filtered(Filter::Projected)
        });
    }
}

criterion_group!(benches, kernels);
criterion_main!(benches);
