//! Evidence for the order of elements and nodes: a solver-like pass over a ball whose cells come in different orders.
//!
//! The pass gathers the eight nodes of each element into one stress, then gathers the stresses of the elements around each node into
//! its force: the memory traffic of a matrix-free product, with little arithmetic to hide it.

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use hex_mesh::{HexMesh, Quadrature, VoxelOptions, voxelise};
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;
use surface_mesh::primitives::icosphere;

type Key = fn(&[i32; 3]) -> (u64, u64);

/// The orders under test, by the key that sorts cells.
const ORDERS: [(&str, Key); 4] = [
    ("lexicographic", |&cell| (interleave(cell, 0), 0)),
    ("blocks of 4", |&cell| blocks(cell, 2)),
    ("blocks of 8", |&cell| blocks(cell, 3)),
    ("Morton", |&cell| (morton(cell), 0)),
];

fn interleave(cell: [i32; 3], shift: u32) -> u64 {
    cell.iter()
        .fold(0, |key, &i| key << 20 | (i >> shift) as u64)
}

fn blocks(cell: [i32; 3], bits: u32) -> (u64, u64) {
    (interleave(cell, bits), interleave(cell, 0))
}

fn morton(cell: [i32; 3]) -> u64 {
    (0..20).rev().fold(0, |key, bit| {
        cell.iter()
            .fold(key, |key, &i| key << 1 | (i as u64 >> bit & 1))
    })
}

fn pass(mesh: &HexMesh) -> impl FnMut() + '_ {
    let gradients = mesh.quadrature().gradients(mesh.element_size())[0];
    let incidence = mesh.node_elements();
    let mut stresses = vec![Matrix3::zeros(); mesh.elements().len()];
    let mut forces = vec![Vector3::zeros(); mesh.nodes().len()];
    move || {
        let elements = mesh.elements().par_iter().with_min_len(1024);
        elements.zip(&mut stresses).for_each(|(corners, stress)| {
            let terms = corners.iter().zip(&gradients);
            *stress = terms
                .map(|(&node, gradient)| mesh.nodes()[node as usize] * gradient.transpose())
                .sum::<Matrix3<f64>>();
        });
        let rows = incidence.offsets().par_windows(2).with_min_len(1024);
        rows.zip(&mut forces).for_each(|(row, force)| {
            let meeting = &incidence.corners()[row[0]..row[1]];
            let terms = meeting
                .iter()
                .map(|at| stresses[at.element as usize] * gradients[at.corner as usize]);
            *force = terms.sum();
        });
    }
}

fn ordering(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("ordering");
    group.sample_size(20);
    for across in [48.0, 126.0] {
        let options = VoxelOptions::new(2.0 / across);
        let ball = voxelise(&icosphere(5, 1.0), &options).unwrap().mesh;
        for (name, key) in ORDERS {
            let mut cells = ball.cells().to_vec();
            cells.sort_by_key(key);
            let size = ball.element_size();
            let mesh = HexMesh::from_cells(cells, ball.origin(), size, Quadrature::One).unwrap();
            let mut pass = pass(&mesh);
            group.bench_function(BenchmarkId::new(name, mesh.elements().len()), |bencher| {
                bencher.iter(&mut pass);
            });
        }
    }
}

criterion_group!(benches, ordering);
criterion_main!(benches);
