//! Vertex normals: known answers, finite differences, and the dot-product test of the cotangent.

use nalgebra::Vector3;
use surface_mesh::{primitives, vertex_normals, vertex_normals_vjp};

/// Numbers in (-1, 1) that are the same in every run.
fn noise(count: usize, seed: u64) -> Vec<Vector3<f64>> {
    let mut state = seed;
    let mut next = || {
        state = state
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    };
    (0..count)
        .map(|_| Vector3::from_fn(|_, _| next()))
        .collect()
}

fn dot(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}

fn moved(vertices: &[Vector3<f64>], by: f64, direction: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    vertices
        .iter()
        .zip(direction)
        .map(|(v, d)| v + by * d)
        .collect()
}

/// A bumpy torus, with an unused vertex and one whose only triangle has no area.
fn bumpy() -> (Vec<Vector3<f64>>, Vec<[u32; 3]>) {
    let torus = primitives::torus(2.0, 0.7, 12, 9);
    let count = torus.vertex_count();
    let mut vertices = moved(torus.vertices(), 0.1, &noise(count, 1));
    let mut triangles = torus.triangles().to_vec();
    vertices.extend([Vector3::new(9.0, 9.0, 9.0), Vector3::new(5.0, 5.0, 5.0)]);
    triangles.push([count as u32 + 1, count as u32 + 1, 0]);
    (vertices, triangles)
}

#[test]
fn box_normals_point_along_diagonals() {
    // Two triangles at each corner and side or one: the mean over the diagonal splits is the corner's direction at
    // vertices 0 and 7 only where the weights agree, so split every side into four triangles about its centre.
    let shape = primitives::cuboid(Vector3::repeat(-1.0), Vector3::repeat(1.0));
    let mut vertices = shape.vertices().to_vec();
    let mut triangles = Vec::new();
    for quad in shape.polygons() {
        let centre = vertices.len() as u32;
        vertices.push(
            quad.iter()
                .map(|&v| vertices[v as usize])
                .sum::<Vector3<f64>>()
                / 4.0,
        );
        for i in 0..4 {
            triangles.push([quad[i], quad[(i + 1) % 4], centre]);
        }
    }
    for (normal, vertex) in vertex_normals(&vertices, &triangles).iter().zip(&vertices) {
        assert!((normal - vertex.normalize()).norm() < 1e-15);
    }
}

#[test]
fn tiny_and_huge_surfaces_have_unit_normals() {
    for radius in [1e-80, 1e-30, 1.0, 1e30, 1e75] {
        let sphere = primitives::icosphere(2, radius);
        let normals = vertex_normals(sphere.vertices(), sphere.triangles());
        for (normal, vertex) in normals.iter().zip(sphere.vertices()) {
            assert!((normal.norm() - 1.0).abs() < 1e-15);
            assert!(normal.dot(vertex) / radius > 0.99);
        }
    }
}

#[test]
fn vertices_without_area_get_zero_and_no_cotangent_of_their_own() {
    let (vertices, triangles) = bumpy();
    let normals = vertex_normals(&vertices, &triangles);
    let n = vertices.len();
    assert_eq!(normals[n - 1], Vector3::zeros());
    assert_eq!(normals[n - 2], Vector3::zeros());
    assert!(
        normals[..n - 2]
            .iter()
            .all(|normal| (normal.norm() - 1.0).abs() < 1e-15)
    );
    let bar = vertex_normals_vjp(&vertices, &triangles, &noise(n, 2));
    assert_eq!(bar[n - 2], Vector3::zeros());
    assert!(bar.iter().all(|b| b.iter().all(|x| x.is_finite())));
}

/// The directional derivative by central differences agrees with the cotangent, to second order in the step.
#[test]
fn cotangent_agrees_with_finite_differences() {
    let (mut vertices, mut triangles) = bumpy();
    // At a vertex without area the normal jumps: leave it out, the test above covers it.
    triangles.pop();
    vertices.pop();
    let n = vertices.len();
    let normals_bar = noise(n, 3);
    let direction = noise(n, 4);
    let exact = dot(
        &vertex_normals_vjp(&vertices, &triangles, &normals_bar),
        &direction,
    );
    let error = |step: f64| {
        let loss = |by| {
            dot(
                &vertex_normals(&moved(&vertices, by, &direction), &triangles),
                &normals_bar,
            )
        };
        ((loss(step) - loss(-step)) / (2.0 * step) - exact).abs() / exact.abs()
    };
    let (coarse, fine) = (error(1e-3), error(1e-4));
    assert!(
        (80.0..120.0).contains(&(coarse / fine)),
        "{coarse:e} {fine:e}"
    );
    assert!(error(1e-5) < 1e-8, "{:e}", error(1e-5));
}

/// Every column of the Jacobian, on a small shape: the dot-product test for all unit vectors.
#[test]
fn cotangent_is_the_transpose_of_the_jacobian() {
    let sphere = primitives::icosphere(0, 1.0);
    let vertices = moved(sphere.vertices(), 0.2, &noise(12, 5));
    let step = 1e-6;
    for vertex in 0..12 {
        for axis in 0..3 {
            let mut unit = vec![Vector3::zeros(); 12];
            unit[vertex][axis] = 1.0;
            let normals = |by| vertex_normals(&moved(&vertices, by, &unit), sphere.triangles());
            let (up, down) = (normals(step), normals(-step));
            let column: Vec<_> = up
                .iter()
                .zip(&down)
                .map(|(u, d)| (u - d) / (2.0 * step))
                .collect();
            for seed in 0..3 {
                let bar = noise(12, 10 + seed);
                let pulled = vertex_normals_vjp(&vertices, sphere.triangles(), &bar);
                assert!((pulled[vertex][axis] - dot(&column, &bar)).abs() < 1e-8);
            }
        }
    }
}

/// Normals do not change when the surface is scaled or moved, so the cotangent is orthogonal to both.
#[test]
fn cotangent_is_orthogonal_to_scaling_and_translation() {
    let (vertices, triangles) = bumpy();
    let bar = vertex_normals_vjp(&vertices, &triangles, &noise(vertices.len(), 6));
    let size: f64 = bar.iter().map(Vector3::norm).sum();
    assert!(dot(&bar, &vertices).abs() < 1e-13 * size);
    assert!(bar.iter().sum::<Vector3<f64>>().norm() < 1e-13 * size);
}
