//! A case with a known answer: a box whose actuation is the stretch of a smooth map, so that the map itself is the equilibrium.
//!
//! With F = R S the polar decomposition of the map's gradient and A = S, F - R(F A) A = 0 everywhere: the energy is zero, and nothing
//! is lower. What a grid makes of it is off by the error of trilinear elements and their quadrature alone.

use crate::error::{AccuracyError, Result};
use crate::estimates::effects;
use hex_mesh::{Axis, HexMesh, NodeRegion, Quadrature};
use nalgebra::{Matrix3, Vector3};
use pd_solver::{NodeSet, SolveOptions, Solver, Status, Stop};
use serde::Serialize;

/// Elements along the edge of the unit cube.
const GRIDS: [usize; 4] = [4, 8, 16, 32];
/// Accuracy of the solves, in edges of the cube.
const ACCURACY: f64 = 1e-9;

/// One grid.
#[derive(Debug, Clone, Serialize)]
pub struct Grid {
    /// Edge of an element, in edges of the cube.
    pub element_size: f64,
    /// Root of the mean squared distance of nodes from where the map puts them.
    pub rms_error: f64,
    /// The largest.
    pub max_error: f64,
}

/// Errors on finer and finer grids.
#[derive(Debug, Clone, Serialize)]
pub struct Convergence {
    /// From coarse to fine.
    pub grids: Vec<Grid>,
    /// Slope of the logarithm of the error by that of the element size.
    pub order: f64,
}

/// Where the map carries a point. The side x = 0 stays.
fn map(x: &Vector3<f64>) -> Vector3<f64> {
    let [a, b, c] = [x.x, x.y, x.z];
    Vector3::new(
        a * (1.0 + 0.15 * (2.0 * b).sin()),
        b + 0.25 * a * a * (1.0 - 0.5 * c),
        c - 0.2 * (1.5 * a).sin() * a + 0.1 * a * b * c,
    )
}

/// Gradient of [`map`].
fn gradient(x: &Vector3<f64>) -> Matrix3<f64> {
    let [a, b, c] = [x.x, x.y, x.z];
    let (sin, cos) = (1.5 * a).sin_cos();
    Matrix3::new(
        1.0 + 0.15 * (2.0 * b).sin(),
        0.3 * a * (2.0 * b).cos(),
        0.0,
        0.5 * a * (1.0 - 0.5 * c),
        1.0,
        -0.125 * a * a,
        -0.3 * cos * a - 0.2 * sin + 0.1 * b * c,
        0.1 * a * c,
        1.0 + 0.1 * a * b,
    )
}

/// Solves the case on all grids.
///
/// # Errors
/// When a solve does not converge.
pub fn convergence() -> Result<Convergence> {
    let grids = GRIDS.into_iter().map(on_grid).collect::<Result<Vec<_>>>()?;
    let points = grids.iter().map(|g| (g.element_size, g.rms_error));
    Ok(Convergence {
        order: slope(points),
        grids,
    })
}

fn on_grid(cells: usize) -> Result<Grid> {
    let element_size = 1.0 / cells as f64;
    let mesh =
        HexMesh::solid_box([cells; 3], element_size, Quadrature::Eight).map_err(|source| {
            AccuracyError::Mesh {
                what: "cube",
                source,
            }
        })?;
    let side = NodeRegion::Plane {
        axis: Axis::X,
        value: 0.0,
    };
    let effects = effects(NodeSet::Region(side));
    let mut solver = Solver::new(&mesh, &effects)?;
    let mut parameters = solver.rest_parameters();
    for (b, x) in parameters.actuation.iter_mut().zip(mesh.sample_positions()) {
        let stretch = polar_grad::polar(&gradient(&x)).stretch;
        *b = polar_grad::symmetric_entries(&(stretch - Matrix3::identity()));
    }
    let options = SolveOptions::new(Stop::Accuracy(ACCURACY));
    let solution = solver.solve(&parameters, None, &options)?;
    if solution.status != Status::Converged {
        return Err(AccuracyError::Reference {
            what: format!("the cube of {cells} elements along an edge"),
            status: solution.status,
        });
    }
    let distances = { mesh.nodes().iter() }
        .zip(&solution.positions)
        .map(|(rest, reached)| (map(rest) - reached).norm());
    let distances: Vec<f64> = distances.collect();
    let squares: f64 = distances.iter().map(|d| d * d).sum();
    Ok(Grid {
        element_size,
        rms_error: (squares / distances.len() as f64).sqrt(),
        max_error: distances.iter().copied().fold(0.0, f64::max),
    })
}

/// Slope of the line through the logarithms of points, by least squares.
pub fn slope(points: impl Iterator<Item = (f64, f64)>) -> f64 {
    let logarithms: Vec<(f64, f64)> = points.map(|(x, y)| (x.ln(), y.ln())).collect();
    let count = logarithms.len() as f64;
    let mean = |of: fn(&(f64, f64)) -> f64| logarithms.iter().map(of).sum::<f64>() / count;
    let (x, y) = (mean(|p| p.0), mean(|p| p.1));
    let sum = |of: &dyn Fn(&(f64, f64)) -> f64| logarithms.iter().map(of).sum::<f64>();
    sum(&|p| (p.0 - x) * (p.1 - y)) / sum(&|p| (p.0 - x).powi(2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gradient_is_that_of_the_map() {
        let x = Vector3::new(0.3, 0.7, 0.4);
        for axis in 0..3 {
            let mut step = Vector3::zeros();
            step[axis] = 1e-6;
            let slope = (map(&(x + step)) - map(&(x - step))) / 2e-6;
            assert!((slope - gradient(&x).column(axis)).norm() < 1e-9);
        }
        let side = Vector3::new(0.0, 0.2, 0.9);
        assert_eq!(map(&side), side);
    }

    #[test]
    fn trilinear_elements_converge_with_the_square_of_their_size() {
        let convergence = convergence().unwrap();
        println!("{convergence:?}");
        assert!(convergence.order > 1.8, "{}", convergence.order);
        assert!(convergence.grids[3].rms_error < 1e-3);
    }

    #[test]
    fn the_slope_of_a_power_is_its_exponent() {
        let points = [1.0, 2.0, 4.0, 8.0].map(|x: f64| (x, 3.0 * x.powf(1.5)));
        assert!((slope(points.into_iter()) - 1.5).abs() < 1e-12);
    }
}
