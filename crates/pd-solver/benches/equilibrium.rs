//! Equilibria of a box of 32 x 16 x 16 elements that is held at one end and bends, twists and swells by its actuation: setup, every
//! method from rest, a warm start, the adjoint, and what one evaluation costs with more and with fewer effects.

use criterion::{Criterion, criterion_group, criterion_main};
use hex_mesh::{Axis, HexMesh, NodeRegion, Quadrature};
use nalgebra::Vector3;
use pd_solver::{
    AdjointOptions, AdjointStatus, EffectSpec, Method, NodeSet, Parameters, SolveOptions, Solver,
    SpringPoints, Status, Stop,
};
use std::f64::consts::TAU;
use std::hint::black_box;
use std::time::Duration;

const CELLS: [usize; 3] = [32, 16, 16];
const SIZE: f64 = 0.01;

fn mesh() -> HexMesh {
    HexMesh::solid_box(CELLS, SIZE, Quadrature::Eight).expect("a valid box")
}

fn end(value: f64) -> NodeSet {
    let axis = Axis::X;
    NodeSet::Region(NodeRegion::Plane { axis, value })
}

/// Elasticity, and the nodes with x = 0 held.
fn effects() -> Vec<EffectSpec> {
    vec![
        EffectSpec::Elasticity { stiffness: 1.0 },
        EffectSpec::Prescribed { nodes: end(0.0) },
    ]
}

/// The same actuation at all samples of an element, smooth over the box; `strength` 1 is the reference case.
fn actuate(mesh: &HexMesh, parameters: &mut Parameters, strength: f64) {
    let samples = mesh.quadrature().len();
    for (cell, b) in (mesh.cells().iter()).zip(parameters.actuation.chunks_mut(samples)) {
        let c: [f64; 3] =
            std::array::from_fn(|axis| (f64::from(cell[axis]) + 0.5) / CELLS[axis] as f64);
        let s = 0.3 * strength * (2.0 * c[2] - 1.0);
        let xy = 0.05 * strength * (TAU * c[0]).sin();
        let yz = 0.05 * strength * (TAU * c[1]).cos();
        b.fill([s, xy, 0.0, -0.15 * s, yz, -0.5 * s]);
    }
}

fn solver() -> (Solver, Parameters) {
    let mesh = mesh();
    let solver = Solver::new(&mesh, &effects()).expect("a valid problem");
    let mut parameters = solver.rest_parameters();
    actuate(&mesh, &mut parameters, 1.0);
    (solver, parameters)
}

fn options(method: Method) -> SolveOptions {
    SolveOptions::new(Stop::RelativeGradient(1e-4)).with_method(method)
}

fn equilibrium(c: &mut Criterion) {
    let mut group = c.benchmark_group("8k elements");
    group
        .sample_size(10)
        .warm_up_time(Duration::from_secs(1))
        .measurement_time(Duration::from_secs(5));
    let mesh = mesh();
    group.bench_function("setup", |b| {
        b.iter(|| Solver::new(black_box(&mesh), &effects()).expect("a valid problem"));
    });
    let (mut solver, parameters) = solver();
    for (name, method) in [
        ("forward, L-BFGS", Method::Lbfgs),
        ("forward, Newton", Method::Newton),
        ("forward, local/global", Method::LocalGlobal),
        ("forward, Anderson", Method::Anderson),
    ] {
        group.bench_function(name, |b| {
            b.iter(|| {
                let solution = solver
                    .solve(black_box(&parameters), None, &options(method))
                    .expect("fits");
                assert_eq!(solution.status, Status::Converged);
            });
        });
    }
    let at = solver
        .solve(&parameters, None, &options(Method::Lbfgs))
        .expect("fits");
    let mut changed = parameters.clone();
    actuate(&mesh, &mut changed, 1.02);
    group.bench_function("forward, L-BFGS, started 2 % away", |b| {
        b.iter(|| solver.solve(&changed, Some(&at.positions), &options(Method::Lbfgs)));
    });
    let cotangent: Vec<_> = (0..mesh.nodes().len())
        .map(|i| Vector3::new(1.0, (i as f64 * 0.7).sin(), (i as f64 * 1.3).cos()))
        .collect();
    let to_six_digits = AdjointOptions {
        tolerance: 1e-6,
        ..AdjointOptions::default()
    };
    group.bench_function("adjoint", |b| {
        b.iter(|| {
            let adjoint = solver
                .adjoint(&parameters, &at, black_box(&cotangent), &to_six_digits)
                .expect("fits");
            assert_eq!(adjoint.status, AdjointStatus::Converged);
        });
    });
    group.finish();
}

fn evaluation(c: &mut Criterion) {
    let mut group = c.benchmark_group("one evaluation, 8k elements");
    group
        .sample_size(20)
        .warm_up_time(Duration::from_secs(1))
        .measurement_time(Duration::from_secs(3));
    let mesh = mesh();
    let gravity = EffectSpec::Gravity {
        acceleration: [0.0, 0.0, -9.81],
        density: 1e-3,
    };
    let springs = EffectSpec::Springs {
        points: SpringPoints::Nodes(end(CELLS[0] as f64 * SIZE)),
        stiffness: 1e-3,
    };
    for (name, extra) in [
        ("elasticity alone", vec![]),
        ("with gravity", vec![gravity.clone()]),
        ("with gravity and springs", vec![gravity, springs]),
    ] {
        let mut list = effects();
        list.extend(extra);
        let mut solver = Solver::new(&mesh, &list).expect("a valid problem");
        let mut parameters = solver.rest_parameters();
        actuate(&mesh, &mut parameters, 1.0);
        group.bench_function(name, |b| {
            b.iter(|| solver.energy_gradient(&parameters, black_box(mesh.nodes())));
        });
    }
    group.finish();
}

criterion_group!(benches, equilibrium, evaluation);
criterion_main!(benches);
