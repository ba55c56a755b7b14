//! A ball that rests on a plane: what contact gives is the weight, where the ball stands.

mod common;

use common::{elasticity, tight};
use hex_mesh::{EmbeddedPoint, HexMesh, VoxelOptions, voxelise};
use nalgebra::Vector3;
use pd_solver::{EffectSpec, EmbeddedSurface, NodeSet, Obstacle, Solver, SpringPoints, Status};
use surface_mesh::primitives::icosphere;

const WEIGHT_PER_VOLUME: f64 = 0.02;
/// Of the springs that hold what else could roll and slide away.
const HOLD: f64 = 1e-6;

/// A ball of radius 1 around the origin with its smooth skin.
fn ball(element_size: f64) -> (HexMesh, EmbeddedSurface) {
    let surface = icosphere(4, 1.0);
    let voxelised = voxelise(&surface, &VoxelOptions::new(element_size)).unwrap();
    let embedding = voxelised.embed_surface(&surface).unwrap();
    let skin = EmbeddedSurface {
        points: embedding.vertices().to_vec(),
        triangles: surface.triangles().to_vec(),
    };
    (voxelised.mesh, skin)
}

#[test]
fn a_ball_rests_on_a_plane_by_its_weight() {
    let (mesh, skin) = ball(0.2);
    let nodes = NodeSet::Indices((0..mesh.nodes().len() as u32).collect());
    let loads = [
        EffectSpec::Gravity {
            acceleration: [0.0, 0.0, -1.0],
            density: WEIGHT_PER_VOLUME,
        },
        EffectSpec::Springs {
            points: SpringPoints::Nodes(nodes),
            stiffness: HOLD,
        },
    ];
    let contact = EffectSpec::Contact {
        region: None,
        distance: 0.02,
        stiffness: None,
        own: false,
        obstacles: vec![Obstacle::Plane {
            normal: [0.0, 0.0, 1.0],
            offset: -1.01,
        }],
    };
    let effects = [&[elasticity(), contact], &loads[..]].concat();
    let mut solver = Solver::on_surface(&mesh, &skin, &effects).unwrap();
    let parameters = solver.rest_parameters();
    let solution = solver.solve(&parameters, None, &tight()).unwrap();
    assert_eq!(solution.status, Status::Converged);
    let x = &solution.positions;

    // Contact gives what elasticity and loads leave over, as the whole is at rest.
    let others = [&[elasticity()], &loads[..]].concat();
    let mut without = Solver::new(&mesh, &others).unwrap();
    let (_, left) = without
        .energy_gradient(&without.rest_parameters(), x)
        .unwrap();
    let force: Vector3<f64> = left.iter().sum();
    let moved: Vector3<f64> = { x.iter().zip(mesh.nodes()) }
        .map(|(x, rest)| x - rest)
        .sum();
    let volume = mesh.elements().len() as f64 * 0.2_f64.powi(3);
    let expected = Vector3::z() * (WEIGHT_PER_VOLUME * volume) + moved * HOLD;
    assert!(
        (force - expected).norm() < 1e-6 * expected.norm(),
        "{force} {expected}"
    );
    // Almost all of it is the weight's, and it stands under the middle of the ball.
    let share = force.z / (WEIGHT_PER_VOLUME * volume);
    assert!((share - 1.0).abs() < 0.01, "{share}");
    let forces = x.iter().zip(&left);
    let foot: Vector3<f64> = forces.map(|(x, f)| x.cross(f)).sum::<Vector3<f64>>() / force.z;
    assert!(foot.xy().norm() < 0.01, "{foot}");

    // It touches in a disc around its lowest point and nowhere else: the flattened part.
    let at = |p: &EmbeddedPoint| -> Vector3<f64> {
        let corners = mesh.elements()[p.element as usize].map(|n| x[n as usize]);
        corners.iter().zip(&p.weights).map(|(x, w)| x * *w).sum()
    };
    let low: Vec<f64> = { skin.points.iter().map(at) }
        .filter(|x| x.z < -1.01 + 0.02)
        .map(|x| x.xy().norm())
        .collect();
    let report = &solver.contact_reports(x).unwrap()[0];
    assert_eq!(report.felt, low.len());
    assert!(low.len() > 5);
    assert!(low.iter().all(|r| *r < 0.5));
}
