//! Steps in time against textbooks, what they keep, and gradients through them.

mod common;

use common::{dot, elasticity, held, nodes_where, tight};
use hex_mesh::{HexMesh, Quadrature};
use nalgebra::Vector3;
use pd_solver::{EffectSpec, Motion, SolveOptions, Solver, Status, Stop, TimeScheme};

fn moving(
    cells: [usize; 3],
    size: f64,
    extra: &[EffectSpec],
    scheme: TimeScheme,
    h: f64,
) -> (HexMesh, Solver) {
    let mesh = HexMesh::solid_box(cells, size, Quadrature::Eight).unwrap();
    let mut effects = vec![
        elasticity(),
        EffectSpec::Inertia {
            density: 2.0,
            time_step: h,
            scheme,
        },
    ];
    effects.extend_from_slice(extra);
    let solver = Solver::new(&mesh, &effects).unwrap();
    (mesh, solver)
}

const SCHEMES: [TimeScheme; 2] = [TimeScheme::BackwardEuler, TimeScheme::Midpoint];

/// Free fall is exact: midpoint falls by g t^2 / 2, backward Euler by g h^2 n (n + 1) / 2.
#[test]
fn free_fall_is_exact() {
    let (h, g, steps) = (0.1, 9.81, 12);
    let gravity = EffectSpec::Gravity {
        acceleration: [0.0, 0.0, -g],
        density: 2.0,
    };
    for scheme in SCHEMES {
        let (mesh, mut solver) = moving([3, 2, 2], 0.5, std::slice::from_ref(&gravity), scheme, h);
        let parameters = solver.rest_parameters();
        let mut state = Motion::still(mesh.nodes().to_vec());
        for _ in 0..steps {
            let step = solver.time_step(&state, &parameters, &tight()).unwrap();
            assert_eq!(step.solution.status, Status::Converged);
            state = step.end;
        }
        let n = f64::from(steps);
        let fallen = match scheme {
            TimeScheme::BackwardEuler => g * h * h * n * (n + 1.0) / 2.0,
            TimeScheme::Midpoint => g * (h * n).powi(2) / 2.0,
        };
        for (x, rest) in state.positions.iter().zip(mesh.nodes()) {
            assert!(
                (x - rest + Vector3::z() * fallen).norm() < 1e-10,
                "{scheme:?}"
            );
        }
    }
}

/// A body that spins, flies and vibrates.
fn thrown(mesh: &HexMesh) -> Motion {
    let spin = Vector3::new(0.4, 1.0, -0.3);
    let velocities = mesh.nodes().iter().map(|x| {
        let wobble = Vector3::new((5.0 * x.y).sin(), (4.0 * x.x).cos(), (3.0 * x.z).sin());
        Vector3::new(0.5, -0.2, 1.0) + spin.cross(x) + wobble * 0.3
    });
    Motion {
        positions: mesh.nodes().to_vec(),
        velocities: velocities.collect(),
    }
}

/// In free flight both rules keep linear momentum, and midpoint angular momentum too, with damping and without.
#[test]
fn free_flight_keeps_momentum() {
    for scheme in SCHEMES {
        for viscosity in [0.0, 0.5] {
            let damping = [EffectSpec::Damping { viscosity }];
            let extra = if viscosity > 0.0 { &damping[..] } else { &[] };
            let (mesh, mut solver) = moving([4, 3, 2], 0.5, extra, scheme, 0.05);
            let parameters = solver.rest_parameters();
            let mut state = thrown(&mesh);
            let start = solver.momenta(&state).unwrap();
            for _ in 0..20 {
                state = solver.time_step(&state, &parameters, &tight()).unwrap().end;
            }
            let end = solver.momenta(&state).unwrap();
            assert!((end.linear - start.linear).norm() < 1e-9 * start.linear.norm());
            let turned = (end.angular - start.angular).norm() / start.angular.norm();
            match scheme {
                TimeScheme::Midpoint => assert!(turned < 1e-9, "{turned}"),
                // Of first order, it lets a spin slow down.
                TimeScheme::BackwardEuler => assert!(turned < 0.2, "{turned}"),
            }
        }
    }
}

/// Without forces the energy of backward Euler never grows, even in huge steps; damping takes more.
#[test]
fn energy_never_grows_by_backward_euler() {
    let mut left = Vec::new();
    for (h, extra) in [
        (0.05, vec![]),
        (0.05, vec![EffectSpec::Damping { viscosity: 0.5 }]),
        (1e3, vec![]),
    ] {
        let (mesh, mut solver) = moving([4, 3, 2], 0.5, &extra, TimeScheme::BackwardEuler, h);
        let mut plain = Solver::new(&mesh, &[elasticity(), EffectSpec::Floating {}]).unwrap();
        let parameters = solver.rest_parameters();
        let rest = plain.rest_parameters();
        let mut total = |solver: &Solver, state: &Motion| {
            let elastic = plain.energy_gradient(&rest, &state.positions).unwrap().0;
            elastic + solver.momenta(state).unwrap().kinetic_energy
        };
        let mut state = thrown(&mesh);
        let mut last = total(&solver, &state);
        for _ in 0..20 {
            state = solver.time_step(&state, &parameters, &tight()).unwrap().end;
            let now = total(&solver, &state);
            assert!(now <= last * (1.0 + 1e-12), "{now} after {last} at h = {h}");
            last = now;
        }
        left.push(last);
    }
    assert!(left[1] < left[0], "{left:?}");
}

/// A cantilever swings with 1.8751^2 / (2 pi) sqrt(E I / (rho A L^4)) (Euler and Bernoulli).
#[test]
fn a_cantilever_swings_with_the_frequency_of_the_textbook() {
    let (length, thickness, h) = (2.5f64, 0.25f64, 4.0);
    let inertia = EffectSpec::Inertia {
        density: 2.0,
        time_step: h,
        scheme: TimeScheme::Midpoint,
    };
    let exact = 1.8751f64.powi(2) / (2.0 * std::f64::consts::PI)
        * (thickness * thickness / 12.0 / (2.0 * length.powi(4))).sqrt();
    let mesh = HexMesh::solid_box([40, 4, 4], 0.0625, Quadrature::Eight).unwrap();
    let wall = nodes_where(&mesh, |x| x.x == 0.0);
    let mut solver = Solver::new(&mesh, &[elasticity(), held(wall), inertia]).unwrap();
    let parameters = solver.rest_parameters();
    // The shape of the first mode, roughly, and small.
    let bent = mesh.nodes().iter().map(|x| {
        let s = x.x / length;
        x + Vector3::y() * (1e-3 * s * s * (3.0 - s))
    });
    let mut state = Motion::still(bent.collect());
    let tip = mesh.nodes().len() - 1;
    let rest = mesh.nodes()[tip].y;
    let options = SolveOptions::new(Stop::Accuracy(1e-9));
    let (mut crossings, mut last) = (Vec::new(), state.positions[tip].y - rest);
    for step in 1..200 {
        state = solver.time_step(&state, &parameters, &options).unwrap().end;
        let now = state.positions[tip].y - rest;
        if now.signum() != last.signum() {
            crossings.push(f64::from(step) - now / (now - last));
        }
        last = now;
        if crossings.len() == 5 {
            break;
        }
    }
    // From the first zero to the fifth there are two periods.
    let frequency = 2.0 / (h * (crossings[4] - crossings[0]));
    assert!(
        (frequency / exact - 1.0).abs() < 0.04,
        "{frequency} {exact}"
    );
}

/// The gradient of a loss on the end of a motion by its start, by loads and by where a held wall is moved, through all steps.
#[test]
fn gradients_go_back_through_time() {
    for scheme in SCHEMES {
        let mesh = HexMesh::solid_box([3, 2, 2], 0.5, Quadrature::Eight).unwrap();
        let wall = nodes_where(&mesh, |x| x.x == 0.0);
        let effects = [
            elasticity(),
            held(wall),
            EffectSpec::Inertia {
                density: 2.0,
                time_step: 0.2,
                scheme,
            },
            EffectSpec::Damping { viscosity: 0.3 },
            EffectSpec::Gravity {
                acceleration: [0.0, 0.1, -0.3],
                density: 2.0,
            },
        ];
        let mut solver = Solver::new(&mesh, &effects).unwrap();
        let rest = solver.rest_parameters();
        let mut numbers = common::Numbers::new(11);
        let steps = 4;
        let n = mesh.nodes().len();
        let bar = Motion {
            positions: numbers.vectors(n, 1.0),
            velocities: numbers.vectors(n, 0.3),
        };
        let (dx, dv) = (numbers.vectors(n, 0.1), numbers.vectors(n, 0.3));
        let (shake, pull) = (numbers.vector(), numbers.vector());
        // Start, wall and load in a direction, as far as t.
        let at = |t: f64, step: usize| {
            let mut p = rest.clone();
            for x in &mut p.prescribed {
                *x += shake * (t * (step + 1) as f64);
            }
            p.acceleration[0] += pull * t;
            p
        };
        let start = |t: f64| {
            let mut start = thrown(&mesh);
            for (x, d) in start.positions.iter_mut().zip(&dx) {
                *x += d * t;
            }
            for (v, d) in start.velocities.iter_mut().zip(&dv) {
                *v += d * t;
            }
            start
        };
        let mut loss = |t: f64| {
            let mut state = start(t);
            for step in 0..steps {
                state = solver
                    .time_step(&state, &at(t, step), &tight())
                    .unwrap()
                    .end;
            }
            dot(&state.positions, &bar.positions) + dot(&state.velocities, &bar.velocities)
        };
        let slope = common::difference(1e-3, &mut loss);
        let mut taken = Vec::new();
        let mut state = start(0.0);
        for step in 0..steps {
            let step = solver.time_step(&state, &at(0.0, step), &tight()).unwrap();
            state = step.end.clone();
            taken.push(step);
        }
        let (mut back, mut exact) = (bar.clone(), 0.0);
        for (number, step) in taken.iter().enumerate().rev() {
            let options = pd_solver::AdjointOptions {
                tolerance: 1e-13,
                ..Default::default()
            };
            let (gradient, _) = solver.time_step_adjoint(step, &back, &options).unwrap();
            let gradient = gradient.unwrap();
            let walls: Vector3<f64> = gradient.parameters.prescribed.iter().sum();
            exact += walls.dot(&shake) * (number + 1) as f64;
            exact += gradient.parameters.acceleration[0].dot(&pull);
            back = gradient.start;
        }
        exact += dot(&back.positions, &dx) + dot(&back.velocities, &dv);
        assert!(
            (slope / exact - 1.0).abs() < 1e-6,
            "{scheme:?} {slope} {exact}"
        );
    }
}
