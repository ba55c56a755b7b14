//! After the first calls on a body, solves and adjoints allocate nothing that grows with the body.

mod common;

use common::{Numbers, elasticity, held, nodes_where};
use hex_mesh::{HexMesh, Quadrature};
use pd_solver::{Adjoint, AdjointOptions, Solution, SolveOptions, Solver, Stop};
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use std::alloc::System;

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// Bytes that a second round of cold solve, warm solve and adjoint allocates, and the bytes of one nodal vector.
fn bytes_of_a_second_round(n: [usize; 3]) -> (usize, usize) {
    let mesh = HexMesh::solid_box(n, 0.1, Quadrature::Eight).unwrap();
    let wall = nodes_where(&mesh, |x| x.x == 0.0);
    let mut solver = Solver::new(&mesh, &[elasticity(), held(wall)]).unwrap();
    let mut parameters = solver.rest_parameters();
    let mut changed = parameters.clone();
    for (b, x) in parameters.actuation.iter_mut().zip(mesh.sample_positions()) {
        *b = [0.2 * (3.0 * x.z).sin(), 0.02, 0.0, 0.1 * x.y, 0.0, -0.1];
    }
    for (changed, b) in changed.actuation.iter_mut().zip(&parameters.actuation) {
        *changed = b.map(|b| 1.01 * b);
    }
    let cotangent = Numbers::new(1).vectors(mesh.nodes().len(), 1.0);
    let options = SolveOptions::new(Stop::RelativeGradient(1e-5));
    let adjoint_options = AdjointOptions {
        tolerance: 1e-5,
        ..AdjointOptions::default()
    };
    let (mut cold, mut warm) = (Solution::default(), Solution::default());
    let mut adjoint = Adjoint::default();
    let mut round = || {
        solver
            .solve_into(&parameters, None, &options, &mut cold)
            .unwrap();
        let start = Some(&cold.positions[..]);
        solver
            .solve_into(&changed, start, &options, &mut warm)
            .unwrap();
        solver
            .adjoint_into(&changed, &warm, &cotangent, &adjoint_options, &mut adjoint)
            .unwrap();
    };
    round();
    let region = Region::new(ALLOCATOR);
    round();
    let change = region.change();
    (
        change.bytes_allocated + change.bytes_reallocated.unsigned_abs(),
        size_of_val(&cotangent[..]),
    )
}

#[test]
fn a_second_round_allocates_nothing_of_the_body_s_size() {
    // The same number of planes, iterations within a few, and four times the elements in each plane.
    let (small, _) = bytes_of_a_second_round([24, 20, 20]);
    let (large, vector) = bytes_of_a_second_round([24, 40, 40]);
    println!("{small} and {large} bytes; a vector has {vector}");
    assert!(
        large < small + vector / 4,
        "{small} and {large} bytes, {vector} in a vector"
    );
}
