//! The adjoint against differences of full solves, and its statuses where there is no exact gradient.

mod common;

use common::{
    Numbers, clamped_box, difference, dot, elasticity, held, nodes_where, pressed_column,
};
use hex_mesh::{HexMesh, Quadrature};
use nalgebra::Vector3;
use pd_solver::{AdjointOptions, AdjointStatus, SolveOptions, Solver, Status, Stop};

/// A box that is held at one end and moved at the other, under a strong random actuation.
fn stretched_box() -> (HexMesh, Solver, pd_solver::Parameters) {
    let mesh = HexMesh::solid_box([5, 3, 3], 0.2, Quadrature::Eight).unwrap();
    let ends = nodes_where(&mesh, |x| x.x == 0.0 || x.x > 0.99);
    let solver = Solver::new(&mesh, &[elasticity(), held(ends)]).unwrap();
    let mut numbers = Numbers::new(21);
    let mut parameters = solver.rest_parameters();
    parameters.actuation = numbers.actuation(parameters.actuation.len(), 0.2);
    for x in &mut parameters.prescribed {
        if x.x > 0.9 {
            *x += Vector3::new(0.1, 0.05, -0.08) + numbers.vector() * 0.01;
        }
    }
    (mesh, solver, parameters)
}

fn exact() -> AdjointOptions {
    AdjointOptions {
        tolerance: 1e-13,
        ..AdjointOptions::default()
    }
}

/// Every single entry tried agrees with differences of the full solve to 1e-7 of the largest entry.
#[test]
fn entries_agree_with_differences_of_the_full_solve() {
    let (mesh, mut solver, parameters) = stretched_box();
    let at = solver.solve(&parameters, None, &common::tight()).unwrap();
    assert_eq!(at.status, Status::Converged);
    let target = Numbers::new(5).vectors(mesh.nodes().len(), 0.3);
    let loss = |u: &[Vector3<f64>]| -> f64 {
        let pairs = u.iter().zip(&target);
        pairs.map(|(u, t)| 0.5 * (u - t).norm_squared()).sum()
    };
    let cotangent: Vec<_> = (at.positions.iter().zip(&target))
        .map(|(u, t)| u - t)
        .collect();
    let adjoint = solver
        .adjoint(&parameters, &at, &cotangent, &exact())
        .unwrap();
    assert_eq!(adjoint.status, AdjointStatus::Converged);
    let gradient = adjoint.gradient.unwrap();
    let largest =
        |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, |a: f64, b| a.max(b.abs()));
    let scale = largest(&mut gradient.actuation.iter().flatten().copied());
    let mut perturbed = |change: &dyn Fn(&mut pd_solver::Parameters, f64)| {
        difference(2e-3, |t| {
            let mut p = parameters.clone();
            change(&mut p, t);
            let solution = solver.solve(&p, Some(&at.positions), &common::tight());
            loss(&solution.unwrap().positions)
        })
    };
    for sample in [0, 37, 111, 200, 359] {
        for entry in 0..6 {
            let slope = perturbed(&|p, t| p.actuation[sample][entry] += t);
            let error = (slope - gradient.actuation[sample][entry]).abs() / scale;
            assert!(error < 1e-7, "actuation {sample}, {entry}: {error:e}");
        }
    }
    let scale = largest(&mut gradient.prescribed.iter().flat_map(|v| [v.x, v.y, v.z]));
    for node in [0, 7, 20, 31] {
        for axis in 0..3 {
            let slope = perturbed(&|p, t| p.prescribed[node][axis] += t);
            let error = (slope - gradient.prescribed[node][axis]).abs() / scale;
            assert!(error < 1e-7, "prescribed {node}, {axis}: {error:e}");
        }
    }
}

#[test]
fn a_state_that_is_no_equilibrium_gets_no_gradient() {
    let (mesh, mut solver, parameters) = stretched_box();
    let cotangent = Numbers::new(6).vectors(mesh.nodes().len(), 1.0);
    let hasty = SolveOptions {
        max_iterations: 2,
        ..common::tight()
    };
    let unfinished = solver.solve(&parameters, None, &hasty).unwrap();
    assert_eq!(unfinished.status, Status::IterationLimit);
    let refused = solver
        .adjoint(&parameters, &unfinished, &cotangent, &exact())
        .unwrap();
    assert_eq!(refused.status, AdjointStatus::ForwardNotConverged);
    assert!(refused.gradient.is_none());

    let mut moved = solver.solve(&parameters, None, &common::tight()).unwrap();
    moved.positions[30] += Vector3::new(1e-3, 0.0, 0.0);
    let refused = solver
        .adjoint(&parameters, &moved, &cotangent, &exact())
        .unwrap();
    assert_eq!(refused.status, AdjointStatus::ForwardNotConverged);
}

/// A column pressed together along its axis without room to buckle symmetrically stays straight: a saddle. The adjoint
/// there must notice the negative curvature and say so.
#[test]
fn negative_curvature_is_noticed_and_said() {
    let (mesh, mut solver, parameters, straight) = pressed_column(0.7, vec![]);
    let options = SolveOptions::new(Stop::RelativeGradient(1e-12));
    let saddle = solver
        .solve(&parameters, Some(&straight), &options)
        .unwrap();
    assert_eq!(saddle.status, Status::Converged);
    let middle = saddle
        .positions
        .iter()
        .map(|x| (x.y - 0.1).abs())
        .fold(0.0, f64::max);
    assert!(middle < 0.15, "stayed straight: {middle}");
    let cotangent = Numbers::new(8).vectors(mesh.nodes().len(), 1.0);
    let adjoint = solver
        .adjoint(&parameters, &saddle, &cotangent, &AdjointOptions::default())
        .unwrap();
    assert!(adjoint.stats.negative_curvature);
    assert_eq!(adjoint.status, AdjointStatus::ConvergedIndefinite);

    // MINRES still solves the linear system: check it by one more difference, of the stationarity condition.
    let direction = Numbers::new(9).vectors(mesh.nodes().len(), 1.0);
    let gradient = adjoint.gradient.unwrap();
    assert!(gradient.actuation.iter().flatten().all(|x| x.is_finite()));
    assert!(dot(&direction, &direction) > 0.0 && adjoint.stats.relative_residual < 1e-8);
}

#[test]
fn cotangents_of_any_size() {
    let (mesh, mut solver, parameters) = stretched_box();
    let at = solver.solve(&parameters, None, &common::tight()).unwrap();
    let unit = Numbers::new(6).vectors(mesh.nodes().len(), 1.0);
    let gradient = |solver: &mut Solver, scale: f64| {
        let cotangent: Vec<_> = unit.iter().map(|v| v * scale).collect();
        let adjoint = solver
            .adjoint(&parameters, &at, &cotangent, &exact())
            .unwrap();
        (adjoint.status, adjoint.gradient)
    };
    let (_, reference) = gradient(&mut solver, 1.0);
    let reference = reference.unwrap();
    for scale in [1e-290, 1e290] {
        let (status, scaled) = gradient(&mut solver, scale);
        assert_eq!(status, AdjointStatus::Converged, "{scale:e}");
        for (a, b) in scaled.unwrap().actuation.iter().zip(&reference.actuation) {
            for (a, b) in a.iter().zip(b) {
                assert!((a / scale - b).abs() < 1e-9, "{scale:e}: {a} {b}");
            }
        }
    }
    let (status, zero) = gradient(&mut solver, 0.0);
    assert_eq!(status, AdjointStatus::Converged);
    assert!(zero.unwrap().actuation.iter().flatten().all(|&x| x == 0.0));
    let (status, none) = gradient(&mut solver, f64::NAN);
    assert_eq!(status, AdjointStatus::NotFinite);
    assert!(none.is_none());
}

/// Prescribed nodes that move rigidly move everything rigidly: the gradient by a common shift is the sum of the cotangent.
#[test]
fn a_common_shift_of_the_wall_shifts_everything() {
    let (mesh, mut solver) = clamped_box(Quadrature::Eight);
    let mut parameters = solver.rest_parameters();
    parameters.actuation = Numbers::new(2).actuation(parameters.actuation.len(), 0.2);
    let at = solver.solve(&parameters, None, &common::tight()).unwrap();
    let cotangent = Numbers::new(4).vectors(mesh.nodes().len(), 1.0);
    let adjoint = solver
        .adjoint(&parameters, &at, &cotangent, &exact())
        .unwrap();
    let by_wall: Vector3<f64> = adjoint.gradient.unwrap().prescribed.iter().sum();
    let by_all: Vector3<f64> = cotangent.iter().sum();
    assert!((by_wall - by_all).norm() < 1e-9);
}
