//! What material costs that is squeezed flat or turned inside out. The energy of the solver does not forbid it, so the loss teaches the
//! network to let flesh give way.

use hex_mesh::HexMesh;
use nalgebra::{Matrix3, Vector3};
use pd_solver::deformation_gradients;

/// Material squeezed to less than this share of its volume costs.
const FLOOR: f64 = 0.1;

/// `sum_s V_s max(0, FLOOR - det F_s)^2` over all samples with their volumes V_s at rest. Adds `scale` times its gradient by the nodes
/// to `node_bar` and returns `scale` times its value.
pub fn add_inversion(
    mesh: &HexMesh,
    nodes: &[Vector3<f64>],
    scale: f64,
    node_bar: &mut [Vector3<f64>],
) -> f64 {
    let gradients = mesh.quadrature().gradients(mesh.element_size());
    let volumes = mesh
        .quadrature()
        .weights
        .iter()
        .map(|w| w * mesh.element_volume());
    let samples: Vec<_> = gradients.iter().zip(volumes).collect();
    let deformations = deformation_gradients(mesh, nodes);
    let mut value = 0.0;
    for (element, f) in { mesh.elements().iter() }.zip(deformations.chunks_exact(samples.len())) {
        for ((g, volume), f) in samples.iter().zip(f) {
            let short = FLOOR - f.determinant();
            if short > 0.0 {
                value += scale * volume * short * short;
                let bar = cofactors(f) * (-2.0 * scale * volume * short);
                for (&node, g) in element.iter().zip(g.iter()) {
                    node_bar[node as usize] += bar * g;
                }
            }
        }
    }
    value
}

/// The derivative of the determinant.
fn cofactors(f: &Matrix3<f64>) -> Matrix3<f64> {
    let [a, b, c] = [0, 1, 2].map(|i| f.column(i).into_owned());
    Matrix3::from_columns(&[b.cross(&c), c.cross(&a), a.cross(&b)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use hex_mesh::Quadrature;

    /// A box whose corner is pushed through it: the penalty is that of the formula, its gradient the slope.
    #[test]
    fn squeezed_material_costs_and_the_gradient_is_the_slope() {
        let mesh = HexMesh::solid_box([2, 2, 2], 0.5, Quadrature::Eight).unwrap();
        let mut nodes = mesh.nodes().to_vec();
        let mut bar = vec![Vector3::zeros(); nodes.len()];
        assert_eq!(add_inversion(&mesh, &nodes, 3.0, &mut bar), 0.0);
        assert!(bar.iter().all(|b| *b == Vector3::zeros()));
        nodes[0] += Vector3::new(0.9, 0.7, 0.8);
        nodes[13] += Vector3::new(-0.1, 0.05, 0.02);
        let value = add_inversion(&mesh, &nodes, 3.0, &mut bar);
        let determinants = deformation_gradients(&mesh, &nodes);
        let volume = 0.125 / 8.0;
        let expected: f64 = determinants
            .iter()
            .map(|f| 3.0 * volume * (FLOOR - f.determinant()).max(0.0).powi(2))
            .sum();
        assert!(value > 0.0 && (value - expected).abs() < 1e-12 * expected);
        for (node, axis) in [(0, 0), (0, 2), (13, 1), (1, 1)] {
            let at = |h: f64| {
                let mut moved = nodes.clone();
                moved[node][axis] += h;
                add_inversion(&mesh, &moved, 3.0, &mut vec![Vector3::zeros(); nodes.len()])
            };
            let slope = (at(1e-5) - at(-1e-5)) / 2e-5;
            assert!(
                (slope - bar[node][axis]).abs() < 1e-6 * (1.0 + slope.abs()),
                "{slope}"
            );
        }
    }
}
