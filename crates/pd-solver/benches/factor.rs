//! The factor of the constant matrix, for boxes of 8192 and 30,000 elements, an L and a hollow box: building it, and solving with
//! it on one thread and on two. The parts of the setup and the size of the factor are printed once per body.

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use hex_mesh::{Axis, HexMesh, NodeRegion, Quadrature};
use nalgebra::Vector3;
use pd_solver::{EffectSpec, NodeSet, Solver};
use std::hint::black_box;
use std::time::Duration;

const SIZE: f64 = 0.01;

/// The cells of a grid for which a condition holds.
fn body(cells: [i32; 3], keep: impl Fn([i32; 3]) -> bool) -> HexMesh {
    let all = (0..cells[0])
        .flat_map(|i| (0..cells[1]).flat_map(move |j| (0..cells[2]).map(move |k| [i, j, k])));
    let kept = all.filter(|&c| keep(c)).collect();
    HexMesh::from_cells(kept, Vector3::zeros(), SIZE, Quadrature::Eight).expect("a valid body")
}

fn bodies() -> Vec<(&'static str, HexMesh)> {
    const HOLLOW: [i32; 3] = [48, 40, 40];
    let wall = |c: [i32; 3]| (0..3).any(|a| c[a] < 4 || c[a] >= HOLLOW[a] - 4);
    vec![
        ("box, 8192 elements", body([32, 16, 16], |_| true)),
        ("box, 30000 elements", body([48, 25, 25], |_| true)),
        (
            "L, 24320 elements",
            body([48, 48, 16], |c| c[0] < 20 || c[1] < 20),
        ),
        ("hollow box, 35840 elements", body(HOLLOW, wall)),
    ]
}

/// Elasticity, and the nodes with x = 0 held.
fn effects() -> Vec<EffectSpec> {
    let held = NodeRegion::Plane {
        axis: Axis::X,
        value: 0.0,
    };
    vec![
        EffectSpec::Elasticity { stiffness: 1.0 },
        EffectSpec::Prescribed {
            nodes: NodeSet::Region(held),
        },
    ]
}

fn factor(c: &mut Criterion) {
    let mut group = c.benchmark_group("constant factor");
    group
        .sample_size(20)
        .warm_up_time(Duration::from_secs(1))
        .measurement_time(Duration::from_secs(4));
    for (name, mesh) in bodies() {
        let mut solver = Solver::new(&mesh, &effects()).expect("a valid problem");
        // A right-hand side for the factor to exist, wherever it is built.
        let r: Vec<_> = (0..mesh.nodes().len())
            .map(|i| Vector3::new(1.0, (i as f64 * 0.7).sin(), (i as f64 * 1.3).cos()))
            .collect();
        let mut out = r.clone();
        solver.constant_solve(&r, &mut out).expect("fits");
        let entries = solver.work().factor_entries;
        println!("{name}: {entries} entries, {:?}", solver.factor_seconds());
        for threads in [1, 2] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
            let pool = pool.build().expect("threads");
            group.bench_function(BenchmarkId::new(format!("{name}: setup"), threads), |b| {
                b.iter(|| {
                    pool.install(|| {
                        let mut solver = Solver::new(&mesh, &effects()).expect("a valid problem");
                        solver.constant_solve(&r, &mut out).expect("fits");
                    });
                });
            });
            group.bench_function(BenchmarkId::new(format!("{name}: solve"), threads), |b| {
                b.iter(|| {
                    pool.install(|| solver.constant_solve(black_box(&r), &mut out))
                        .expect("fits");
                });
            });
        }
    }
    group.finish();
}

criterion_group!(benches, factor);
criterion_main!(benches);
