//! Time from a closed surface to a mesh, and to embedded points.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use hex_mesh::{VoxelOptions, embed, voxelise};
use nalgebra::Vector3;
use surface_mesh::primitives::icosphere;

/// Balls of 20,480 triangles with about 40 thousand, 180 thousand and 1.4 million elements.
const CELLS_ACROSS: [f64; 3] = [43.0, 70.0, 140.0];

fn voxelise_ball(criterion: &mut Criterion) {
    let surface = icosphere(5, 1.0);
    let mut group = criterion.benchmark_group("voxelise");
    for across in CELLS_ACROSS {
        let options = VoxelOptions::new(2.0 / across);
        let elements = voxelise(&surface, &options).unwrap().mesh.elements().len();
        group.throughput(Throughput::Elements(elements as u64));
        group.bench_function(BenchmarkId::from_parameter(elements), |bencher| {
            bencher.iter(|| voxelise(black_box(&surface), &options));
        });
        let whole = VoxelOptions {
            split: None,
            ..options
        };
        group.bench_function(BenchmarkId::new("without splitting", elements), |bencher| {
            bencher.iter(|| voxelise(black_box(&surface), &whole));
        });
    }
}

fn embed_ball(criterion: &mut Criterion) {
    let surface = icosphere(5, 1.0);
    let mut group = criterion.benchmark_group("embed 10,242 points");
    for across in CELLS_ACROSS {
        let options = VoxelOptions::new(2.0 / across);
        let body = voxelise(&surface, &options).unwrap();
        let mesh = &body.mesh;
        let elements = mesh.elements().len();
        group.bench_function(BenchmarkId::new("skin by part", elements), |bencher| {
            bencher.iter(|| body.embed_surface(black_box(&surface)));
        });
        group.bench_function(BenchmarkId::new("skin", elements), |bencher| {
            bencher.iter(|| embed(mesh, black_box(surface.vertices())));
        });
        let far: Vec<_> = surface.vertices().iter().map(|v| v * 1.5).collect();
        group.bench_function(BenchmarkId::new("far outside", elements), |bencher| {
            bencher.iter(|| embed(mesh, black_box(&far)));
        });
        let embedding = embed(mesh, surface.vertices()).unwrap();
        let mut positions = vec![Vector3::zeros(); embedding.len()];
        group.bench_function(BenchmarkId::new("positions", elements), |bencher| {
            bencher.iter(|| embedding.positions_into(mesh.nodes(), mesh, &mut positions));
        });
        let mut node_bar = vec![Vector3::zeros(); mesh.nodes().len()];
        group.bench_function(BenchmarkId::new("transpose", elements), |bencher| {
            bencher.iter(|| embedding.transpose_into(surface.vertices(), &mut node_bar));
        });
    }
}

criterion_group!(benches, voxelise_ball, embed_ball);
criterion_main!(benches);
