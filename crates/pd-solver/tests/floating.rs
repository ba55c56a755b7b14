//! Parts that nothing holds: their shape is an equilibrium, their place the convention's.

mod common;

use common::{Numbers, difference, dot, elasticity, held, max_distance, nodes_where};
use hex_mesh::{HexMesh, Quadrature};
use nalgebra::{Matrix3, Rotation3, Vector3};
use pd_solver::{
    AdjointOptions, AdjointStatus, EffectSpec, Method, SolveOptions, Solver, SolverError, Status,
    Stop,
};

const METHODS: [Method; 5] = [
    Method::LocalGlobal,
    Method::Anderson,
    Method::Lbfgs,
    Method::Multigrid,
    Method::Newton,
];

fn free_box(cells: [usize; 3]) -> (HexMesh, Solver) {
    let mesh = HexMesh::solid_box(cells, 0.25, Quadrature::Eight).unwrap();
    let solver = Solver::new(&mesh, &[elasticity(), EffectSpec::Floating {}]).unwrap();
    (mesh, solver)
}

fn centroid(x: &[Vector3<f64>]) -> Vector3<f64> {
    x.iter().sum::<Vector3<f64>>() / x.len() as f64
}

#[test]
fn a_free_body_takes_the_shape_it_wants_and_the_place_of_the_convention() {
    // The larger one has a hierarchy.
    for cells in [[4, 3, 2], [12, 8, 8]] {
        let (mesh, mut solver) = free_box(cells);
        let a = Matrix3::new(1.2, 0.1, 0.0, 0.1, 0.9, -0.2, 0.0, -0.2, 1.1);
        let mut parameters = solver.rest_parameters();
        let b = [0.2, 0.1, 0.0, -0.1, -0.2, 0.1];
        parameters.actuation.fill(b);
        let middle = centroid(mesh.nodes());
        let wanted = mesh.nodes().iter().map(|x| middle + a * (x - middle));
        let wanted: Vec<_> = wanted.collect();
        // Wherever it starts.
        let turn = Rotation3::new(Vector3::new(0.4, -1.1, 0.3));
        let far = mesh
            .nodes()
            .iter()
            .map(|x| turn * x + Vector3::new(3.0, -2.0, 7.0));
        let far: Vec<_> = far.collect();
        for method in METHODS {
            for start in [None, Some(&far[..])] {
                let options = SolveOptions::new(Stop::Accuracy(1e-9)).with_method(method);
                let solution = solver.solve(&parameters, start, &options).unwrap();
                assert_eq!(solution.status, Status::Converged, "{method:?}");
                let x = &solution.positions;
                for from in [0, 7, x.len() - 1] {
                    for to in 0..x.len() {
                        let (found, told) = (x[to] - x[from], wanted[to] - wanted[from]);
                        let off = (found.norm() - told.norm()).abs();
                        assert!(off < 1e-8, "{method:?}: {off}");
                    }
                }
                // The convention.
                assert!((centroid(x) - middle).norm() < 1e-12);
                let arms = mesh.nodes().iter().zip(x);
                let turned: Vector3<f64> =
                    arms.map(|(r, x)| (r - middle).cross(&(x - middle))).sum();
                assert!(turned.norm() < 1e-10, "{turned}");
            }
        }
    }
}

#[test]
fn gradients_follow_the_convention() {
    for cells in [[4, 3, 2], [8, 8, 8]] {
        let (_, mut solver) = free_box(cells);
        let mut numbers = Numbers::new(3);
        let mut parameters = solver.rest_parameters();
        let count = parameters.actuation.len();
        parameters.actuation = numbers.actuation(count, 0.2);
        let mut direction = parameters.clone();
        direction.actuation = numbers.actuation(count, 1.0);
        let cotangent = numbers.vectors(solver.rest().len(), 1.0);
        let options = SolveOptions::new(Stop::Accuracy(1e-11)).with_method(Method::Newton);
        let here = solver.solve(&parameters, None, &options).unwrap();
        let adjoint = solver
            .adjoint(&parameters, &here, &cotangent, &AdjointOptions::default())
            .unwrap();
        assert_eq!(adjoint.status, AdjointStatus::Converged);
        let exact = adjoint.gradient.unwrap().dot(&direction);
        let start = here.positions.clone();
        let slope = difference(1e-4, |t| {
            let near = solver
                .solve(&parameters.moved(t, &direction), Some(&start), &options)
                .unwrap();
            dot(&near.positions, &cotangent)
        });
        assert!(
            (slope - exact).abs() < 1e-7 * exact.abs(),
            "{slope} {exact}"
        );
    }
}

#[test]
fn a_loss_that_only_sees_the_place_has_no_gradient() {
    let (_, mut solver) = free_box([4, 3, 2]);
    let mut parameters = solver.rest_parameters();
    let count = parameters.actuation.len();
    parameters.actuation = Numbers::new(5).actuation(count, 0.2);
    let options = SolveOptions::new(Stop::Accuracy(1e-10));
    let here = solver.solve(&parameters, None, &options).unwrap();
    let pushed = vec![Vector3::new(0.3, -1.0, 2.0); here.positions.len()];
    let adjoint = solver
        .adjoint(&parameters, &here, &pushed, &AdjointOptions::default())
        .unwrap();
    let gradient = adjoint.gradient.unwrap();
    let largest = gradient
        .actuation
        .iter()
        .flatten()
        .fold(0.0, |m: f64, b| m.max(b.abs()));
    assert!(largest < 1e-12, "{largest}");
}

/// One part held, one not: the first does not notice.
#[test]
fn a_part_floats_beside_one_that_is_held() {
    let cells = vec![[0, 0, 0], [1, 0, 0], [5, 0, 0], [6, 0, 0]];
    let origin = Vector3::zeros();
    let mesh = HexMesh::from_cells(cells, origin, 0.25, Quadrature::Eight).unwrap();
    let wall = nodes_where(&mesh, |x| x.x == 0.0);
    let effects = [elasticity(), held(wall.clone()), EffectSpec::Floating {}];
    let mut solver = Solver::new(&mesh, &effects).unwrap();
    let alone = HexMesh::from_cells(vec![[0, 0, 0], [1, 0, 0]], origin, 0.25, Quadrature::Eight);
    let mut without = Solver::new(&alone.unwrap(), &[elasticity(), held(wall)]).unwrap();
    let b = [0.2, 0.0, 0.1, -0.1, 0.0, 0.1];
    let options = SolveOptions::new(Stop::Accuracy(1e-10));
    let mut parameters = solver.rest_parameters();
    parameters.actuation.fill(b);
    let both = solver.solve(&parameters, None, &options).unwrap();
    let mut parameters = without.rest_parameters();
    parameters.actuation.fill(b);
    let one = without.solve(&parameters, None, &options).unwrap();
    let (first, second) = both.positions.split_at(one.positions.len());
    assert!(max_distance(first, &one.positions) < 1e-9);
    let rest = &mesh.nodes()[first.len()..];
    assert!((centroid(second) - centroid(rest)).norm() < 1e-12);
}

#[test]
fn what_nothing_holds_is_refused_unless_it_may_float() {
    let mesh = HexMesh::solid_box([2, 2, 2], 0.25, Quadrature::Eight).unwrap();
    let message = |effects: &[EffectSpec]| match Solver::new(&mesh, effects) {
        Err(error) => error,
        Ok(_) => panic!("not refused"),
    };
    let refused = message(&[elasticity()]);
    assert!(matches!(refused, SolverError::NotHeld { count: 27, .. }));
    assert!(refused.to_string().contains("`floating`"));
    let gravity = EffectSpec::Gravity {
        acceleration: [0.0, -9.81, 0.0],
        density: 1.0,
    };
    let falls = message(&[elasticity(), EffectSpec::Floating {}, gravity]);
    assert!(
        matches!(falls, SolverError::Falls { count: 27, .. }),
        "{falls}"
    );
}
