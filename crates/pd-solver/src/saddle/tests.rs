//! When a solve looks for a saddle, and how far it steps off one.

use super::{MANY, MAX_DOUBLINGS};
use crate::krylov::LinearStatus;
use crate::methods::Outcome;
use crate::solution::{Estimate, Method, Status};
use crate::spec::{EffectSpec, NodeSet, Obstacle};
use crate::vector::{NodalVector, add_scaled, max_norm, zeros};
use crate::{EmbeddedSurface, Solver};
use hex_mesh::{HexMesh, NodeRegion, Quadrature};
use nalgebra::Vector3;

const EDGE: f64 = 0.1;

/// A column held at both ends, which are pressed together to a share of its length, and where it stays straight: an equilibrium, and where it is
/// pressed by more than about 9 % a saddle.
fn column(pressed: f64, extra: Vec<EffectSpec>) -> (Solver, NodalVector) {
    column_of(1.0, pressed, extra)
}

fn column_of(stiffness: f64, pressed: f64, extra: Vec<EffectSpec>) -> (Solver, NodalVector) {
    let mesh = HexMesh::solid_box([12, 2, 2], EDGE, Quadrature::Eight).unwrap();
    let nodes = 0..mesh.nodes().len() as u32;
    let ends = nodes.filter(|&n| !(0.01..1.19).contains(&mesh.nodes()[n as usize].x));
    let mut effects = vec![
        EffectSpec::Elasticity { stiffness },
        EffectSpec::Prescribed {
            nodes: NodeSet::Indices(ends.collect()),
        },
    ];
    effects.extend(extra);
    let surface = EmbeddedSurface::boundary(&mesh);
    let mut solver = Solver::on_surface(&mesh, &surface, &effects).unwrap();
    let mut parameters = solver.rest_parameters();
    parameters
        .prescribed
        .iter_mut()
        .for_each(|x| x.x *= pressed);
    solver.problem.set_parameters(&parameters);
    let straight = mesh.nodes().iter();
    let straight = straight.map(|x| Vector3::new(pressed * x.x, x.y, x.z));
    (solver, straight.collect())
}

fn energy(solver: &mut Solver, u: &[Vector3<f64>]) -> f64 {
    solver.problem.evaluate(u, &mut zeros(u.len()))
}

/// A step off the straight state, in units of the direction that was found there.
struct Step {
    direction: NodalVector,
    signed: f64,
    to: NodalVector,
}

/// None where no negative curvature is seen.
fn step_off(solver: &mut Solver, straight: &NodalVector, seed: u64) -> Option<Step> {
    let method = Method::Lbfgs;
    if solver.look(method, straight, seed) != LinearStatus::NegativeCurvature {
        return None;
    }
    let direction = solver.parts(method).2.krylov.d.clone();
    let (before, mut to) = (energy(solver, straight), straight.clone());
    assert!(solver.step_off(method, &mut to, before));
    let square: f64 = direction.iter().map(|d| d.norm_squared()).sum();
    let moved = to.iter().zip(straight).zip(&direction);
    let signed = moved.map(|((to, from), d)| (to - from).dot(d)).sum::<f64>() / square;
    Some(Step {
        direction,
        signed,
        to,
    })
}

/// How far a column has to be pressed together for its straight state to be seen as a saddle.
fn critical() -> f64 {
    let (mut buckles, mut stays) = (0.8, 0.97);
    for _ in 0..14 {
        let middle = 0.5 * (buckles + stays);
        let (mut solver, straight) = column(middle, vec![]);
        match solver.look(Method::Lbfgs, &straight, 0) {
            LinearStatus::NegativeCurvature => buckles = middle,
            _ => stays = middle,
        }
    }
    buckles
}

impl Step {
    fn energy_at(&self, solver: &mut Solver, straight: &NodalVector, signed: f64) -> f64 {
        let mut u = straight.clone();
        add_scaled(straight, signed, &self.direction, &mut u);
        energy(solver, &u)
    }

    /// Doublings of an edge of an element by the node that moves most; negative for halvings.
    fn doublings(&self) -> f64 {
        (self.signed.abs() * max_norm(&self.direction) / EDGE).log2()
    }
}

/// Pressed by far too much a column steps farther than an edge; by a little too much, less.
#[test]
fn a_step_off_a_saddle_is_an_edge_doubled_or_halved_while_the_energy_falls() {
    let (mut signs, mut doubled, mut halved) = ([0; 2], 0, 0);
    let critical = critical();
    for pressed in [0.4, 0.5, 0.6, 0.7, 0.8, critical - 1e-3, critical] {
        let (mut solver, straight) = column(pressed, vec![]);
        let before = energy(&mut solver, &straight);
        let seeds = (0..6).filter_map(|seed| step_off(&mut solver, &straight, seed));
        let steps: Vec<Step> = seeds.collect();
        assert!(steps.len() == 6 || pressed > 0.8 && !steps.is_empty());
        for step in steps {
            let doublings = step.doublings();
            assert!((doublings - doublings.round()).abs() < 1e-6, "{doublings}");
            assert!(doublings < MAX_DOUBLINGS as f64);
            let mut at = |factor: f64| step.energy_at(&mut solver, &straight, factor * step.signed);
            let least = at(1.0);
            assert!(least < before && at(2.0) >= least, "{pressed}");
            signs[usize::from(step.signed < 0.0)] += 1;
            if doublings > 0.5 {
                doubled += 1;
                assert!(at(0.5) > least, "{pressed}");
            } else {
                // The better of the two sides.
                assert!(at(-1.0) >= least, "{pressed}");
            }
            if doublings < -0.5 {
                halved += 1;
                assert!(at(2.0) >= before && at(-2.0) >= before);
            }
        }
    }
    assert!(signs.iter().all(|n| *n > 2), "{signs:?}");
    assert!(doubled > 0 && halved > 3, "{doubled} {halved}");
}

/// What is a fall of the energy depends on how large it is: soft and hard columns make the same step.
#[test]
fn a_step_off_a_saddle_does_not_depend_on_units() {
    let (mut solver, straight) = column(0.8, vec![]);
    let expected = step_off(&mut solver, &straight, 3).unwrap().to;
    for stiffness in [2.0_f64.powi(-60), 2.0_f64.powi(60)] {
        let (mut solver, straight) = column_of(stiffness, 0.8, vec![]);
        let found = step_off(&mut solver, &straight, 3).unwrap().to;
        let errors = found.iter().zip(&expected).map(|(a, b)| (a - b).norm());
        assert!(errors.fold(0.0, f64::max) < 1e-9, "{stiffness}");
    }
}

/// No step leads off a minimum, and none along a direction that is none; the state stays as it was.
#[test]
fn there_is_no_step_off_a_minimum() {
    let (mut solver, straight) = column(0.93, vec![]);
    let method = Method::Lbfgs;
    let before = energy(&mut solver, &straight);
    let looked = solver.look(method, &straight, 0);
    assert_eq!(looked, LinearStatus::Converged);
    let arched = { straight.iter() }
        .map(|x| Vector3::new(0.0, x.x * (1.14 - x.x), 0.0))
        .collect();
    let nowhere = zeros(straight.len());
    let lost = vec![Vector3::repeat(f64::NAN); straight.len()];
    let endless = vec![Vector3::repeat(f64::INFINITY); straight.len()];
    for direction in [arched, nowhere, lost, endless] {
        let (problem, _, space) = solver.parts(method);
        space.krylov.d = direction;
        problem.clear_prescribed(&mut space.krylov.d);
        let mut u = straight.clone();
        assert!(!solver.step_off(method, &mut u, before));
        assert_eq!(u, straight);
    }
}

/// Walls at both sides of the column along y, at some distances from it.
fn walls(below: f64, above: f64) -> Vec<EffectSpec> {
    let plane = |normal, offset| Obstacle::Plane { normal, offset };
    vec![EffectSpec::Contact {
        region: Some(NodeRegion::Box {
            min: [0.05, -1.0, -1.0],
            max: [1.15, 1.0, 1.0],
        }),
        distance: 1e-3,
        stiffness: Some(1e-3),
        own: false,
        obstacles: vec![
            plane([0.0, 1.0, 0.0], -below),
            plane([0.0, -1.0, 0.0], -2.0 * EDGE - above),
        ],
    }]
}

/// With a wall next to one side a step goes to the other, or no farther than to nine tenths of the gap; with both far away walls do not matter.
#[test]
fn a_step_off_a_saddle_stays_between_walls() {
    let (mut near, mut far) = (0, 0);
    for (below, above) in [
        (0.004, 5.0),
        (5.0, 0.004),
        (0.004, 0.006),
        (0.3, 5.0),
        (50.0, 50.0),
    ] {
        let (mut solver, straight) = column(0.6, walls(below, above));
        let (mut free, _) = column(0.6, vec![]);
        for seed in 0..4 {
            let step = step_off(&mut solver, &straight, seed).unwrap();
            let before = energy(&mut solver, &straight);
            assert!(energy(&mut solver, &step.to) < before);
            let gaps = |u: &NodalVector| {
                let y = || u.iter().map(|x| x.y);
                [
                    y().fold(f64::INFINITY, f64::min) + below,
                    2.0 * EDGE + above - y().fold(f64::NEG_INFINITY, f64::max),
                ]
            };
            let (start, end) = (gaps(&straight), gaps(&step.to));
            for (start, end) in start.into_iter().zip(end) {
                assert!(end >= 0.0999 * start, "{start} {end}");
            }
            // Where there is room, the step is that of a column without walls.
            if below.min(above) == 50.0 {
                let other = step_off(&mut free, &straight, seed).unwrap();
                assert!((other.signed / step.signed - 1.0).abs() < 1e-9);
                far += 1;
            }
            // Twice as far would pass a wall, or gain nothing.
            let mut twice = straight.clone();
            add_scaled(&straight, 2.0 * step.signed, &step.direction, &mut twice);
            let passes = gaps(&twice)
                .into_iter()
                .zip(start)
                .any(|(gap, start)| gap < 0.1001 * start);
            near += usize::from(passes);
            assert!(passes || energy(&mut solver, &twice) >= energy(&mut solver, &step.to));
        }
    }
    assert!(near > 3 && far > 3, "{near} {far}");
}

/// A step is not doubled into the last tenth of the gap, though there the wall is not yet felt and the energy is less, in whatever units the
/// direction is.
#[test]
fn a_step_off_a_saddle_is_not_doubled_into_the_last_of_a_gap() {
    let mut limited = 0;
    for (pressed, seed) in [0.3, 0.35, 0.4, 0.45, 0.5, 0.55, 0.6]
        .into_iter()
        .flat_map(|pressed| (0..10).map(move |seed| (pressed, seed)))
    {
        let (mut free, straight) = column(pressed, vec![]);
        let Some(step) = step_off(&mut free, &straight, seed) else {
            continue;
        };
        let doublings = step.doublings();
        let Step {
            direction, signed, ..
        } = step;
        let aside = direction.iter().map(|d| d.y.abs()).fold(0.0, f64::max);
        // Some buckle along z, where there is no wall.
        if doublings < 0.5 || aside < 0.5 * max_norm(&direction) {
            continue;
        }
        let gap = signed.abs() * aside / 0.95;
        let (mut solver, _) = column(pressed, walls(gap, gap));
        for unit in [1.0, 1e-3, 1e3] {
            let method = Method::Lbfgs;
            let before = energy(&mut solver, &straight);
            // What makes room in the space to work in.
            solver.look(method, &straight, seed);
            let mut scaled = direction.clone();
            scaled.iter_mut().for_each(|d| *d *= unit);
            solver.parts(method).2.krylov.d = scaled;
            let mut to = straight.clone();
            assert!(solver.step_off(method, &mut to, before));
            let mut at = |share: f64| {
                let mut u = straight.clone();
                add_scaled(&straight, share * signed, &direction, &mut u);
                (energy(&mut solver, &u), u)
            };
            let ((half, expected), (whole, _)) = (at(0.5), at(1.0));
            assert!(whole < half && half < before);
            let off = to.iter().zip(&expected).map(|(a, b)| (a - b).norm());
            assert!(off.fold(0.0, f64::max) < 1e-9, "{pressed} {seed} {unit}");
            limited += 1;
        }
    }
    assert!(limited > 2, "{limited}");
}

/// Many steps, or samples inside out where nothing else was looked at, are reasons to look; an easy solve is none.
#[test]
fn a_solve_looks_for_a_saddle_after_many_steps_or_when_inside_out() {
    let (mut solver, straight) = column(0.95, vec![]);
    let folded: NodalVector = { straight.iter() }
        .map(|x| Vector3::new(0.5 - (x.x - 0.5).abs(), x.y, x.z))
        .collect();
    let mut looks = |method, u: &NodalVector, iterations, estimate| {
        let outcome = Outcome {
            status: Status::Converged,
            iterations,
            energy: 0.0,
            gradient_norm: 0.0,
            estimated_error: None,
            estimate,
        };
        solver.may_be_saddle(method, u, &outcome)
    };
    let told = [Estimate::Direction, Estimate::Extrapolation];
    let others = [Estimate::None, Estimate::NewtonStep, Estimate::Measured];
    for method in [Method::Lbfgs, Method::Newton, Method::Anderson] {
        for estimate in told.into_iter().chain(others) {
            assert!(looks(method, &straight, MANY + 1, estimate));
            assert!(!looks(method, &straight, MANY, estimate));
            // L-BFGS takes its direction for the error only where it has seen that nothing is inverted.
            let seen = method == Method::Lbfgs && told.contains(&estimate);
            assert_eq!(
                looks(method, &folded, MANY, estimate),
                !seen,
                "{method:?} {estimate:?}"
            );
        }
    }
}
