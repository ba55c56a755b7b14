//! What an adjoint does with the result that it overwrites, with limits, and next to singular states.

mod common;

use common::{Numbers, elasticity, held, nodes_where, pressed_column};
use hex_mesh::{HexMesh, Quadrature};
use nalgebra::{Matrix3, Vector3};
use pd_solver::{
    Adjoint, AdjointOptions, AdjointStatus, EffectSpec, NodeSet, Parameters, Solution,
    SolveOptions, Solver, SpringPoints, Status, Stop, deformation_gradients,
};

struct Case {
    mesh: HexMesh,
    solver: Solver,
    parameters: Parameters,
    at: Solution,
}

/// A box that is pulled and actuated, in equilibrium.
fn pulled_box(extra: impl FnOnce(&HexMesh) -> Vec<EffectSpec>) -> Case {
    let mesh = HexMesh::solid_box([5, 3, 3], 0.2, Quadrature::Eight).unwrap();
    let ends = nodes_where(&mesh, |x| x.x == 0.0 || x.x > 0.99);
    let mut effects = vec![elasticity(), held(ends)];
    effects.extend(extra(&mesh));
    let mut solver = Solver::new(&mesh, &effects).unwrap();
    let mut parameters = solver.rest_parameters();
    parameters.actuation = Numbers::new(21).actuation(parameters.actuation.len(), 0.2);
    for x in &mut parameters.prescribed {
        x.x *= 1.2;
    }
    let at = solver.solve(&parameters, None, &common::tight()).unwrap();
    assert_eq!(at.status, Status::Converged);
    Case {
        mesh,
        solver,
        parameters,
        at,
    }
}

impl Case {
    fn cotangent(&self, seed: u64, size: f64) -> Vec<Vector3<f64>> {
        Numbers::new(seed).vectors(self.mesh.nodes().len(), size)
    }

    fn adjoint(&mut self, cotangent: &[Vector3<f64>], warm_start: bool, out: &mut Adjoint) {
        let options = AdjointOptions {
            tolerance: 1e-9,
            warm_start,
            ..AdjointOptions::default()
        };
        self.solver
            .adjoint_into(&self.parameters, &self.at, cotangent, &options, out)
            .unwrap();
    }
}

/// The multiplier of the same cotangent needs no iteration, that of a similar one fewer; the gradient is the same to the tolerance.
#[test]
fn a_warm_start_saves_iterations_and_changes_nothing_else() {
    let mut case = pulled_box(|_| vec![]);
    let cotangent = case.cotangent(1, 7.0);
    let mut cold = Adjoint::default();
    case.adjoint(&cotangent, false, &mut cold);
    assert!(cold.stats.iterations > 5, "{:?}", cold.stats);
    let similar: Vec<_> = { cotangent.iter().zip(case.cotangent(2, 1e-6)) }
        .map(|(a, b)| a + b)
        .collect();
    for (cotangent, most) in [(&cotangent, 1), (&similar, cold.stats.iterations / 2 + 1)] {
        let mut warm = cold.clone();
        case.adjoint(cotangent, true, &mut warm);
        assert_eq!(warm.status, AdjointStatus::Converged);
        assert!(warm.stats.iterations <= most, "{:?}", warm.stats);
        let mut fresh = Adjoint::default();
        case.adjoint(cotangent, false, &mut fresh);
        let pairs = { warm.gradient.unwrap().actuation }
            .into_iter()
            .zip(fresh.gradient.unwrap().actuation);
        for (a, b) in pairs {
            let error = a.iter().zip(b).map(|(a, b)| (a - b).abs());
            assert!(error.fold(0.0, f64::max) < 1e-7);
        }
    }
}

/// Without a warm start, and with one that there is nothing for, results have the bits of a first call, whatever was there before.
#[test]
fn what_a_result_held_before_does_not_matter_to_a_cold_start() {
    let mut case = pulled_box(|_| vec![]);
    let (first, other) = (case.cotangent(1, 1.0), case.cotangent(2, 3.0));
    let mut expected = Adjoint::default();
    case.adjoint(&first, false, &mut expected);
    // The multiplier of half the cotangent would be a good start.
    let half: Vec<_> = first.iter().map(|v| v * 0.5).collect();
    for before in [&other, &half] {
        let mut used = Adjoint::default();
        case.adjoint(before, false, &mut used);
        case.adjoint(&first, false, &mut used);
        assert_eq!(used.multiplier, expected.multiplier);
        assert_eq!(used.gradient, expected.gradient);
    }
    let mut used = Adjoint::default();
    // A result of another body, and one that never was used, are no starts.
    for len in [0, 7] {
        case.adjoint(&other, false, &mut used);
        let mut unfit = Adjoint {
            multiplier: vec![Vector3::repeat(1e3); len],
            ..Adjoint::default()
        };
        case.adjoint(&first, true, &mut unfit);
        assert_eq!(unfit.multiplier, expected.multiplier, "{len}");
        assert_eq!(unfit.gradient, expected.gradient, "{len}");
    }
}

/// A loss that depends on nothing has the gradient zero, from a warm start too.
#[test]
fn no_cotangent_gives_no_gradient() {
    let mut case = pulled_box(|_| vec![]);
    let mut out = Adjoint::default();
    let cotangent = case.cotangent(1, 1.0);
    case.adjoint(&cotangent, false, &mut out);
    let none = vec![Vector3::zeros(); cotangent.len()];
    case.adjoint(&none, true, &mut out);
    assert_eq!(out.status, AdjointStatus::Converged);
    let gradient = out.gradient.unwrap();
    assert!(gradient.actuation.iter().flatten().all(|x| *x == 0.0));
    assert!(gradient.prescribed.iter().all(|x| *x == Vector3::zeros()));
}

/// The limit holds for each of the two methods, and what they took is added.
#[test]
fn iterations_of_both_methods_are_added() {
    let (mesh, mut solver, parameters, straight) = pressed_column(0.7, vec![]);
    let options = SolveOptions::new(Stop::RelativeGradient(1e-12));
    let saddle = solver
        .solve(&parameters, Some(&straight), &options)
        .unwrap();
    let cotangent = Numbers::new(8).vectors(mesh.nodes().len(), 1.0);
    let limited = |solver: &mut Solver, max_iterations| {
        let options = AdjointOptions {
            max_iterations,
            ..AdjointOptions::default()
        };
        solver
            .adjoint(&parameters, &saddle, &cotangent, &options)
            .unwrap()
    };
    let whole = limited(&mut solver, 2000);
    assert_eq!(whole.status, AdjointStatus::ConvergedIndefinite);
    // Enough to meet negative curvature, too few for MINRES.
    let limit = (2..whole.stats.iterations)
        .find(|&limit| limited(&mut solver, limit).stats.negative_curvature)
        .unwrap();
    let stopped = limited(&mut solver, limit);
    assert_eq!(stopped.status, AdjointStatus::IterationLimit);
    let iterations = stopped.stats.iterations;
    assert!((limit..=2 * limit).contains(&iterations), "{iterations}");
}

/// The smallest sum of two singular values of F A over all samples, whatever other effects there are.
#[test]
fn the_smallest_pair_sum_is_that_of_all_samples() {
    let springs = |mesh: &HexMesh| {
        vec![EffectSpec::Springs {
            points: SpringPoints::Nodes(NodeSet::Indices(nodes_where(mesh, |x| x.x == 0.4))),
            stiffness: 0.5,
        }]
    };
    let mut case = pulled_box(springs);
    let cotangent = case.cotangent(1, 1.0);
    let mut adjoint = Adjoint::default();
    case.adjoint(&cotangent, false, &mut adjoint);
    let samples = deformation_gradients(&case.mesh, &case.at.positions);
    assert_eq!(samples.len(), case.parameters.actuation.len());
    let sum = |(f, b): (&Matrix3<f64>, &[f64; 6])| {
        polar_grad::RotationGradient::at(&(f * polar_grad::actuation_from_b(b))).smallest_pair_sum
    };
    let pairs = samples.iter().zip(&case.parameters.actuation);
    let smallest = pairs.map(sum).fold(f64::INFINITY, f64::min);
    let found = adjoint.stats.smallest_pair_sum.unwrap();
    assert!((found / smallest - 1.0).abs() < 1e-10, "{found} {smallest}");
}
