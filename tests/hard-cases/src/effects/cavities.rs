//! Cavities and the pressure in them.

use super::{Body, Finding, METHODS, checked_solve, elasticity, gradient_holds, name};
use crate::check::all_finite;
use hex_mesh::{HexMesh, NodeRegion, Quadrature};
use nalgebra::Vector3;
use pd_solver::{
    AdjointOptions, EffectSpec, EmbeddedSurface, Method, SolveOptions, Solver, SolverError, Status,
    Stop,
};

/// Edge of a cell.
const EDGE: f64 = 0.2;
/// Volume of the cavity: three cells along each axis.
const VOLUME: f64 = 27.0 * EDGE * EDGE * EDGE;

/// A box of five cells along each axis with a hollow of three; `open` leaves out the cell in the middle of one wall.
fn hollow(open: bool) -> HexMesh {
    let mut cells = Vec::new();
    for x in 0..5 {
        for y in 0..5 {
            for z in 0..5 {
                let inside = [x, y, z].iter().all(|i| (1..4).contains(i));
                let left_out = open && [x, y, z] == [4, 2, 2];
                if !(inside || left_out) {
                    cells.push([x, y, z]);
                }
            }
        }
    }
    HexMesh::from_cells(cells, Vector3::zeros(), EDGE, Quadrature::Eight).expect("a valid mesh")
}

fn effects(capped: bool, pressure: Option<f64>) -> Vec<EffectSpec> {
    let walls = NodeRegion::Box {
        min: [0.5 * EDGE; 3],
        max: [4.5 * EDGE; 3],
    };
    let pressure = pressure.map(|pressure| EffectSpec::Pressure {
        region: Some(walls),
        capped,
        pressure,
    });
    let floating = EffectSpec::Floating {};
    [elasticity(), floating]
        .into_iter()
        .chain(pressure)
        .collect()
}

fn options(method: Method) -> SolveOptions {
    SolveOptions {
        max_iterations: 2_000,
        ..SolveOptions::new(Stop::Accuracy(1e-8 * EDGE)).with_method(method)
    }
}

/// A hole of one cell in the wall.
pub fn nearly_closed() -> Finding {
    let mut finding = Finding::default();
    let pressure = 0.01;
    let mesh = hollow(true);
    let surface = EmbeddedSurface::boundary(&mesh);
    let refused = Solver::on_surface(&mesh, &surface, &effects(false, Some(pressure))).err();
    finding.require(
        matches!(
            &refused,
            Some(SolverError::OpenCavity {
                index: 2,
                edges: 4,
                ..
            })
        ),
        || format!("an open cavity: {refused:?}"),
    );
    let mut body = Body::on_boundary(mesh, &effects(true, Some(pressure)));
    let parameters = body.solver.rest_parameters();
    let rest = body.mesh.nodes().to_vec();
    let (energy, gradient) = body
        .solver
        .energy_gradient(&parameters, &rest)
        .expect("the rest shape");
    let volume = -energy / pressure;
    finding.require((volume / VOLUME - 1.0).abs() < 1e-12, || {
        format!("a capped volume of {volume}, not {VOLUME}")
    });
    let push: Vector3<f64> = gradient.iter().sum();
    let turn: Vector3<f64> = rest.iter().zip(&gradient).map(|(x, g)| x.cross(g)).sum();
    let size: f64 = gradient.iter().map(|g| g.norm()).sum();
    finding.require(push.norm() + turn.norm() < 1e-12 * size, || {
        format!("a capped cavity pushes by {push:?} and turns by {turn:?}")
    });
    for method in METHODS {
        let (solution, part) = checked_solve(&mut body, &parameters, None, &options(method));
        finding.merge(part);
        finding.require(solution.status == Status::Converged, || {
            format!("{}: {:?}", name(method), solution.status)
        });
        if method == Method::Newton {
            finding.merge(gradient_holds(&mut body, &parameters, &solution, method));
        }
    }
    finding
}

/// Pressures far beyond what the walls can bear.
pub fn bursts() -> Finding {
    let mut finding = Finding::default();
    for pressure in [10.0, 1e6] {
        let mut body = Body::on_boundary(hollow(false), &effects(false, Some(pressure)));
        let parameters = body.solver.rest_parameters();
        for method in METHODS {
            let solution = body.solver.solve(&parameters, None, &options(method));
            let solution = solution.expect("a valid case");
            let stats = &solution.stats;
            finding.merge(Finding {
                status: format!("{:?}", solution.status).to_lowercase(),
                iterations: stats.iterations,
                ..Finding::default()
            });
            finding.require(all_finite(&solution.positions), || {
                format!("{}: positions that are not finite", name(method))
            });
            finding.require(solution.status == Status::NotFinite, || {
                let (status, gradient) = (solution.status, stats.gradient_norm);
                format!(
                    "{} at {pressure}: {status:?} with a gradient of {gradient:.1e}",
                    name(method)
                )
            });
            let cotangent = vec![Vector3::x(); solution.positions.len()];
            let options = AdjointOptions::default();
            let adjoint = body
                .solver
                .adjoint(&parameters, &solution, &cotangent, &options)
                .expect("a state of this body");
            finding.require(adjoint.gradient.is_none(), || {
                format!("{}: a gradient where there is no end", name(method))
            });
        }
    }
    finding
}

/// The pressure is listed, and zero.
pub fn without_pressure() -> Finding {
    let mut finding = Finding::default();
    let mut plain = Body::new(hollow(false), &effects(false, None));
    let mut body = Body::on_boundary(hollow(false), &effects(false, Some(0.0)));
    let parameters = body.actuated(|e, s| {
        let t = (e * 8 + s) as f64;
        std::array::from_fn(|i| 0.1 * (t * (i + 1) as f64).sin())
    });
    let mut of_plain = plain.solver.rest_parameters();
    of_plain.actuation.clone_from(&parameters.actuation);
    // The first two methods are others where there is a pressure.
    for method in [Method::Lbfgs, Method::Multigrid, Method::Newton] {
        let (expected, _) = checked_solve(&mut plain, &of_plain, None, &options(method));
        let (solution, part) = checked_solve(&mut body, &parameters, None, &options(method));
        finding.merge(part);
        finding.require(solution.positions == expected.positions, || {
            format!("{}: a pressure of zero moves the body", name(method))
        });
        finding.require(solution.status == expected.status, || {
            format!("{}: {:?}", name(method), solution.status)
        });
    }
    // What the pressure would do to the size of the cavity, by the adjoint and by two solves.
    let tight = SolveOptions::new(Stop::Accuracy(1e-12)).with_method(Method::Newton);
    let (here, _) = checked_solve(&mut body, &parameters, None, &tight);
    let cotangent: Vec<_> = (body.mesh.nodes().iter())
        .map(|x| x - Vector3::repeat(2.5 * EDGE))
        .collect();
    let adjoint = body
        .solver
        .adjoint(&parameters, &here, &cotangent, &AdjointOptions::default())
        .expect("a state of this body");
    let size = |body: &mut Body, pressure: f64| -> f64 {
        let mut parameters = parameters.clone();
        parameters.pressures[0] = pressure;
        let start = Some(&here.positions[..]);
        let (solution, _) = checked_solve(body, &parameters, start, &tight);
        let pairs = solution.positions.iter().zip(&cotangent);
        pairs.map(|(x, c)| x.dot(c)).sum()
    };
    let step = 1e-4;
    let slope = (size(&mut body, step) - size(&mut body, -step)) / (2.0 * step);
    let told = adjoint.gradient.map_or(f64::NAN, |g| g.pressures[0]);
    finding.require((told / slope - 1.0).abs() < 1e-4 && told > 0.0, || {
        format!("a gradient of {told} by the pressure, where solves say {slope}")
    });
    finding
}
