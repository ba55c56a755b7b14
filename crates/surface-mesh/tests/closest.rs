//! Nearest points against a search of all triangles by another formula, and on surfaces where the answer is known.

use nalgebra::Vector3;
use surface_mesh::{ClosestPoints, Surface, primitives::icosphere};

/// Numbers in [-1, 1) that look random and never change.
fn scatter(count: usize, mut state: u64) -> Vec<Vector3<f64>> {
    let mut next = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        ((state >> 40) as f64) / 8_388_608.0 - 1.0
    };
    (0..count)
        .map(|_| Vector3::new(next(), next(), next()))
        .collect()
}

/// Distance from a point to a triangle by minimising over a fine lattice of it, then refining around the best place.
fn distance_by_lattice(corners: [Vector3<f64>; 3], point: &Vector3<f64>) -> f64 {
    let [a, b, c] = corners;
    let at = |u: f64, v: f64| (a + (b - a) * u + (c - a) * v - point).norm();
    let (mut best, mut centre, mut half) = (f64::INFINITY, (0.5, 0.5), 0.5);
    for _ in 0..40 {
        let (u0, v0) = centre;
        for i in -8..=8 {
            for j in -8..=8 {
                let u = (u0 + half * f64::from(i) / 8.0).clamp(0.0, 1.0);
                let v = (v0 + half * f64::from(j) / 8.0).clamp(0.0, 1.0 - u);
                if at(u, v) < best {
                    best = at(u, v);
                    centre = (u, v);
                }
            }
        }
        half *= 0.6;
    }
    best
}

#[test]
fn nearest_points_are_nearest() {
    let vertices = scatter(60, 1);
    let triangles: Vec<[u32; 3]> = (0..58).map(|i| [i, i + 1, i + 2]).collect();
    let surface = Surface::from_triangles(vertices.clone(), triangles.clone()).unwrap();
    let closest = ClosestPoints::new(&surface);
    for point in scatter(40, 2).iter().map(|x| x * 1.5) {
        let found = closest.to(&point);
        let by_lattice = triangles
            .iter()
            .map(|t| distance_by_lattice(t.map(|v| vertices[v as usize]), &point))
            .fold(f64::INFINITY, f64::min);
        assert!((found.distance - by_lattice).abs() < 1e-6, "{point}");
        let corners = triangles[found.triangle].map(|v| vertices[v as usize]);
        let weighted = corners.iter().zip(found.weights).map(|(x, w)| x * w);
        assert!((weighted.sum::<Vector3<f64>>() - found.position).norm() < 1e-12);
        assert!(((point - found.position).norm() - found.distance).abs() < 1e-12);
        assert!(found.weights.iter().all(|w| *w >= 0.0));
        assert!((found.weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
    }
}

#[test]
fn corners_edges_and_faces_are_told_apart() {
    let square = Surface::from_triangles(
        [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]]
            .map(Vector3::from)
            .to_vec(),
        vec![[0, 1, 2]],
    )
    .unwrap();
    let closest = ClosestPoints::new(&square);
    let at = |x, y, z| closest.to(&Vector3::new(x, y, z));
    assert_eq!(at(-1.0, -1.0, 0.0).weights, [1.0, 0.0, 0.0]);
    assert_eq!(at(0.25, -2.0, 0.0).weights, [0.75, 0.25, 0.0]);
    assert_eq!(at(1.0, 1.0, 1.0).weights, [0.0, 0.5, 0.5]);
    let inside = at(0.25, 0.25, 3.0);
    assert!((inside.distance - 3.0).abs() < 1e-15);
    assert_eq!(inside.weights, [0.5, 0.25, 0.25]);
}

#[test]
fn the_lowest_of_equal_triangles_wins() {
    let ball = icosphere(2, 1.0);
    let triangles = [ball.triangles(), ball.triangles()].concat();
    let twice = Surface::from_triangles(ball.vertices().to_vec(), triangles).unwrap();
    let closest = ClosestPoints::new(&twice);
    for point in scatter(200, 3) {
        assert!(closest.to(&point).triangle < ball.triangles().len());
    }
}

#[test]
fn triangles_without_area_are_their_edges() {
    let points = [[0., 0., 0.], [1., 0., 0.], [3., 0., 0.]].map(Vector3::from);
    for triangle in [[0, 1, 2], [2, 0, 1], [1, 1, 1], [0, 0, 2]] {
        let surface = Surface::from_triangles(points.to_vec(), vec![triangle]).unwrap();
        let found = ClosestPoints::new(&surface).to(&Vector3::new(1.0, 2.0, 0.0));
        assert_eq!(found.position, points[1]);
        assert_eq!(found.distance, 2.0);
    }
}
