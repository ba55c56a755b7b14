//! States without forces that are no minima: what leaves them, and what is told of them.

mod common;

use common::{elasticity, held, nodes_where, pressed_column};
use hex_mesh::{HexMesh, NodeRegion, Quadrature};
use nalgebra::Vector3;
use pd_solver::{
    AdjointOptions, AdjointStatus, EffectSpec, Method, Obstacle, Parameters, Solution,
    SolveOptions, Solver, Status, Stop,
};

const PRESSED: f64 = 0.8;

/// A column held at both ends, which are pressed together beyond what makes it buckle (4 pi^2 I / (A l^2) = 9 %), and where its nodes are
/// while it stays straight.
struct Column {
    mesh: HexMesh,
    solver: Solver,
    parameters: Parameters,
    straight: Vec<Vector3<f64>>,
}

impl Column {
    fn new(extra: Vec<EffectSpec>) -> Self {
        let (mesh, solver, parameters, straight) = pressed_column(PRESSED, extra);
        Self {
            mesh,
            solver,
            parameters,
            straight,
        }
    }

    fn solve(&mut self, options: &SolveOptions) -> Solution {
        let start = Some(&self.straight[..]);
        let solution = self.solver.solve(&self.parameters, start, options).unwrap();
        assert_eq!(solution.status, Status::Converged, "{:?}", options.method);
        solution
    }

    /// How far the middle of the column is from its axis.
    fn deflection(&self, solution: &Solution) -> f64 {
        let middle = nodes_where(&self.mesh, |x| (x.x - 0.6).abs() < 1e-9);
        let sum: Vector3<f64> = middle.iter().map(|&n| solution.positions[n as usize]).sum();
        let mean = sum / middle.len() as f64;
        (mean.y - 0.1).hypot(mean.z - 0.1)
    }

    /// Whether conjugate gradients meet negative curvature at the state.
    fn adjoint_status(&mut self, at: &Solution) -> AdjointStatus {
        let cotangent = common::Numbers::new(8).vectors(self.mesh.nodes().len(), 1.0);
        let options = AdjointOptions::default();
        let adjoint = self
            .solver
            .adjoint(&self.parameters, at, &cotangent, &options);
        adjoint.unwrap().status
    }
}

fn options(method: Method) -> SolveOptions {
    // Local steps alone creep towards a bent shape.
    let tolerance = match method {
        Method::LocalGlobal => 1e-5,
        _ => 1e-9,
    };
    SolveOptions {
        max_iterations: 20_000,
        ..SolveOptions::new(Stop::RelativeGradient(tolerance)).with_method(method)
    }
}

/// All methods leave the straight state, for the same energy, which is lower; the column is bent there, and nothing is negative any more.
#[test]
fn a_column_that_is_pressed_together_buckles_by_every_method() {
    let mut column = Column::new(vec![]);
    let straight = column.solve(&options(Method::Newton));
    assert!(column.deflection(&straight) < 1e-6);
    assert_eq!(
        column.adjoint_status(&straight),
        AdjointStatus::ConvergedIndefinite
    );
    let mut lowest = None;
    for method in [
        Method::Newton,
        Method::Lbfgs,
        Method::Multigrid,
        Method::LocalGlobal,
        Method::Anderson,
    ] {
        let bent = column.solve(&options(method).leaving_saddles());
        assert_eq!(bent.stats.negative_curvature, Some(false), "{method:?}");
        // Those before and after the saddle, which the limit is for.
        assert!((1..=20_000).contains(&bent.stats.iterations));
        let deflection = column.deflection(&bent);
        assert!(deflection > 0.1, "{method:?} {deflection}");
        assert!(
            bent.stats.energy < 0.9 * straight.stats.energy,
            "{method:?}"
        );
        let energy = *lowest.get_or_insert(bent.stats.energy);
        assert!(
            (bent.stats.energy / energy - 1.0).abs() < 1e-6,
            "{method:?}"
        );
        assert_eq!(column.adjoint_status(&bent), AdjointStatus::Converged);
    }
}

/// The limit is for all steps together, and what is told is their number: as many are enough, and one less is not.
#[test]
fn steps_before_and_after_a_saddle_are_counted() {
    let mut column = Column::new(vec![]);
    // Symmetric, so that the first equilibrium that is met is the straight one.
    for x in &mut column.straight {
        *x += Vector3::new(0.02 * (x.x * (0.96 - x.x)), 0.0, 0.0);
    }
    for method in [Method::Newton, Method::Anderson] {
        let ask = options(method).leaving_saddles();
        let whole = column.solve(&ask);
        assert!(column.deflection(&whole) > 0.1);
        let mut limited = |max_iterations| {
            let options = SolveOptions {
                max_iterations,
                ..ask
            };
            let start = Some(&column.straight[..]);
            column.solver.solve(&column.parameters, start, &options)
        };
        let enough = limited(whole.stats.iterations).unwrap();
        assert_eq!(enough.status, Status::Converged, "{method:?}");
        assert_eq!(enough.positions, whole.positions, "{method:?}");
        let short = limited(whole.stats.iterations - 1).unwrap();
        assert_eq!(short.status, Status::IterationLimit, "{method:?}");
    }
}

/// Where all iterations are used up, the solve says that the state is no minimum, or not what it is, but never that it is one.
#[test]
fn a_saddle_is_told_where_there_are_no_iterations_left_to_leave_it() {
    let column = Column::new(vec![]);
    let few = SolveOptions {
        max_iterations: 1,
        ..options(Method::Lbfgs).leaving_saddles()
    };
    let start = Some(&column.straight[..]);
    let mut solver = column.solver;
    let solution = solver.solve(&column.parameters, start, &few).unwrap();
    assert!(solution.stats.iterations <= 1, "{:?}", solution.stats);
    assert_ne!(solution.status, Status::Converged);
    assert_ne!(solution.stats.negative_curvature, Some(false));
}

/// A minimum that is found in a few steps is not looked at unless one asks, and is one if one does.
#[test]
fn an_easy_minimum_is_looked_at_on_request() {
    let mesh = HexMesh::solid_box([4, 2, 2], 0.1, Quadrature::Eight).unwrap();
    let ends = nodes_where(&mesh, |x| x.x == 0.0 || x.x > 0.39);
    let mut solver = Solver::new(&mesh, &[elasticity(), held(ends)]).unwrap();
    let mut parameters = solver.rest_parameters();
    for x in &mut parameters.prescribed {
        x.x *= 1.1;
    }
    let ask = options(Method::Newton);
    let plain = solver.solve(&parameters, None, &ask).unwrap();
    assert_eq!(plain.stats.negative_curvature, None);
    let looked = solver.solve(&parameters, None, &ask.leaving_saddles());
    let looked = looked.unwrap();
    assert_eq!(looked.stats.negative_curvature, Some(false));
    assert_eq!(looked.positions, plain.positions);
}

/// With walls beside it the column leaves the straight state as well, and no further than to a wall.
#[test]
fn a_column_between_walls_buckles_without_passing_them() {
    let plane = |normal: [f64; 3], offset| Obstacle::Plane { normal, offset };
    // The column fills 0 to 0.2.
    let (near, far) = (-0.06, 0.26);
    let walls = EffectSpec::Contact {
        region: Some(NodeRegion::Box {
            min: [0.25, -1.0, -1.0],
            max: [0.95, 1.0, 1.0],
        }),
        distance: 0.04,
        stiffness: Some(1.0),
        own: false,
        obstacles: vec![
            plane([0.0, 1.0, 0.0], near),
            plane([0.0, -1.0, 0.0], -far),
            plane([0.0, 0.0, 1.0], near),
            plane([0.0, 0.0, -1.0], -far),
        ],
    };
    let mut column = Column::new(vec![walls]);
    let straight = column.solve(&options(Method::Newton));
    let bent = column.solve(&options(Method::Newton).leaving_saddles());
    assert_eq!(bent.stats.negative_curvature, Some(false));
    assert!(bent.stats.energy < straight.stats.energy);
    let deflection = column.deflection(&bent);
    assert!(deflection > 0.02, "{deflection}");
    let touching = nodes_where(&column.mesh, |x| (0.25..0.95).contains(&x.x));
    for n in touching {
        let x = bent.positions[n as usize];
        assert!([x.y, x.z].iter().all(|x| (near..far).contains(x)), "{x}");
    }
}
