//! Steps in time that are far too long, far too short, or in flesh like pitch.

use super::{Body, Finding, checked_solve, elasticity, held, max_distance, nodes_where};
use crate::check::all_finite;
use hex_mesh::{HexMesh, Quadrature};
use nalgebra::{Matrix3, Vector3};
use pd_solver::{
    EffectSpec, Method, Motion, SolveOptions, Status, Stop, TimeScheme, TimeStep,
    deformation_gradients,
};

const SCHEMES: [TimeScheme; 2] = [TimeScheme::BackwardEuler, TimeScheme::Midpoint];

fn options() -> SolveOptions {
    SolveOptions::new(Stop::RelativeGradient(1e-12))
}

fn moving(is_held: bool, scheme: TimeScheme, time_step: f64, viscosity: Option<f64>) -> Body {
    let mesh = HexMesh::solid_box([8, 3, 3], 0.25, Quadrature::Eight).expect("a valid box");
    let wall = is_held.then(|| held(nodes_where(&mesh, |x| x.x == 0.0)));
    let gravity = is_held.then_some(EffectSpec::Gravity {
        acceleration: [0.0, 0.0, -0.01],
        density: 1.0,
    });
    let inertia = EffectSpec::Inertia {
        density: 1.0,
        time_step,
        scheme,
    };
    let damping = viscosity.map(|viscosity| EffectSpec::Damping { viscosity });
    let effects = [elasticity(), inertia].into_iter();
    let effects: Vec<_> = { effects.chain(wall).chain(gravity).chain(damping) }.collect();
    Body::new(mesh, &effects)
}

/// Bent sideways, more towards the far end.
fn bent(body: &Body) -> Vec<Vector3<f64>> {
    let nodes = body.mesh.nodes().iter();
    nodes
        .map(|x| x + Vector3::y() * (0.1 * x.x * x.x))
        .collect()
}

/// Flying and turning.
fn thrown(positions: Vec<Vector3<f64>>) -> Motion {
    let spin = Vector3::new(0.2, 0.5, -0.3);
    Motion {
        velocities: positions
            .iter()
            .map(|x| Vector3::new(0.5, -0.2, 1.0) + spin.cross(x))
            .collect(),
        positions,
    }
}

/// A step, and what every one of them must keep.
fn checked_step(body: &mut Body, start: &Motion, finding: &mut Finding) -> TimeStep {
    let rest = body.solver.rest_parameters();
    let step = body
        .solver
        .time_step(start, &rest, &options())
        .expect("a state of this body");
    // The solve in it once more, looked at from outside.
    let (_, part) = checked_solve(body, &step.parameters, Some(&start.positions), &options());
    finding.merge(part);
    let finite = all_finite(&step.end.positions) && all_finite(&step.end.velocities);
    finding.require(finite, || "a motion that is not finite".into());
    // Stalled is what floating point allows, where the start is nearly all there is to find.
    let status = step.solution.status;
    finding.require(
        matches!(status, Status::Converged | Status::Stalled),
        || format!("{status:?}"),
    );
    step
}

/// Elastic, kinetic and potential energy. `statics` is the same body without inertia.
fn energy(statics: &mut Body, body: &Body, state: &Motion) -> f64 {
    let rest = statics.solver.rest_parameters();
    let elastic = statics.solver.energy_gradient(&rest, &state.positions);
    let momenta = body.solver.momenta(state).expect("it has inertia");
    elastic.expect("a state of this body").0 + momenta.kinetic_energy
}

/// The same body at rest: elasticity, the held wall, gravity.
fn statics() -> Body {
    let mesh = HexMesh::solid_box([8, 3, 3], 0.25, Quadrature::Eight).expect("a valid box");
    let wall = nodes_where(&mesh, |x| x.x == 0.0);
    let gravity = EffectSpec::Gravity {
        acceleration: [0.0, 0.0, -0.01],
        density: 1.0,
    };
    Body::new(mesh, &[elasticity(), held(wall), gravity])
}

pub fn huge_step() -> Finding {
    let mut finding = Finding::default();
    let mut still = statics();
    let rest = still.solver.rest_parameters();
    let (expected, _) = checked_solve(&mut still, &rest, None, &options());
    let mut body = moving(true, TimeScheme::BackwardEuler, 1e6, None);
    let mut state = Motion::still(bent(&body));
    let mut last = energy(&mut still, &body, &state);
    for _ in 0..5 {
        state = checked_step(&mut body, &state, &mut finding).end;
        let now = energy(&mut still, &body, &state);
        finding.require(now <= last + 1e-12 * last.abs(), || {
            format!("energy {now} after {last}")
        });
        last = now;
    }
    let far = max_distance(&state.positions, &expected.positions);
    finding.require(far < 1e-8, || format!("{far:.1e} from the equilibrium"));
    finding
}

pub fn tiny_step() -> Finding {
    let mut finding = Finding::default();
    let step = 1e-9;
    for scheme in SCHEMES {
        let mut body = moving(false, scheme, step, None);
        let start = thrown(bent(&body));
        let mut state = start.clone();
        for _ in 0..5 {
            state = checked_step(&mut body, &state, &mut finding).end;
        }
        let pairs = start.positions.iter().zip(&start.velocities);
        let flown: Vec<_> = pairs.map(|(x, v)| x + v * (5.0 * step)).collect();
        let far = max_distance(&state.positions, &flown);
        finding.require(far < 1e-14, || {
            format!("{scheme:?}: {far:.1e} off its path")
        });
        // Positions have sixteen digits, of which a step moves the ninth.
        let faster = max_distance(&state.velocities, &start.velocities);
        finding.require(faster < 1e-5, || {
            format!("{scheme:?}: velocities changed by {faster:.1e}")
        });
    }
    finding
}

pub fn viscous(flying: bool) -> Finding {
    let mut finding = Finding::default();
    for scheme in SCHEMES {
        let mut body = moving(!flying, scheme, 0.1, Some(1e9));
        let start = match flying {
            true => thrown(bent(&body)),
            false => Motion::still(bent(&body)),
        };
        let mut state = start.clone();
        for _ in 0..3 {
            state = checked_step(&mut body, &state, &mut finding).end;
        }
        let [before, after] =
            [&start.positions, &state.positions].map(|u| mean_strains(&body.mesh, u));
        let strained = before.iter().zip(&after).map(|(a, b)| (a - b).norm());
        let strained = strained.fold(0.0, f64::max);
        // The second half of a midpoint step follows no turn: it stretches by the square of the angle, about 0.03.
        let allowed = match (scheme, flying) {
            (TimeScheme::Midpoint, true) => 3.0 * 0.05f64.powi(2),
            _ => 1e-6,
        };
        finding.require(strained < allowed, || {
            format!("{scheme:?}: strain changed by {strained:.1e}")
        });
        if flying {
            let [a, b] = [&start, &state].map(|s| body.solver.momenta(s).expect("it has inertia"));
            let lost = (a.linear - b.linear).norm() / a.linear.norm();
            // Solved to a share of forces that are a billion times those of elasticity.
            finding.require(lost < 1e-5, || {
                format!("{scheme:?}: {lost:.1e} of the momentum lost")
            });
        } else {
            let moved = max_distance(&state.positions, &start.positions);
            finding.require(moved < 1e-4, || format!("{scheme:?}: moved by {moved:.1e}"));
        }
    }
    // The way down is the same for a method without a line search.
    let mut body = moving(true, TimeScheme::BackwardEuler, 0.1, Some(1e9));
    let start = bent(&body);
    let mut parameters = body.solver.rest_parameters();
    parameters.inertia.clone_from(&start);
    parameters.before.clone_from(&start);
    let options = options().with_method(Method::Newton);
    let (_, part) = checked_solve(&mut body, &parameters, Some(&start), &options);
    finding.merge(part);
    finding
}

/// The Green strain of each element's mean deformation gradient.
fn mean_strains(mesh: &HexMesh, u: &[Vector3<f64>]) -> Vec<Matrix3<f64>> {
    let all = deformation_gradients(mesh, u);
    let samples = all.len() / mesh.elements().len();
    let strain = |of_element: &[Matrix3<f64>]| {
        let f = of_element.iter().sum::<Matrix3<f64>>() / samples as f64;
        (f.transpose() * f - Matrix3::identity()) * 0.5
    };
    all.chunks(samples).map(strain).collect()
}
