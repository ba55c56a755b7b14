//! What it costs to measure the error of a solve, beside the solve alone.

use criterion::{Criterion, criterion_group, criterion_main};
use hex_mesh::{Axis, HexMesh, NodeRegion, Quadrature};
use pd_solver::{EffectSpec, NodeSet, SolveOptions, Solver, Stop};
use scene_shapes::actuation::bending;
use std::hint::black_box;

fn measured_error(c: &mut Criterion) {
    let mesh = HexMesh::solid_box([32, 16, 16], 1.0 / 16.0, Quadrature::Eight).expect("a box");
    let side = NodeRegion::Plane {
        axis: Axis::X,
        value: 0.0,
    };
    let effects = [
        EffectSpec::Elasticity { stiffness: 1.0 },
        EffectSpec::Prescribed {
            nodes: NodeSet::Region(side),
        },
    ];
    let mut solver = Solver::new(&mesh, &effects).expect("a valid problem");
    let mut parameters = solver.rest_parameters();
    for (b, x) in parameters.actuation.iter_mut().zip(mesh.sample_positions()) {
        *b = bending([x.x / 2.0, x.y, x.z], 1.0);
    }
    let mut group = c.benchmark_group("box, 8192 elements, to 1e-4 of its edge");
    group.sample_size(10);
    let plain = SolveOptions::new(Stop::Accuracy(1e-4));
    for (name, options) in [
        ("solve", plain),
        ("solve and measure", plain.measuring_error()),
    ] {
        group.bench_function(name, |b| {
            b.iter(|| black_box(solver.solve(&parameters, None, &options).expect("it fits")));
        });
    }
}

criterion_group!(benches, measured_error);
criterion_main!(benches);
