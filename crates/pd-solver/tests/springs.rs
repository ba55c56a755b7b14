//! Springs and loads at points inside elements, against sums by hand.

mod common;

use common::{Numbers, difference, dot, elasticity, held, nodes_where};
use hex_mesh::{HexMesh, NodeRegion, Quadrature, embed};
use nalgebra::Vector3;
use pd_solver::{EffectSpec, EmbeddedSurface, NodeSet, Solver, SolverError, SpringPoints};

/// At rest nothing is strained but the springs: the energy is `sum_p k f_p / 2 |d_p|^2` with targets off by `d_p`, and the forces on all nodes
/// add up to those of the springs.
#[test]
fn embedded_springs_pull_with_stiffness_times_factor() {
    let mesh = common::small_box(Quadrature::Eight);
    let wall = nodes_where(&mesh, |x| x.x == 0.0);
    let points: Vec<_> = (0..7)
        .map(|i| Vector3::new(0.55 + 0.06 * f64::from(i), 0.1 + 0.08 * f64::from(i), 0.3))
        .collect();
    let factors: Vec<f64> = (0..7).map(|i| 0.3 * f64::from(i)).collect();
    let stiffness = 2.5;
    let springs = EffectSpec::Springs {
        points: SpringPoints::Embedded {
            points: embed(&mesh, &points).unwrap().vertices().to_vec(),
            factors: factors.clone(),
        },
        stiffness,
    };
    let mut solver = Solver::new(&mesh, &[elasticity(), held(wall), springs]).unwrap();
    let mut parameters = solver.rest_parameters();
    for (target, point) in parameters.spring_targets.iter().zip(&points) {
        assert!((target - point).norm() < 1e-14);
    }
    let away = Numbers::new(3).vectors(points.len(), 0.2);
    for (target, d) in parameters.spring_targets.iter_mut().zip(&away) {
        *target += d;
    }
    let (energy, gradient) = solver.energy_gradient(&parameters, mesh.nodes()).unwrap();
    let pairs = || factors.iter().zip(&away);
    let expected: f64 = pairs()
        .map(|(f, d)| 0.5 * stiffness * f * d.norm_squared())
        .sum();
    assert!(
        (energy / expected - 1.0).abs() < 1e-12,
        "{energy} {expected}"
    );
    let force: Vector3<f64> = gradient.iter().sum();
    let pull: Vector3<f64> = pairs().map(|(f, d)| -d * (stiffness * f)).sum();
    // No point hangs on the wall, whose nodes have no gradient.
    assert!((force - pull).norm() < 1e-12, "{force} {pull}");
}

/// A surface whose vertices lie inside elements, each carried by eight nodes: its loads are the slopes of their energies.
#[test]
fn loads_between_nodes_are_slopes_of_their_energies() {
    let mesh = common::small_box(Quadrature::Eight);
    let wall = nodes_where(&mesh, |x| x.x == 0.0);
    let boundary = EmbeddedSurface::boundary(&mesh);
    let middle = Vector3::new(0.5, 0.375, 0.25);
    let inside: Vec<_> = { boundary.points.iter() }
        .map(|point| {
            let corners = mesh.elements()[point.element as usize].iter();
            let x: Vector3<f64> = corners
                .zip(&point.weights)
                .map(|(&n, w)| mesh.nodes()[n as usize] * *w)
                .sum();
            middle + (x - middle) * 0.83
        })
        .collect();
    let surface = EmbeddedSurface {
        points: embed(&mesh, &inside).unwrap().vertices().to_vec(),
        triangles: boundary.triangles,
    };
    let region = NodeRegion::HalfSpace {
        normal: [1.0, 0.0, 0.0],
        offset: 0.5,
    };
    let loads = [
        EffectSpec::Force {
            region: Some(region),
            force: [0.3, -0.2, 0.5],
        },
        EffectSpec::Pressure {
            region: None,
            capped: false,
            pressure: 0.7,
        },
    ];
    for load in loads {
        let effects = [elasticity(), held(wall.clone()), load.clone()];
        let mut solver = Solver::on_surface(&mesh, &surface, &effects).unwrap();
        let parameters = solver.rest_parameters();
        let mut numbers = Numbers::new(11);
        let state: Vec<_> = { mesh.nodes().iter() }
            .map(|x| x + numbers.vector() * 0.02)
            .collect();
        let mut direction = numbers.vectors(state.len(), 1.0);
        wall.iter()
            .for_each(|&n| direction[n as usize] = Vector3::zeros());
        let slope = difference(1e-4, |t| {
            let moved: Vec<_> = { state.iter().zip(&direction) }
                .map(|(x, d)| x + d * t)
                .collect();
            solver.energy_gradient(&parameters, &moved).unwrap().0
        });
        let (_, gradient) = solver.energy_gradient(&parameters, &state).unwrap();
        let exact = dot(&gradient, &direction);
        assert!(
            (slope / exact - 1.0).abs() < 1e-8,
            "{load:?} {slope} {exact}"
        );
    }
}

/// Vertices of which no three are the corners of a triangle have no area: a force on them is shared alike.
#[test]
fn a_force_on_single_vertices_is_shared_alike() {
    let mesh = common::small_box(Quadrature::Eight);
    let wall = nodes_where(&mesh, |x| x.x == 0.0);
    let force = Vector3::new(0.3, -0.2, 0.5);
    // The edge from (1, 0, 0) to (1, 0.75, 0): four nodes in a row.
    let edge = nodes_where(&mesh, |x| x.x == 1.0 && x.z == 0.0);
    let load = EffectSpec::Force {
        region: Some(NodeRegion::Box {
            min: [0.99, -0.01, -0.01],
            max: [1.01, 0.76, 0.01],
        }),
        force: force.into(),
    };
    let effects = [elasticity(), held(wall), load];
    let surface = EmbeddedSurface::boundary(&mesh);
    let mut solver = Solver::on_surface(&mesh, &surface, &effects).unwrap();
    let parameters = solver.rest_parameters();
    let (_, gradient) = solver.energy_gradient(&parameters, mesh.nodes()).unwrap();
    for (node, g) in gradient.iter().enumerate() {
        let share = if edge.contains(&(node as u32)) {
            0.25
        } else {
            0.0
        };
        assert!((g + force * share).norm() < 1e-14, "{node} {g}");
    }
}

/// Of two pieces one is prescribed; the other is held only if the springs are at one of its own nodes.
#[test]
fn springs_hold_the_piece_that_they_are_at() {
    let cells = vec![[0, 0, 0], [2, 0, 0]];
    let mesh = HexMesh::from_cells(cells, Vector3::zeros(), 1.0, Quadrature::Eight).unwrap();
    let with_springs_at = |x: f64| {
        let springs = EffectSpec::Springs {
            points: SpringPoints::Nodes(NodeSet::Indices(nodes_where(&mesh, |p| p.x == x))),
            stiffness: 1.0,
        };
        let wall = nodes_where(&mesh, |p| p.x == 0.0);
        Solver::new(&mesh, &[elasticity(), held(wall), springs])
    };
    assert!(with_springs_at(3.0).is_ok());
    let error = with_springs_at(1.0)
        .err()
        .expect("the second piece is loose");
    assert!(
        matches!(error, SolverError::NotHeld { count: 8, .. }),
        "{error}"
    );
}
