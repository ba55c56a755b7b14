//! Quadrature, shape functions and their gradients against closed forms.

mod common;

use common::Numbers;
use hex_mesh::{
    HexMesh, HexMeshError, Quadrature, QuadratureRule, trilinear_gradients, trilinear_weights,
};
use nalgebra::{Matrix3, SVector, Vector3};

const ALL: [Quadrature; 3] = [Quadrature::One, Quadrature::Eight, Quadrature::TwentySeven];

#[test]
fn monomials_are_exact_to_degree_2n_minus_1_and_no_further() {
    for (quadrature, points_per_axis) in ALL.into_iter().zip(1..) {
        let rule = QuadratureRule::new(quadrature);
        let integrate = |powers: [i32; 3]| -> f64 {
            let value =
                |p: &Vector3<f64>| -> f64 { (0..3).map(|a| p[a].powi(powers[a])).product() };
            rule.points
                .iter()
                .zip(&rule.weights)
                .map(|(p, w)| w * value(p))
                .sum()
        };
        let exact =
            |powers: [i32; 3]| -> f64 { powers.iter().map(|&p| 1.0 / f64::from(p + 1)).product() };
        let degree = 2 * points_per_axis - 1;
        for powers in (0..=degree).flat_map(|a| (0..=degree).map(move |b| [a, b, degree - a])) {
            assert!((integrate(powers) - exact(powers)).abs() < 1e-15);
        }
        for axis in 0..3 {
            let mut powers = [0; 3];
            powers[axis] = degree + 1;
            assert!((integrate(powers) - exact(powers)).abs() > 1e-4);
        }
    }
}

#[test]
fn points_run_with_x_slowest() {
    let rule = QuadratureRule::new(Quadrature::TwentySeven);
    let low = 0.5 * (1.0 - 0.6_f64.sqrt());
    assert!((rule.points[1] - Vector3::new(low, low, 0.5)).norm() < 1e-15);
    assert!((rule.points[3] - Vector3::new(low, 0.5, low)).norm() < 1e-15);
    assert!((rule.points[9] - Vector3::new(0.5, low, low)).norm() < 1e-15);
    assert!((rule.weights.iter().sum::<f64>() - 1.0).abs() < 1e-15);
}

#[test]
fn counts_name_the_rules() {
    for quadrature in ALL {
        assert_eq!(Quadrature::from_count(quadrature.count()), Ok(quadrature));
        assert_eq!(QuadratureRule::new(quadrature).len(), quadrature.count());
    }
    let refused = Err(HexMeshError::QuadratureCount { count: 9 });
    assert_eq!(Quadrature::from_count(9), refused);
}

#[test]
fn weights_are_a_partition_of_unity_with_matching_gradients() {
    let mut numbers = Numbers(1);
    for _ in 0..100 {
        let xi = 2.0 * numbers.vector();
        let (weights, gradients) = (trilinear_weights(&xi), trilinear_gradients(&xi));
        assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-13);
        assert!(gradients.iter().sum::<Vector3<f64>>().norm() < 1e-13);
        // Weights are linear along each axis, so central differences are exact up to rounding.
        for axis in 0..3 {
            let step = Vector3::ith(axis, 0.5);
            let (up, down) = (
                trilinear_weights(&(xi + step)),
                trilinear_weights(&(xi - step)),
            );
            let slopes = up.iter().zip(down).map(|(up, down)| up - down);
            for (slope, gradient) in slopes.zip(&gradients) {
                assert!((slope - gradient[axis]).abs() < 1e-12);
            }
        }
    }
}

/// `x + trilinear terms`: the most general map that one cube carries exactly, and its gradient.
fn trilinear_map(k: &[Vector3<f64>], x: &Vector3<f64>) -> (Vector3<f64>, Matrix3<f64>) {
    let [x, y, z] = [x.x, x.y, x.z];
    let position = k[0] + k[1] * x + k[2] * y + k[3] * z;
    let position = position + k[4] * (x * y) + k[5] * (y * z) + k[6] * (z * x) + k[7] * (x * y * z);
    let gradient = Matrix3::from_columns(&[
        k[1] + k[4] * y + k[6] * z + k[7] * (y * z),
        k[2] + k[4] * x + k[5] * z + k[7] * (x * z),
        k[3] + k[5] * y + k[6] * x + k[7] * (x * y),
    ]);
    (position, gradient)
}

fn check_deformation_gradients(coefficients: &[Vector3<f64>]) {
    let size = 0.37;
    for quadrature in ALL {
        let mesh = HexMesh::solid_box([2, 3, 2], size, quadrature).unwrap();
        let moved: Vec<_> = mesh
            .nodes()
            .iter()
            .map(|x| trilinear_map(coefficients, x).0)
            .collect();
        let gradients = mesh.quadrature().gradients(size);
        let samples = mesh.sample_positions();
        for (element, corners) in mesh.elements().iter().enumerate() {
            for (sample, gradients) in gradients.iter().enumerate() {
                let terms = corners.iter().zip(gradients);
                let from_gradients: Matrix3<f64> = terms
                    .map(|(&node, g)| moved[node as usize] * g.transpose())
                    .sum();

                let u =
                    SVector::<f64, 24>::from_fn(|row, _| moved[corners[row / 3] as usize][row % 3]);
                let from_operator = mesh.gradient_operator(sample) * u;
                let from_operator = Matrix3::from_row_slice(from_operator.as_slice());

                let at = samples[element * quadrature.count() + sample];
                let expected = trilinear_map(coefficients, &at).1;
                assert!((from_gradients - expected).norm() < 1e-13);
                assert!((from_operator - expected).norm() < 1e-13);
            }
        }
    }
}

#[test]
fn deformation_gradients_of_linear_maps_are_exact() {
    let mut coefficients = Numbers(2).vectors(8);
    coefficients[4..].fill(Vector3::zeros());
    check_deformation_gradients(&coefficients);
}

#[test]
fn deformation_gradients_of_trilinear_maps_are_exact() {
    check_deformation_gradients(&Numbers(3).vectors(8));
}

#[test]
fn sample_weights_interpolate_sample_positions() {
    let mesh = HexMesh::solid_box([2, 1, 2], 0.7, Quadrature::TwentySeven).unwrap();
    let weights = mesh.sample_weights();
    for (index, position) in mesh.sample_positions().iter().enumerate() {
        let corners = mesh.elements()[index / 27];
        let terms = corners.iter().zip(&weights[index % 27]);
        let sum: Vector3<f64> = terms
            .map(|(&node, &w)| mesh.nodes()[node as usize] * w)
            .sum();
        assert!((sum - position).norm() < 1e-15);
    }
}
