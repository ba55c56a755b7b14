//! Volume that is kept.

use super::{
    Body, Finding, METHODS, bar, checked_solve, elasticity, gradient_holds, held, max_distance,
    name, nodes_where,
};
use crate::check::never_rises;
use hex_mesh::{HexMesh, Quadrature};
use nalgebra::{Matrix3, Vector3};
use pd_solver::{EffectSpec, Method, SolveOptions, Status, Stop, deformation_gradients};

/// How far from rest the end may be, in edges of an element.
const NEAR: f64 = 1e-6;

/// A body that keeps its volume and starts at a place where it has none, or that of its mirror image, ends at rest.
pub fn finds_rest(place: fn(&Vector3<f64>) -> Vector3<f64>) -> Finding {
    let mut body = bar([6, 3, 3], vec![EffectSpec::Volume { stiffness: 10.0 }]);
    let parameters = body.solver.rest_parameters();
    let start: Vec<_> = body.mesh.nodes().iter().map(place).collect();
    let mut finding = Finding::default();
    for method in METHODS {
        let options = SolveOptions {
            max_iterations: 5_000,
            ..SolveOptions::new(Stop::Accuracy(1e-7 * body.mesh.element_size()))
                .with_method(method)
                .leaving_saddles()
        };
        let (solution, part) = checked_solve(&mut body, &parameters, Some(&start), &options);
        finding.merge(part);
        let far = max_distance(&solution.positions, body.mesh.nodes());
        finding.require(far < NEAR * body.mesh.element_size(), || {
            format!(
                "{}: {:?} {far:.1e} from rest",
                name(method),
                solution.status
            )
        });
        finding.merge(never_rises(&mut body, &parameters, &start, method));
    }
    finding
}

/// Pulled at both ends.
pub fn pulled() -> Finding {
    let mesh = HexMesh::solid_box([8, 4, 4], 0.25, Quadrature::Eight).expect("a valid box");
    let ends = nodes_where(&mesh, |x| x.x == 0.0 || x.x == 2.0);
    let volume = EffectSpec::Volume { stiffness: 1e3 };
    let mut body = Body::new(mesh, &[elasticity(), held(ends), volume]);
    let mut parameters = body.solver.rest_parameters();
    for x in &mut parameters.prescribed {
        x.x *= 1.4;
    }
    let mut finding = Finding::default();
    let mut energies = Vec::new();
    for method in METHODS {
        let options = SolveOptions {
            max_iterations: 50_000,
            ..SolveOptions::new(Stop::RelativeGradient(1e-8)).with_method(method)
        };
        let (solution, part) = checked_solve(&mut body, &parameters, None, &options);
        finding.merge(part);
        energies.push(solution.stats.energy);
        finding.require(solution.status == Status::Converged, || {
            format!("{}: {:?}", name(method), solution.status)
        });
        // What is kept is the determinant of each element's mean; the volume itself is that of all its samples.
        let all = deformation_gradients(&body.mesh, &solution.positions);
        let samples = all.len() / body.mesh.elements().len();
        let mean = |f: &[Matrix3<f64>]| f.iter().sum::<Matrix3<f64>>() / samples as f64;
        let off = |f: &[Matrix3<f64>]| (mean(f).determinant() - 1.0).abs();
        let worst = all.chunks(samples).map(off).fold(0.0, f64::max);
        let kept = all.iter().map(|f| f.determinant()).sum::<f64>() / all.len() as f64;
        finding.require(worst < 2e-3 && (kept - 1.0).abs() < 2e-3, || {
            format!(
                "{}: {kept} of the volume, an element {worst:.1e} off",
                name(method)
            )
        });
        // The section in the middle has no reason to keep its shape, but its area: nothing locks.
        let middle = nodes_where(&body.mesh, |x| x.x == 1.0);
        let width = |axis: usize| {
            let along = middle.iter().map(|&n| solution.positions[n as usize][axis]);
            let (low, high) = along.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| {
                (l.min(x), h.max(x))
            });
            high - low
        };
        let area = width(1) * width(2);
        finding.require(area < 0.75, || {
            format!("{}: a waist of {area} where it was 1", name(method))
        });
        if method == Method::Newton {
            finding.merge(gradient_holds(&mut body, &parameters, &solution, method));
        }
    }
    let least = energies.iter().copied().fold(f64::INFINITY, f64::min);
    let most = energies.iter().copied().fold(0.0, f64::max);
    finding.require(most - least < 1e-8 * most, || {
        format!("energies from {least:.9} to {most:.9}")
    });
    finding
}
