//! The same bits for any number of threads, on a body whose vectors are summed in several chunks: a box of 8000 elements with 9261
//! nodes, where a chunk has 4096.

mod common;

use common::{Numbers, elasticity, held, nodes_where};
use hex_mesh::{HexMesh, Quadrature};
use nalgebra::Vector3;
use pd_solver::{
    AdjointOptions, Method, NodalVector, Parameters, SolveOptions, Solver, Status, Stop,
};

/// What has to be equal, to the last bit.
#[derive(Debug, PartialEq)]
struct Answer {
    status: Status,
    iterations: usize,
    energy: f64,
    positions: NodalVector,
    multiplier: NodalVector,
    gradient: Option<Parameters>,
}

/// Smooth stretches with noise in every sample, from mild to a fifth.
fn actuation(mesh: &HexMesh, count: usize) -> Vec<[f64; 6]> {
    let mut all = Numbers::new(5).actuation(count, 0.02);
    for (b, x) in all.iter_mut().zip(mesh.sample_positions()) {
        let bend = 0.2 * (x.z - 1.0);
        b[0] += bend;
        b[3] -= 0.5 * bend;
    }
    all
}

/// One solve and, where it converged, its adjoint.
fn answer(method: Method, max_iterations: usize) -> Answer {
    let mesh = HexMesh::solid_box([20, 20, 20], 0.1, Quadrature::Eight).unwrap();
    assert!(mesh.nodes().len() > 2 * 4096);
    let wall = nodes_where(&mesh, |x| x.x == 0.0);
    let mut solver = Solver::new(&mesh, &[elasticity(), held(wall)]).unwrap();
    let mut parameters = solver.rest_parameters();
    parameters.actuation = actuation(&mesh, parameters.actuation.len());
    let options = SolveOptions {
        method,
        max_iterations,
        ..SolveOptions::new(Stop::RelativeGradient(1e-6))
    };
    let solution = solver.solve(&parameters, None, &options).unwrap();
    let (mut multiplier, mut gradient) = (Vec::new(), None);
    if solution.status == Status::Converged {
        let cotangent: Vec<Vector3<f64>> = Numbers::new(9).vectors(mesh.nodes().len(), 1.0);
        let options = AdjointOptions {
            tolerance: 1e-6,
            ..AdjointOptions::default()
        };
        let adjoint = solver
            .adjoint(&parameters, &solution, &cotangent, &options)
            .unwrap();
        (multiplier, gradient) = (adjoint.multiplier, adjoint.gradient);
    }
    Answer {
        status: solution.status,
        iterations: solution.stats.iterations,
        energy: solution.stats.energy,
        positions: solution.positions,
        multiplier,
        gradient,
    }
}

#[track_caller]
fn check(method: Method, max_iterations: usize, is_solved: bool) {
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let pool = pool.build().unwrap();
        pool.install(|| answer(method, max_iterations))
    };
    let one = on(1);
    assert_eq!(one.gradient.is_some(), is_solved, "{:?}", one.status);
    for threads in [2, 3] {
        assert!(on(threads) == one, "{method:?} with {threads} threads");
    }
}

#[test]
fn multigrid_and_its_adjoint_give_the_same_bits() {
    check(Method::Multigrid, 2000, true);
}

#[test]
fn newton_and_its_adjoint_give_the_same_bits() {
    check(Method::Newton, 2000, true);
}

#[test]
fn lbfgs_and_its_adjoint_give_the_same_bits() {
    check(Method::Lbfgs, 2000, true);
}

/// The slow methods as far as they come in a few steps.
#[test]
fn anderson_gives_the_same_bits() {
    check(Method::Anderson, 8, false);
}

#[test]
fn local_global_gives_the_same_bits() {
    check(Method::LocalGlobal, 8, false);
}
