//! Equilibria against analytic answers, methods against each other, stopping rules against the truth.

mod common;

use common::{Numbers, clamped_box, elasticity, held, max_distance, nodes_where};
use hex_mesh::{HexMesh, Quadrature};
use nalgebra::{Matrix3, Vector3};
use pd_solver::{
    EffectSpec, Estimate, Method, NodeSet, SolveOptions, Solver, SolverError, SpringPoints, Status,
    Stop,
};

const METHODS: [Method; 5] = [
    Method::LocalGlobal,
    Method::Anderson,
    Method::Lbfgs,
    Method::Multigrid,
    Method::Newton,
];

/// A body that is held at one node only can take the shape its actuation asks for, exactly, turned by any rotation.
#[test]
fn constant_actuation_gives_the_affine_shape() {
    let b = [0.3, 0.05, -0.1, -0.2, 0.08, 0.15];
    let a = polar_grad::actuation_from_b(&b);
    for quadrature in [Quadrature::One, Quadrature::Eight, Quadrature::TwentySeven] {
        let mesh = HexMesh::solid_box([5, 4, 3], 0.2, quadrature).unwrap();
        let node = 17;
        let mut solver = Solver::new(&mesh, &[elasticity(), held(vec![node])]).unwrap();
        let mut parameters = solver.rest_parameters();
        parameters.actuation.fill(b);
        let anchor = mesh.nodes()[node as usize];
        for method in METHODS {
            let options = common::tight().with_method(method);
            let solution = solver.solve(&parameters, None, &options).unwrap();
            let pairs = mesh.nodes().iter().zip(&solution.positions);
            let turned: Matrix3<f64> = pairs
                .map(|(x, u)| (u - anchor) * (a * (x - anchor)).transpose())
                .sum();
            let rotation = polar_grad::polar_rotation(&turned);
            let place = |x: &Vector3<f64>| anchor + rotation * a * (x - anchor);
            let expected: Vec<_> = mesh.nodes().iter().map(place).collect();
            let error = max_distance(&solution.positions, &expected);
            assert!(error < 1e-9, "{method:?} {quadrature:?}: {error:e}");
            assert!(solution.stats.energy < 1e-18);
        }
    }
}

/// What is measured at the end of a solve is the distance that a tight solve finds, and what was asked holds.
#[test]
fn a_measured_error_is_the_error() {
    let mesh = HexMesh::solid_box([12, 6, 6], 1.0 / 6.0, Quadrature::Eight).unwrap();
    let wall = nodes_where(&mesh, |x| x.x == 0.0);
    let mut solver = Solver::new(&mesh, &[elasticity(), held(wall)]).unwrap();
    let mut parameters = solver.rest_parameters();
    for (b, x) in parameters.actuation.iter_mut().zip(mesh.sample_positions()) {
        let s = 0.4 * (2.0 * x.z - 1.0);
        *b = [s, 0.05 * (6.0 * x.x).sin(), 0.0, -0.2 * s, 0.0, -0.5 * s];
    }
    let reference = solver.solve(&parameters, None, &common::tight()).unwrap();
    for method in METHODS {
        for accuracy in [1e-1, 1e-3, 1e-5] {
            let options = SolveOptions::new(Stop::Accuracy(accuracy)).with_method(method);
            let options = options.measuring_error();
            let solution = solver.solve(&parameters, None, &options).unwrap();
            let error = max_distance(&solution.positions, &reference.positions);
            let told = solution.stats.estimated_error.unwrap();
            assert_eq!(solution.stats.estimate, Estimate::Measured);
            assert!(error < 1.1 * accuracy, "{method:?} {accuracy}: {error}");
            assert!(
                (told / error - 1.0).abs() < 0.3,
                "{method:?} {accuracy}: {told} {error}"
            );
        }
    }
}

/// The same through a rigid motion of a whole face: rotation and actuation do not mix.
#[test]
fn a_rotated_wall_rotates_the_body() {
    let (mesh, mut solver) = clamped_box(Quadrature::Eight);
    let rotation = *nalgebra::Rotation3::from_euler_angles(0.4, -0.7, 1.1).matrix();
    let b = [0.2, 0.0, 0.0, 0.0, 0.0, 0.0];
    let mut parameters = solver.rest_parameters();
    parameters.actuation.fill(b);
    for x in &mut parameters.prescribed {
        *x = rotation * *x + Vector3::new(3.0, -1.0, 0.5);
    }
    let place = |x: &Vector3<f64>| {
        rotation * (polar_grad::actuation_from_b(&b) * x) + Vector3::new(3.0, -1.0, 0.5)
    };
    let expected: Vec<_> = mesh.nodes().iter().map(place).collect();
    for method in METHODS {
        let options = SolveOptions::new(Stop::Accuracy(1e-9)).with_method(method);
        let solution = solver.solve(&parameters, None, &options).unwrap();
        assert_eq!(solution.status, Status::Converged, "{method:?}");
        let error = max_distance(&solution.positions, &expected);
        assert!(error < 1e-8, "{method:?}: {error:e}");
    }
}

/// A bar hanging under its weight: for small loads `u_z = (rho g / E) (L z - z^2 / 2)`, with E the stiffness along the axis,
/// which for |F - R|^2 / 2 with lateral strain free is the stiffness itself.
#[test]
fn a_hanging_bar_stretches_as_the_textbook_says() {
    let mesh = HexMesh::solid_box([2, 2, 16], 0.125, Quadrature::Eight).unwrap();
    let top = nodes_where(&mesh, |x| x.z == 2.0);
    let load = 1e-4;
    let gravity = EffectSpec::Gravity {
        acceleration: [0.0, 0.0, -load],
        density: 1.0,
    };
    let mut solver = Solver::new(&mesh, &[elasticity(), held(top), gravity]).unwrap();
    let parameters = solver.rest_parameters();
    let solution = solver.solve(&parameters, None, &common::tight()).unwrap();
    for (x, u) in mesh.nodes().iter().zip(&solution.positions) {
        let depth = 2.0 - x.z;
        let sag = load * (2.0 * depth - depth * depth / 2.0);
        assert!((x.z - u.z - sag).abs() < 1e-3 * load, "{x}: {}", x.z - u.z);
    }
}

#[test]
fn methods_agree_and_none_ends_above_local_global() {
    let (_, mut solver) = clamped_box(Quadrature::Eight);
    let mut parameters = solver.rest_parameters();
    parameters.actuation = Numbers::new(3).actuation(parameters.actuation.len(), 0.25);
    let solve = |solver: &mut Solver, method| {
        let options = SolveOptions {
            max_iterations: 20_000,
            ..common::tight().with_method(method)
        };
        solver.solve(&parameters, None, &options).unwrap()
    };
    let reference = solve(&mut solver, Method::LocalGlobal);
    for method in METHODS.into_iter().skip(1) {
        let other = solve(&mut solver, method);
        assert_eq!(other.status, Status::Converged, "{method:?}");
        let distance = max_distance(&reference.positions, &other.positions);
        assert!(distance < 1e-9, "{method:?}: {distance:e}");
        assert!(other.stats.iterations < reference.stats.iterations / 3);
    }
}

/// The energy guard of Anderson acceleration: stopped after any number of steps, the energy is never above that of one step
/// less, although some accelerated points are (each costs one more evaluation).
#[test]
fn accelerated_energies_never_rise() {
    let (_, mut solver) = clamped_box(Quadrature::Eight);
    let mut parameters = solver.rest_parameters();
    parameters.actuation = Numbers::new(7).actuation(parameters.actuation.len(), 1.5);
    let mut last = f64::INFINITY;
    let mut dropped = 0;
    for steps in 1..40 {
        let options = SolveOptions {
            max_iterations: steps,
            ..SolveOptions::new(Stop::RelativeGradient(1e-12)).with_method(Method::Anderson)
        };
        let before = solver.work().evaluations;
        let solution = solver.solve(&parameters, None, &options).unwrap();
        assert_eq!(solution.stats.iterations, steps);
        // One evaluation is that at rest, one that of the start.
        dropped = solution.stats.work.evaluations - before - 2 - steps as u64;
        let energy = solution.stats.energy;
        assert!(
            energy <= last * (1.0 + 1e-13),
            "step {steps}: {energy} after {last}"
        );
        last = energy;
    }
    assert!(dropped > 0, "the guard was never needed");
}

/// Asked for a length, every method delivers it, from loose to tight.
#[test]
fn accuracy_in_length_units_is_kept() {
    let (_, mut solver) = clamped_box(Quadrature::Eight);
    for seed in 0..8 {
        let mut parameters = solver.rest_parameters();
        let strength = 0.05 + 0.04 * seed as f64;
        parameters.actuation = Numbers::new(seed).actuation(parameters.actuation.len(), strength);
        let truth = solver.solve(&parameters, None, &common::tight()).unwrap();
        for accuracy in [1e-3, 1e-5, 1e-7] {
            for method in METHODS {
                let options = SolveOptions::new(Stop::Accuracy(accuracy)).with_method(method);
                let solution = solver.solve(&parameters, None, &options).unwrap();
                assert_eq!(solution.status, Status::Converged);
                let error = max_distance(&truth.positions, &solution.positions);
                assert!(
                    error <= 2.0 * accuracy,
                    "{method:?}, seed {seed}: asked {accuracy:e}, reached {error:e}"
                );
            }
        }
    }
}

#[test]
fn the_same_bits_for_any_number_of_threads() {
    let solve = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        pool.build().unwrap().install(|| {
            let mesh = HexMesh::solid_box([9, 8, 7], 0.1, Quadrature::Eight).unwrap();
            let wall = nodes_where(&mesh, |x| x.x == 0.0);
            let mut solver = Solver::new(&mesh, &[elasticity(), held(wall)]).unwrap();
            let mut parameters = solver.rest_parameters();
            parameters.actuation = Numbers::new(5).actuation(parameters.actuation.len(), 0.2);
            let options = SolveOptions::new(Stop::Accuracy(1e-6));
            solver.solve(&parameters, None, &options).unwrap().positions
        })
    };
    assert_eq!(solve(1), solve(3));
}

#[test]
fn an_inverted_start_finds_the_rest_shape_or_says_it_did_not() {
    let (mesh, mut solver) = clamped_box(Quadrature::Eight);
    let parameters = solver.rest_parameters();
    let mirrored: Vec<_> = (mesh.nodes().iter())
        .map(|x| Vector3::new(-x.x, x.y, x.z))
        .collect();
    let options = SolveOptions::new(Stop::Accuracy(1e-8));
    let solution = solver
        .solve(&parameters, Some(&mirrored), &options)
        .unwrap();
    assert!(
        solution
            .positions
            .iter()
            .all(|x| x.iter().all(|v| v.is_finite()))
    );
    if solution.status == Status::Converged && solution.stats.energy < 1e-12 {
        assert!(max_distance(&solution.positions, mesh.nodes()) < 1e-6);
    }
}

#[test]
fn bad_input_is_refused_with_its_place() {
    let mesh = common::small_box(Quadrature::Eight);
    let refused = |effects: &[EffectSpec]| Solver::new(&mesh, effects).err().expect("refused");
    assert_eq!(refused(&[]), SolverError::NoElasticity);
    assert!(matches!(
        refused(&[elasticity()]),
        SolverError::NotHeld { count: 60, .. }
    ));
    assert!(matches!(
        refused(&[elasticity(), elasticity()]),
        SolverError::DuplicateEffect { index: 1, .. }
    ));
    assert!(matches!(
        refused(&[elasticity(), held(vec![60])]),
        SolverError::OutOfRange {
            index: 1,
            found: 60,
            ..
        }
    ));
    assert!(matches!(
        refused(&[elasticity(), held(vec![0, 3]), held(vec![3])]),
        SolverError::PrescribedTwice { index: 2, node: 3 }
    ));
    let negative = EffectSpec::Springs {
        points: SpringPoints::Nodes(NodeSet::Indices(vec![1])),
        stiffness: -1.0,
    };
    assert!(matches!(
        refused(&[elasticity(), negative]),
        SolverError::BadValue {
            field: "stiffness",
            ..
        }
    ));

    let (_, mut solver) = clamped_box(Quadrature::Eight);
    let options = SolveOptions::new(Stop::Accuracy(1e-3));
    let mut parameters = solver.rest_parameters();
    parameters.actuation[5][2] = f64::NAN;
    let error = solver.solve(&parameters, None, &options).unwrap_err();
    assert_eq!(
        error,
        SolverError::NotFinite {
            what: "actuation",
            index: 5
        }
    );
    parameters.actuation.pop();
    assert!(matches!(
        solver.solve(&parameters, None, &options),
        Err(SolverError::WrongLength {
            what: "actuation",
            ..
        })
    ));
    let parameters = solver.rest_parameters();
    let never = SolveOptions::new(Stop::Accuracy(0.0));
    assert!(matches!(
        solver.solve(&parameters, None, &never),
        Err(SolverError::BadStop { .. })
    ));
}

/// What is not listed costs nothing: the counts of a scene are those of its own effects, an effect that is listed but does
/// nothing changes no bit of the positions, and all of them together only add what they are.
#[test]
fn an_absent_effect_is_free() {
    let mesh = common::small_box(Quadrature::Eight);
    let wall = nodes_where(&mesh, |x| x.x == 0.0);
    let base = vec![elasticity(), held(wall)];
    let idle_gravity = EffectSpec::Gravity {
        acceleration: [0.0; 3],
        density: 1.0,
    };
    let no_springs = EffectSpec::Springs {
        points: SpringPoints::Nodes(NodeSet::Indices(vec![])),
        stiffness: 1.0,
    };
    let run = |effects: &[EffectSpec]| {
        let mut solver = Solver::new(&mesh, effects).unwrap();
        let mut parameters = solver.rest_parameters();
        parameters.actuation = Numbers::new(11).actuation(parameters.actuation.len(), 0.2);
        let options = SolveOptions::new(Stop::Accuracy(1e-8));
        solver.solve(&parameters, None, &options).unwrap()
    };
    let plain = run(&base);
    let work = plain.stats.work;
    // Pairs of free nodes that share a cell: 4 x 4 x 3 free nodes, each pair once.
    let (pairs, free) = (along(4) * along(4) * along(3), 48);
    assert_eq!(work.matrix_nonzeros, (pairs - free) / 2 + free);
    assert_eq!(work.factorisations, 1);
    assert_eq!(work.local_projections, work.evaluations * 24 * 8);
    for idle in [idle_gravity, no_springs] {
        let mut effects = base.clone();
        effects.push(idle);
        let with_idle = run(&effects);
        assert_eq!(plain.positions, with_idle.positions);
        assert_eq!(work.matrix_nonzeros, with_idle.stats.work.matrix_nonzeros);
        assert_eq!(
            work.local_projections,
            with_idle.stats.work.local_projections
        );
        assert!(with_idle.stats.work.effect_bytes >= work.effect_bytes);
    }

    /// Ordered pairs of neighbours, a point and itself included, on a line of n points.
    fn along(n: usize) -> usize {
        3 * n - 2
    }
}

/// F from a smooth map, its stretch as actuation, boundary values from the map: positions converge at second order.
#[test]
fn a_manufactured_solution_converges_at_second_order() {
    let phi = |x: &Vector3<f64>| {
        Vector3::new(
            x.x + 0.15 * (1.5 * x.y).sin() * x.z,
            1.1 * x.y + 0.2 * x.x * x.x,
            0.9 * x.z + 0.1 * (x.x + x.y).cos(),
        )
    };
    let gradient = |x: &Vector3<f64>| {
        let s = -0.1 * (x.x + x.y).sin();
        Matrix3::new(
            1.0,
            0.225 * (1.5 * x.y).cos() * x.z,
            0.15 * (1.5 * x.y).sin(),
            0.4 * x.x,
            1.1,
            0.0,
            s,
            s,
            0.9,
        )
    };
    let error = |cells: usize| {
        let mesh = HexMesh::solid_box([cells; 3], 1.0 / cells as f64, Quadrature::Eight).unwrap();
        let inner = |v: f64| v > 1e-9 && v < 1.0 - 1e-9;
        let boundary = nodes_where(&mesh, |x| !x.iter().all(|&v| inner(v)));
        let mut solver = Solver::new(&mesh, &[elasticity(), held(boundary.clone())]).unwrap();
        let mut parameters = solver.rest_parameters();
        for (b, x) in parameters.actuation.iter_mut().zip(mesh.sample_positions()) {
            let s = polar_grad::polar(&gradient(&x)).stretch - Matrix3::identity();
            *b = polar_grad::symmetric_entries(&s);
        }
        for (p, &node) in parameters.prescribed.iter_mut().zip(&boundary) {
            *p = phi(&mesh.nodes()[node as usize]);
        }
        let options = SolveOptions::new(Stop::RelativeGradient(1e-10));
        let solution = solver.solve(&parameters, None, &options).unwrap();
        assert_eq!(solution.status, Status::Converged);
        let squares = mesh.nodes().iter().zip(&solution.positions);
        let sum: f64 = squares.map(|(x, u)| (u - phi(x)).norm_squared()).sum();
        (sum / mesh.nodes().len() as f64).sqrt()
    };
    let errors: Vec<f64> = [3, 6, 12, 24].map(error).to_vec();
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!(order > 1.8, "errors {errors:?}: order {order}");
    }
}
