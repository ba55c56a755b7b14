//! Closing holes, cutting parts, and fitting rigid motions.

mod common;

use std::path::Path;

use common::tells;
use import::{ImportError, close_holes, fit_rigid, jaw_json, jaw_motion, part, unit_target};
use nalgebra::{Matrix3, Rotation3, Vector3};
use surface_mesh::Surface;
use surface_mesh::primitives::icosphere;

/// A ball without the polygons that `keep` refuses.
fn ball_where(keep: impl Fn(&Vector3<f64>) -> bool) -> Surface {
    let ball = icosphere(3, 1.0);
    let kept = ball
        .polygons()
        .filter(|polygon| polygon.iter().all(|&c| keep(&ball.vertices()[c as usize])))
        .map(<[u32]>::to_vec)
        .collect();
    Surface::from_polygons(ball.vertices().to_vec(), kept).unwrap()
}

#[test]
fn holes_are_closed_behind_what_was_there() {
    let open = ball_where(|v| v.y > -0.8 && v.x < 0.8);
    let closed = close_holes(&open, "ball").unwrap();
    assert_eq!(closed.holes.len(), 2);
    assert_eq!(closed.surface.vertex_count(), open.vertex_count() + 2);
    assert_eq!(
        &closed.surface.vertices()[..open.vertex_count()],
        open.vertices()
    );
    let before: Vec<&[u32]> = open.polygons().collect();
    let after: Vec<&[u32]> = closed.surface.polygons().collect();
    assert_eq!(after[..before.len()], before);
    let corners: usize = closed.holes.iter().map(Vec::len).sum();
    assert_eq!(after.len(), before.len() + corners);
    for (hole, centre) in closed
        .holes
        .iter()
        .zip(&closed.surface.vertices()[open.vertex_count()..])
    {
        let sum: Vector3<f64> = hole.iter().map(|&c| open.vertices()[c as usize]).sum();
        assert!((centre - sum / hole.len() as f64).norm() < 1e-12);
    }
    assert!(surface_mesh::report(&closed.surface).is_solid());
    // Less than the ball, whose caps are gone, more than half of it.
    let volume = closed.surface.signed_volume();
    assert!(volume > 3.0 && volume < 4.0, "{volume}");
}

#[test]
fn a_closed_surface_is_left_alone() {
    let ball = icosphere(2, 1.0);
    let closed = close_holes(&ball, "ball").unwrap();
    assert!(closed.holes.is_empty());
    assert_eq!(closed.surface, ball);
}

#[test]
fn what_bounds_no_solid_is_refused() {
    let ball = ball_where(|v| v.y > -0.5);
    let turned: Vec<Vec<u32>> = ball
        .polygons()
        .map(|p| p.iter().rev().copied().collect())
        .collect();
    let inside_out = Surface::from_polygons(ball.vertices().to_vec(), turned).unwrap();
    let error = close_holes(&inside_out, "the turned ball").unwrap_err();
    tells(&error, &["the turned ball bounds no solid"]);

    // Two holes that share one corner: the polygons around a vertex, every other one gone.
    let corners = [
        [0.0, 0.0, 1.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [-1.0, 0.0, 0.0],
        [0.0, -1.0, 0.0],
        [0.0, 0.0, -1.0],
    ];
    let faces = [
        [0, 1, 2],
        [0, 3, 4],
        [5, 2, 1],
        [5, 3, 2],
        [5, 4, 3],
        [5, 1, 4],
    ];
    let touching =
        Surface::from_triangles(corners.map(Vector3::from).to_vec(), faces.to_vec()).unwrap();
    let error = close_holes(&touching, "the pierced diamond").unwrap_err();
    assert!(
        matches!(error, ImportError::TouchingHoles { vertex: 0, .. }),
        "{error}"
    );
    tells(&error, &["the pierced diamond", "vertex 0"]);
}

#[test]
fn parts_keep_their_order_and_never_share_polygons() {
    let vertices: Vec<Vector3<f64>> = (0..6)
        .map(|i| Vector3::new(f64::from(i), f64::from(i * i), 0.0))
        .collect();
    let both =
        Surface::from_polygons(vertices.clone(), vec![vec![3, 5, 4], vec![0, 1, 2]]).unwrap();
    let second = part(&both, 3..6, Path::new("mesh.obj"), "second").unwrap();
    assert_eq!(second.vertices(), &vertices[3..]);
    assert_eq!(second.polygons().collect::<Vec<_>>(), [[0, 2, 1]]);
    let joined = Surface::from_polygons(vertices, vec![vec![0, 1, 2], vec![1, 2, 3]]).unwrap();
    let error = part(&joined, 3..6, Path::new("mesh.obj"), "second").unwrap_err();
    tells(&error, &["mesh.obj", "polygon 1", "part second"]);
    let error = part(&both, 3..7, Path::new("mesh.obj"), "second").unwrap_err();
    tells(&error, &["mesh.obj", "6 vertices instead of 7"]);
}

#[test]
fn a_planted_rigid_motion_is_found_again() {
    let points = icosphere(1, 2.0).vertices().to_vec();
    for angle in [0.0, 1e-9, 0.4, 3.0] {
        let turn = Rotation3::from_axis_angle(&Vector3::x_axis(), angle)
            * Rotation3::from_axis_angle(&Vector3::y_axis(), 0.2 * angle);
        let shift = Vector3::new(0.3, -7.0, 2.0);
        let moved: Vec<Vector3<f64>> = points.iter().map(|p| turn * p + shift).collect();
        let fit = fit_rigid(&points, &moved).unwrap();
        assert!((fit.rotation - turn.matrix()).norm() < 1e-12, "{angle}");
        assert!((fit.translation - shift).norm() < 1e-12, "{angle}");
        assert!(fit.residual_max < 1e-12, "{angle}");
    }
}

#[test]
fn what_is_not_rigid_is_told_and_no_mirror_is_taken() {
    let points = icosphere(1, 2.0).vertices().to_vec();
    let mirrored: Vec<Vector3<f64>> = points
        .iter()
        .map(|p| Vector3::new(-p.x, p.y, p.z))
        .collect();
    let fit = fit_rigid(&points, &mirrored).unwrap();
    assert!((fit.rotation.determinant() - 1.0).abs() < 1e-12);
    // Stretched by a tenth along z, each point is 0.1 z off, and nothing turns.
    let stretched: Vec<Vector3<f64>> = points
        .iter()
        .map(|p| Vector3::new(p.x, p.y, 1.1 * p.z))
        .collect();
    let fit = fit_rigid(&points, &stretched).unwrap();
    assert!((fit.rotation - Matrix3::identity()).norm() < 1e-12);
    let squares: f64 = points.iter().map(|p| (0.1 * p.z).powi(2)).sum();
    assert!((fit.residual_rms - (squares / points.len() as f64).sqrt()).abs() < 1e-12);
    let highest = points.iter().map(|p| p.z.abs()).fold(0.0, f64::max);
    assert!((fit.residual_max - 0.1 * highest).abs() < 1e-12);
    let error = fit_rigid(&points, &points[1..]).unwrap_err();
    tells(&error, &["42 and 41"]);
    assert!(fit_rigid(&[], &[]).is_err());
}

#[test]
fn a_jaw_at_rest_has_no_motion() {
    let points = icosphere(1, 2.0).vertices().to_vec();
    let by = |distance: f64| -> Vec<Vector3<f64>> {
        points.iter().map(|p| p + Vector3::y() * distance).collect()
    };
    assert_eq!(jaw_motion(&points, &by(0.009), 0.01).unwrap(), None);
    let fit = jaw_motion(&points, &by(0.011), 0.01).unwrap().unwrap();
    assert!((fit.translation.y - 0.011).abs() < 1e-12);
}

#[test]
fn the_jaw_file_names_the_unit_and_runs_row_by_row() {
    let points = icosphere(1, 2.0).vertices().to_vec();
    let moved: Vec<Vector3<f64>> = points.iter().map(common::opened).collect();
    let fit = fit_rigid(&points, &moved).unwrap();
    let file = jaw_json(&[("jawOpen".to_string(), fit)].into(), "cm");
    let entry = &file["unit_jaw"]["jawOpen"];
    let numbers = |key: &str| -> Vec<f64> { serde_json::from_value(entry[key].clone()).unwrap() };
    let rotation = Matrix3::from_row_slice(&numbers("rotation_rowmajor"));
    let translation = Vector3::from_vec(numbers("translation_cm"));
    for point in &points {
        assert!((rotation * point + translation - common::opened(point)).norm() < 1e-8);
    }
    assert!(entry["rms_cm"].as_f64().unwrap() < 1e-8);
}

#[test]
fn short_deltas_are_dropped_and_added_vertices_stay() {
    let deltas = [4.9e-4, 5e-4, 0.3].map(|x| Vector3::new(0.0, -x, 0.0));
    let target = unit_target("smile", deltas.into_iter(), 5e-4, 2).unwrap();
    let lengths: Vec<f64> = target.deltas.iter().map(|d| d.norm()).collect();
    assert_eq!(lengths, [0.0, 5e-4, 0.3, 0.0, 0.0]);
    assert_eq!(target.name, "smile");
    assert_eq!(
        unit_target("none", deltas[..1].iter().copied(), 5e-4, 2),
        None
    );
}
