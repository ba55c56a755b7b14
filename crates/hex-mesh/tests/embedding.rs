//! Embedded points: reproduction, extrapolation, the transpose, and the nearest element.

mod common;

use common::Numbers;
use hex_mesh::{Embedding, HexMesh, HexMeshError, Quadrature, VoxelOptions, embed, voxelise};
use nalgebra::{Matrix3, Vector3};
use surface_mesh::primitives::icosphere;

fn ball() -> HexMesh {
    let options = VoxelOptions::new(0.13);
    voxelise(&icosphere(3, 1.0), &options).unwrap().mesh
}

fn max_distance(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    let distances = a.iter().zip(b).map(|(a, b)| (a - b).norm());
    distances.fold(0.0, f64::max)
}

/// Distance from a point to the cube of an element.
fn cube_distance(mesh: &HexMesh, element: usize, point: &Vector3<f64>) -> f64 {
    let corner = mesh.element_corner(element);
    let size = Vector3::repeat(mesh.element_size());
    (point - point.sup(&corner).inf(&(corner + size))).norm()
}

fn check_embedding(mesh: &HexMesh, points: &[Vector3<f64>]) -> Embedding {
    let embedding = embed(mesh, points).unwrap();
    assert_eq!(embedding.len(), points.len());
    let reproduced = embedding.positions(mesh.nodes(), mesh);
    let reach = points.iter().map(|p| p.norm()).fold(1.0, f64::max);
    // Extrapolation multiplies rounding by the cube of the distance in cells.
    let cells_out = 1.0 + embedding.max_outside_distance() / mesh.element_size();
    assert!(max_distance(&reproduced, points) < 1e-14 * reach * cells_out.powi(3));
    for vertex in embedding.vertices() {
        let sum: f64 = vertex.weights.iter().sum();
        assert!((sum - 1.0).abs() < 1e-14 * cells_out.powi(3));
    }
    embedding
}

#[test]
fn inside_points_are_interpolated() {
    let mesh = HexMesh::solid_box([4, 3, 5], 0.5, Quadrature::One).unwrap();
    let mut numbers = Numbers(4);
    let points: Vec<_> = (0..500)
        .map(|_| {
            Vector3::new(
                2.0 * numbers.unit(),
                1.5 * numbers.unit(),
                2.5 * numbers.unit(),
            )
        })
        .collect();
    let embedding = check_embedding(&mesh, &points);
    assert_eq!(embedding.max_outside_distance(), 0.0);
    for vertex in embedding.vertices() {
        assert!(vertex.weights.iter().all(|w| (0.0..=1.0).contains(w)));
    }
}

#[test]
fn outside_points_extrapolate_from_the_nearest_element() {
    let mesh = ball();
    let mut numbers = Numbers(5);
    for scale in [1.2, 3.0, 50.0] {
        let points: Vec<_> = numbers.vectors(200).iter().map(|p| p * scale).collect();
        let embedding = check_embedding(&mesh, &points);
        let mut farthest: f64 = 0.0;
        for (vertex, point) in embedding.vertices().iter().zip(&points) {
            let all = (0..mesh.elements().len()).map(|e| cube_distance(&mesh, e, point));
            let least = all.fold(f64::INFINITY, f64::min);
            let found = cube_distance(&mesh, vertex.element as usize, point);
            assert!(
                (found - least).abs() < 1e-13 * scale,
                "{found} against {least}"
            );
            farthest = farthest.max(least);
        }
        assert!((embedding.max_outside_distance() - farthest).abs() < 1e-13 * scale);
    }
}

#[test]
fn equally_near_elements_give_way_to_the_lowest() {
    let cells = vec![[1, 0, 0], [0, 0, 0], [4, 0, 0]];
    let mesh = HexMesh::from_cells(cells, Vector3::zeros(), 1.0, Quadrature::One).unwrap();
    let element =
        |x: f64, y: f64| embed(&mesh, &[Vector3::new(x, y, 0.5)]).unwrap().vertices()[0].element;
    assert_eq!(element(1.0, 0.5), 0);
    assert_eq!(element(1.0, 1.5), 0);
    assert_eq!(element(1.0, 90.0), 0);
    assert_eq!(element(0.75, 1.5), 1);
    assert_eq!(element(3.0, 0.5), 0);
    assert_eq!(element(3.25, 0.5), 2);
}

#[test]
fn positions_follow_affine_motion_even_outside() {
    let mesh = ball();
    let points: Vec<_> = Numbers(6).vectors(400).iter().map(|p| p * 1.3).collect();
    let embedding = embed(&mesh, &points).unwrap();
    let mut numbers = Numbers(7);
    let (linear, offset) = (Matrix3::from_fn(|_, _| numbers.signed()), numbers.vector());
    let affine = |x: &Vector3<f64>| linear * x + offset;
    let nodes: Vec<_> = mesh.nodes().iter().map(affine).collect();
    let expected: Vec<_> = points.iter().map(affine).collect();
    assert!(max_distance(&embedding.positions(&nodes, &mesh), &expected) < 1e-12);
}

#[test]
fn transpose_passes_the_dot_product_test() {
    let mesh = ball();
    let mut numbers = Numbers(8);
    let points = numbers.vectors(5000);
    let embedding = embed(&mesh, &points).unwrap();
    let d_nodes = numbers.vectors(mesh.nodes().len());
    let vertex_bar = numbers.vectors(points.len());
    // The transpose overwrites what the buffer held.
    let mut node_bar = vec![Vector3::repeat(f64::NAN); mesh.nodes().len()];
    embedding.transpose_into(&vertex_bar, &mut node_bar);
    let dot = |a: &[Vector3<f64>], b: &[Vector3<f64>]| -> f64 {
        a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
    };
    let forward = dot(&embedding.positions(&d_nodes, &mesh), &vertex_bar);
    let backward = dot(&d_nodes, &node_bar);
    assert!((forward - backward).abs() < 1e-12 * vertex_bar.len() as f64);
    assert!(forward.abs() > 1.0);
}

#[test]
fn threads_do_not_change_a_bit() {
    let mesh = ball();
    let mut numbers = Numbers(9);
    let points = numbers.vectors(20_000);
    let vertex_bar = numbers.vectors(points.len());
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        pool.build().unwrap().install(|| {
            let embedding = embed(&mesh, &points).unwrap();
            let mut node_bar = vec![Vector3::zeros(); mesh.nodes().len()];
            embedding.transpose_into(&vertex_bar, &mut node_bar);
            (embedding, node_bar)
        })
    };
    assert!(run(1) == run(4));
}

#[test]
fn no_points_and_bad_points() {
    let mesh = HexMesh::solid_box([1, 1, 1], 1.0, Quadrature::One).unwrap();
    let nothing = embed(&mesh, &[]).unwrap();
    assert!(nothing.is_empty());
    let mut node_bar = vec![Vector3::repeat(1.0); 8];
    nothing.transpose_into(&[], &mut node_bar);
    assert_eq!(node_bar, vec![Vector3::zeros(); 8]);
    let bad = [Vector3::zeros(), Vector3::new(0.0, f64::NAN, 0.0)];
    assert_eq!(
        embed(&mesh, &bad),
        Err(HexMeshError::PointNotFinite { point: 1 })
    );
}
