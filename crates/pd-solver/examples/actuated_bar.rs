//! A bar that is held at one end and bends, because its fibres lengthen on one side and shorten on the other: its shape, the work it
//! took, and the gradient of the tip's height by one entry of the actuation against a difference of two full solves.

use hex_mesh::{Axis, HexMesh, NodeRegion, Quadrature};
use nalgebra::Vector3;
use pd_solver::{
    AdjointOptions, EffectSpec, Method, NodeSet, Parameters, SolveOptions, Solver, Stop,
};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mesh = HexMesh::solid_box([16, 4, 4], 0.25, Quadrature::Eight)?;
    let wall = NodeRegion::Plane {
        axis: Axis::X,
        value: 0.0,
    };
    let effects = [
        EffectSpec::Elasticity { stiffness: 1.0 },
        EffectSpec::Prescribed {
            nodes: NodeSet::Region(wall),
        },
    ];
    let mut solver = Solver::new(&mesh, &effects)?;
    let parameters = bending(&mesh, solver.rest_parameters());

    println!(
        "{} elements, {} free nodes, set up in {:.1} ms",
        mesh.elements().len(),
        solver.free().len(),
        1e3 * solver.setup_seconds()
    );
    println!(
        "method        status          iterations  energy      estimated error  tip height      ms"
    );
    for method in [Method::LocalGlobal, Method::Lbfgs, Method::Newton] {
        let options = SolveOptions::new(Stop::Accuracy(1e-5)).with_method(method);
        let solution = solver.solve(&parameters, None, &options)?;
        let stats = solution.stats;
        println!(
            "{:<12}  {:<14}  {:>10}  {:.4e}  {:>15.1e}  {:>10.6}  {:>6.1}",
            format!("{method:?}"),
            format!("{:?}", solution.status),
            stats.iterations,
            stats.energy,
            stats.estimated_error.unwrap_or(0.0),
            tip_height(&solution.positions),
            1e3 * stats.seconds
        );
    }

    // The derivative needs an equilibrium that is sharper than the digits wanted of it.
    let sharp = SolveOptions::new(Stop::RelativeGradient(1e-12));
    let at = solver.solve(&parameters, None, &sharp)?;
    let mut cotangent = vec![Vector3::zeros(); mesh.nodes().len()];
    cotangent[mesh.nodes().len() - 1].z = 1.0;
    let adjoint = solver.adjoint(&parameters, &at, &cotangent, &AdjointOptions::default())?;
    let gradient = adjoint.gradient.ok_or("the adjoint has no gradient")?;
    let (sample, entry, h) = (0, 0, 1e-4);
    let mut height_at = |t: f64| -> Result<f64, pd_solver::SolverError> {
        let mut moved = parameters.clone();
        moved.actuation[sample][entry] += t;
        let solution = solver.solve(&moved, Some(&at.positions), &sharp)?;
        Ok(tip_height(&solution.positions))
    };
    let difference = (height_at(h)? - height_at(-h)?) / (2.0 * h);
    let exact = gradient.actuation[sample][entry];
    println!(
        "tip height by b11 of the first sample: {exact:.9} (adjoint), {difference:.9} (difference)"
    );
    assert!((exact - difference).abs() < 1e-6 * exact.abs());
    Ok(())
}

/// Fibres along x: 25 % longer at the bottom, 25 % shorter at the top.
fn bending(mesh: &HexMesh, mut parameters: Parameters) -> Parameters {
    for (b, x) in parameters.actuation.iter_mut().zip(mesh.sample_positions()) {
        b[0] = 0.25 * (1.0 - 2.0 * x.z);
    }
    parameters
}

/// Height of the last node, a corner of the free end.
fn tip_height(positions: &[Vector3<f64>]) -> f64 {
    positions.last().expect("a mesh has nodes").z
}
