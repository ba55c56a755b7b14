//! Times of a joint fit and of bounded blend weights at the size of a low-resolution face.

use criterion::{Criterion, criterion_group, criterion_main};
use face_rig::{BlendBasis, Bounds, Joint};
use nalgebra::Vector3;
use std::hint::black_box;

const VERTICES: usize = 3002;
const SHAPES: usize = 37;

/// Bumps of different place and width, overlapping as facial expressions do.
fn shape(index: usize) -> Vec<Vector3<f64>> {
    (0..VERTICES)
        .map(|vertex| {
            let t = vertex as f64 / VERTICES as f64;
            let centre = (index as f64 * 0.37).fract();
            let size = (-((t - centre) * 12.0).powi(2)).exp();
            Vector3::new(
                (31.0 * t + index as f64).sin(),
                (17.0 * t).cos(),
                (7.0 * index as f64 * t).sin(),
            ) * size
        })
        .collect()
}

fn blend(criterion: &mut Criterion) {
    let shapes: Vec<_> = (0..SHAPES).map(shape).collect();
    let target: Vec<_> = (0..VERTICES)
        .map(|vertex| {
            let sum: Vector3<f64> = shapes
                .iter()
                .step_by(3)
                .map(|shape| shape[vertex] * 0.6)
                .sum();
            sum + Vector3::new((vertex as f64).sin(), (2.0 * vertex as f64).cos(), 0.3) * 0.2
        })
        .collect();
    let basis = BlendBasis::new(shapes).expect("the shapes match");
    let bounds = Bounds::uniform(SHAPES, 0.0, 1.0);
    let fit = basis
        .fit(&target, &bounds, 0.0)
        .expect("the target matches");
    println!("{} iterations, {:?}", fit.iterations, fit.weights);
    criterion.bench_function("blend weights 9006 x 37", |bencher| {
        bencher.iter(|| basis.fit(black_box(&target), &bounds, 0.0));
    });
}

fn joint(criterion: &mut Criterion) {
    let joint = Joint::new(Vector3::new(0.0, 1.0, -2.0));
    let points = shape(0);
    let moved = joint.positions([0.3, 0.05, 0.1, 0.0, 0.2], &points);
    criterion.bench_function("joint fit, 3002 points", |bencher| {
        bencher.iter(|| joint.fit(black_box(&points), &moved));
    });
    criterion.bench_function("joint cotangent, 3002 points", |bencher| {
        bencher.iter(|| joint.vjp(black_box([0.3, 0.05, 0.1, 0.0, 0.2]), &points, &moved));
    });
}

criterion_group!(benches, blend, joint);
criterion_main!(benches);
