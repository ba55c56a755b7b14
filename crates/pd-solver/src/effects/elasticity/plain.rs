//! What is done once per body and needs no lanes: plain sums over corners.

use hex_mesh::{HexMesh, Quadrature, QuadratureRule};
use nalgebra::{Matrix3, Vector3};

/// `sum_q w_q (dN_a/dx_j) (dN_b/dx_j)` of the unit cube, for every axis j: a box of edge lengths h and weight w has the block
/// `w sum_j` of these over `h_j^2` in the constant matrix.
pub(super) fn constant_blocks(quadrature: Quadrature) -> [[[f64; 8]; 8]; 3] {
    let rule = QuadratureRule::new(quadrature);
    let gradients = rule.gradients(1.0);
    let entry = |axis: usize, a: usize, b: usize| -> f64 {
        let samples = gradients.iter().zip(&rule.weights);
        samples.map(|(g, w)| w * g[a][axis] * g[b][axis]).sum()
    };
    std::array::from_fn(|axis| std::array::from_fn(|a| std::array::from_fn(|b| entry(axis, a, b))))
}

/// F = sum_n x_n (dw_n/dx)^T, the deformation gradient when `x` holds positions.
pub(in crate::effects) fn deformation_gradient(
    x: &[Vector3<f64>; 8],
    g: &[Vector3<f64>; 8],
) -> Matrix3<f64> {
    let mut f = Matrix3::zeros();
    for (x, g) in x.iter().zip(g) {
        f.ger(1.0, x, g, 1.0);
    }
    f
}

/// The deformation gradient at every sample, `[elements * samples]`, for positions of all nodes.
///
/// # Panics
/// When `positions` has not one entry per node.
pub fn deformation_gradients(mesh: &HexMesh, positions: &[Vector3<f64>]) -> Vec<Matrix3<f64>> {
    assert_eq!(positions.len(), mesh.nodes().len(), "one position per node");
    let gradients = mesh.quadrature().gradients(mesh.element_size());
    let of_element = |nodes: &[u32; 8]| {
        let x = nodes.map(|node| positions[node as usize]);
        gradients
            .iter()
            .map(move |g| deformation_gradient(&x, g))
            .collect::<Vec<_>>()
    };
    mesh.elements().iter().flat_map(of_element).collect()
}
