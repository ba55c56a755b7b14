//! The multigrid methods on bodies that are large enough for them: minima, effects, gradients, warm starts.

mod common;

use common::{Numbers, difference, dot, elasticity, held, max_distance, nodes_where};
use hex_mesh::{HexMesh, Quadrature};
use nalgebra::Vector3;
use pd_solver::{
    Adjoint, AdjointOptions, AdjointStatus, EffectSpec, Estimate, Method, NodeSet, Parameters,
    Solution, SolveOptions, Solver, SpringPoints, Status, Stop,
};

/// Cells of a box for which `keep` holds, as a body whose edges are one tenth.
fn body(n: [i32; 3], keep: impl Fn([i32; 3]) -> bool) -> HexMesh {
    let all =
        (0..n[0]).flat_map(|x| (0..n[1]).flat_map(move |y| (0..n[2]).map(move |z| [x, y, z])));
    let cells = all.filter(|&c| keep(c)).collect();
    HexMesh::from_cells(cells, Vector3::zeros(), 0.1, Quadrature::Eight).unwrap()
}

/// Where a body is held.
type Place = fn(&Vector3<f64>) -> bool;

/// Bodies with odd extents, thin, bent, hollow and of two pieces, and where they are held.
fn bodies() -> Vec<(&'static str, HexMesh, Place)> {
    let wall: Place = |x| x.x == 0.0;
    vec![
        ("odd box", body([25, 5, 5], |_| true), wall),
        ("odder box", body([17, 7, 9], |_| true), wall),
        ("one thick", body([24, 1, 23], |_| true), wall),
        ("one thick along x", body([1, 21, 24], |_| true), |x| {
            x.y == 0.0
        }),
        ("L", body([17, 4, 17], |c| c[0] < 5 || c[2] < 5), |x| {
            x.z > 1.65
        }),
        (
            "hollow",
            body([11, 11, 11], |c| c.iter().any(|&x| !(3..8).contains(&x))),
            wall,
        ),
        ("two pieces", body([13, 8, 7], |c| c[0] != 6), |x| {
            x.y == 0.0
        }),
    ]
}

/// Smooth bending and twisting over the whole body, as in the published benchmark of this problem.
fn smooth(mesh: &HexMesh, solver: &Solver, amplitude: f64) -> Parameters {
    let mut parameters = solver.rest_parameters();
    let top = mesh
        .nodes()
        .iter()
        .fold(Vector3::zeros(), |a: Vector3<f64>, x| a.sup(x));
    for (b, x) in parameters.actuation.iter_mut().zip(mesh.sample_positions()) {
        let c = x.component_div(&top);
        let s = 0.3 * amplitude * (2.0 * c.z - 1.0);
        let turn = std::f64::consts::TAU;
        let shear = 0.05 * amplitude;
        *b = [
            s,
            shear * (turn * c.x).sin(),
            0.0,
            -0.15 * s,
            shear * (turn * c.y).cos(),
            -0.5 * s,
        ];
    }
    parameters
}

fn stop(relative: f64) -> SolveOptions {
    SolveOptions::new(Stop::RelativeGradient(relative))
}

/// The start from coarse bodies leads to the minimum that a start from rest leads to.
#[test]
fn coarse_to_fine_finds_the_minimum_of_a_start_from_rest() {
    for (name, mesh, hold) in bodies() {
        let nodes = nodes_where(&mesh, hold);
        let mut solver = Solver::new(&mesh, &[elasticity(), held(nodes)]).unwrap();
        assert!(solver.levels().len() > 1, "{name}");
        for amplitude in [0.5, 1.0] {
            let parameters = smooth(&mesh, &solver, amplitude);
            let coarse = solver.solve(&parameters, None, &stop(1e-9)).unwrap();
            assert_eq!(coarse.status, Status::Converged, "{name}");
            assert_eq!(coarse.stats.method, Method::Multigrid, "{name}");
            assert!(
                coarse.stats.coarse_iterations > 0 && !coarse.stats.fell_back,
                "{name}"
            );
            let rest = solver.rest().to_vec();
            for method in [Method::Multigrid, Method::Newton, Method::Lbfgs] {
                let options = stop(1e-9).with_method(method);
                let from_rest = solver.solve(&parameters, Some(&rest), &options).unwrap();
                assert_eq!(from_rest.status, Status::Converged, "{name} {method:?}");
                assert_eq!(from_rest.stats.coarse_iterations, 0);
                let (a, b) = (coarse.stats.energy, from_rest.stats.energy);
                assert!(
                    (a - b).abs() < 1e-9 * b,
                    "{name} {amplitude} {method:?}: {a:e} {b:e}"
                );
            }
        }
    }
}

/// Springs, weight, and held nodes that move and lie inside coarse elements: all methods agree.
#[test]
fn effects_are_carried_down() {
    let mesh = body([12, 7, 9], |_| true);
    let bone = nodes_where(&mesh, |x| (x - Vector3::new(0.35, 0.35, 0.45)).norm() < 0.2);
    let tip = nodes_where(&mesh, |x| x.x > 1.15);
    let tip_count = tip.len();
    let effects = [
        elasticity(),
        held(bone),
        EffectSpec::Springs {
            points: SpringPoints::Nodes(NodeSet::Indices(tip)),
            stiffness: 0.03,
        },
        EffectSpec::Gravity {
            acceleration: [0.0, 0.0, -0.05],
            density: 1.0,
        },
    ];
    let mut solver = Solver::new(&mesh, &effects).unwrap();
    let mut parameters = smooth(&mesh, &solver, 0.5);
    let turn = nalgebra::Rotation3::from_euler_angles(0.1, 0.2, -0.1);
    for x in &mut parameters.prescribed {
        *x = turn * *x + Vector3::new(0.02, 0.0, 0.05);
    }
    for target in &mut parameters.spring_targets[..tip_count] {
        *target += Vector3::new(0.1, 0.2, 0.0);
    }
    let reference = solver.solve(&parameters, None, &stop(1e-10)).unwrap();
    assert_eq!(reference.stats.method, Method::Multigrid);
    for method in [Method::Newton, Method::Lbfgs, Method::Anderson] {
        let options = stop(1e-10).with_method(method);
        let other = solver.solve(&parameters, None, &options).unwrap();
        assert_eq!(other.status, Status::Converged, "{method:?}");
        let away = max_distance(&reference.positions, &other.positions);
        assert!(away < 1e-7, "{method:?}: {away:e}");
    }
}

/// What is asked in length units is reached within what an estimate can promise, and the error is told truthfully.
#[test]
fn accuracy_is_reached_by_the_free_estimate() {
    for (name, mesh, hold) in bodies() {
        let nodes = nodes_where(&mesh, hold);
        let mut solver = Solver::new(&mesh, &[elasticity(), held(nodes)]).unwrap();
        let parameters = smooth(&mesh, &solver, 1.0);
        let truth = solver.solve(&parameters, None, &stop(1e-11)).unwrap();
        for accuracy in [1e-2, 1e-3, 1e-4, 1e-6] {
            let options = SolveOptions::new(Stop::Accuracy(accuracy));
            let solution = solver.solve(&parameters, None, &options).unwrap();
            assert_eq!(solution.status, Status::Converged, "{name}");
            let error = max_distance(&truth.positions, &solution.positions);
            let estimate = solution.stats.estimated_error.expect("steps were made");
            assert!(
                error <= 1.5 * accuracy,
                "{name}: asked {accuracy:e}, reached {error:e}"
            );
            assert!(
                error <= 2.0 * estimate,
                "{name}: estimated {estimate:e}, reached {error:e}"
            );
            let kind = solution.stats.estimate;
            assert!(
                matches!(kind, Estimate::Direction | Estimate::NewtonStep),
                "{kind:?}"
            );
        }
    }
}

/// Where samples are inside out no direction tells the error: a Newton step near the end does, and comes with an estimate above the error.
#[test]
fn a_doubtful_solve_ends_by_a_step_that_tells_its_error() {
    let mut by_newton = 0;
    // Held at its edge, the plate that is one thick along x is bent without a side to prefer.
    for (name, mesh, hold) in bodies().into_iter().filter(|b| b.0 != "one thick along x") {
        let nodes = nodes_where(&mesh, hold);
        let mut solver = Solver::new(&mesh, &[elasticity(), held(nodes)]).unwrap();
        for amplitude in [1.5, 2.0, 2.5] {
            let parameters = smooth(&mesh, &solver, amplitude);
            let solution = solver.solve(&parameters, None, &stop(1e-4)).unwrap();
            assert_eq!(solution.status, Status::Converged, "{name}");
            by_newton += usize::from(solution.stats.estimate == Estimate::NewtonStep);
            // The equilibrium next to it, not another one.
            let (options, at) = (stop(1e-11), Some(&solution.positions[..]));
            let truth = solver.solve(&parameters, at, &options).unwrap();
            let error = max_distance(&truth.positions, &solution.positions);
            let estimate = solution.stats.estimated_error.expect("steps were made");
            assert!(
                error <= estimate,
                "{name}, {amplitude}: estimated {estimate:e}, reached {error:e}"
            );
        }
    }
    assert!(by_newton > 3, "{by_newton}");
}

/// A flap that is one element thick and twelve long is bent by the cycle too: 18 iterations where smoothing it no more than the rest takes 23.
#[test]
fn an_ear_costs_few_iterations() {
    let iterations = |ear: bool| {
        let mesh = body([24, 12, 24], |c| c[2] < 12 || (ear && c[0] == 15));
        let wall = nodes_where(&mesh, |x| x.x == 0.0);
        let mut solver = Solver::new(&mesh, &[elasticity(), held(wall)]).unwrap();
        let parameters = smooth(&mesh, &solver, 0.3);
        let at = solver.solve(&parameters, None, &stop(1e-6)).unwrap();
        let cotangent = Numbers::new(3).vectors(mesh.nodes().len(), 1.0);
        let adjoint = solver.adjoint(&parameters, &at, &cotangent, &to(1e-6));
        adjoint.unwrap().stats.iterations
    };
    assert!(iterations(false) < 9);
    assert!(iterations(true) < 21);
}

fn at_equilibrium() -> (HexMesh, Solver, Parameters, Solution) {
    let mesh = body([12, 6, 7], |_| true);
    let wall = nodes_where(&mesh, |x| x.x == 0.0);
    let mut solver = Solver::new(&mesh, &[elasticity(), held(wall)]).unwrap();
    let parameters = smooth(&mesh, &solver, 0.7);
    let at = solver.solve(&parameters, None, &stop(1e-12)).unwrap();
    assert_eq!(at.status, Status::Converged);
    (mesh, solver, parameters, at)
}

fn to(tolerance: f64) -> AdjointOptions {
    AdjointOptions {
        tolerance,
        ..AdjointOptions::default()
    }
}

/// Entries of the gradient against differences of full solves, both by multigrid.
#[test]
fn gradients_agree_with_differences_of_the_full_solve() {
    let (mesh, mut solver, parameters, at) = at_equilibrium();
    let weights = Numbers::new(5).vectors(mesh.nodes().len(), 1.0);
    let adjoint = solver
        .adjoint(&parameters, &at, &weights, &to(1e-12))
        .unwrap();
    assert_eq!(adjoint.status, AdjointStatus::Converged);
    let gradient = adjoint.gradient.unwrap();
    let scale = gradient
        .actuation
        .iter()
        .flatten()
        .fold(0.0f64, |a, b| a.max(b.abs()));
    for (sample, entry) in [(0, 0), (1000, 3), (2500, 1), (4031, 5)] {
        let slope = difference(2e-3, |t| {
            let mut p = parameters.clone();
            p.actuation[sample][entry] += t;
            let solution = solver.solve(&p, Some(&at.positions), &stop(1e-13)).unwrap();
            dot(&weights, &solution.positions)
        });
        let error = (slope - gradient.actuation[sample][entry]).abs() / scale;
        assert!(error < 1e-7, "{sample}, {entry}: {error:e}");
    }
    let slope = difference(1e-3, |t| {
        let mut p = parameters.clone();
        p.prescribed[11].y += t;
        let solution = solver.solve(&p, Some(&at.positions), &stop(1e-13)).unwrap();
        dot(&weights, &solution.positions)
    });
    let scale = gradient
        .prescribed
        .iter()
        .fold(0.0f64, |a, b| a.max(b.amax()));
    assert!((slope - gradient.prescribed[11].y).abs() < 1e-7 * scale);
}

/// Several cotangents at once give what each gives alone; a start from an earlier multiplier saves iterations and does no harm.
#[test]
fn cotangents_together_and_warm() {
    let (mesh, mut solver, parameters, at) = at_equilibrium();
    let mut numbers = Numbers::new(9);
    let cotangents: Vec<_> = (0..3)
        .map(|_| numbers.vectors(mesh.nodes().len(), 1.0))
        .collect();
    let each: Vec<Adjoint> = cotangents
        .iter()
        .map(|c| solver.adjoint(&parameters, &at, c, &to(1e-10)).unwrap())
        .collect();
    let mut together = vec![Adjoint::default(); 3];
    let slices: Vec<&[_]> = cotangents.iter().map(|c| &c[..]).collect();
    solver
        .adjoints_into(&parameters, &at, &slices, &to(1e-10), &mut together)
        .unwrap();
    for (a, b) in each.iter().zip(&together) {
        assert_eq!(a.gradient, b.gradient);
        assert_eq!(a.multiplier, b.multiplier);
    }
    let nearby: Vec<_> = cotangents[0].iter().map(|c| c * 1.01).collect();
    let mut warm = each[0].clone();
    let options = AdjointOptions {
        warm_start: true,
        ..to(1e-10)
    };
    solver
        .adjoint_into(&parameters, &at, &nearby, &options, &mut warm)
        .unwrap();
    assert!(warm.stats.iterations < each[0].stats.iterations);
    let away = max_distance(
        &warm.multiplier,
        &each[0]
            .multiplier
            .iter()
            .map(|z| z * 1.01)
            .collect::<Vec<_>>(),
    );
    let size = each[0]
        .multiplier
        .iter()
        .fold(0.0f64, |a, z| a.max(z.norm()));
    assert!(away < 1e-8 * size, "{away:e} of {size:e}");
    // A multiplier of something else is no start, but does no harm either.
    let mut strange = each[1].clone();
    strange.multiplier.iter_mut().for_each(|z| *z *= 1e6);
    solver
        .adjoint_into(&parameters, &at, &cotangents[0], &options, &mut strange)
        .unwrap();
    assert_eq!(strange.multiplier, each[0].multiplier);
}

/// A solve may start where another one ended; it then needs fewer steps, no coarse body, and with `reuse` no new operators.
#[test]
fn warm_starts_skip_what_they_need_not_redo() {
    let (_, mut solver, parameters, at) = at_equilibrium();
    let mut changed = parameters.clone();
    changed
        .actuation
        .iter_mut()
        .flatten()
        .for_each(|b| *b *= 1.01);
    let cold = solver.solve(&changed, None, &stop(1e-6)).unwrap();
    for reuse in [false, true] {
        let before = solver.work();
        let options = SolveOptions {
            reuse,
            ..stop(1e-6)
        };
        let warm = solver
            .solve(&changed, Some(&at.positions), &options)
            .unwrap();
        let work = warm.stats.work;
        assert_eq!(warm.status, Status::Converged);
        assert!(warm.stats.iterations <= cold.stats.iterations);
        assert_eq!(warm.stats.coarse_iterations, 0);
        assert_eq!(
            work.multigrid_builds - before.multigrid_builds,
            u64::from(!reuse)
        );
        assert!((warm.stats.energy / cold.stats.energy - 1.0).abs() < 1e-8);
    }
}

/// A solve that goes on from where the last one ended begins by what the change of the actuation does, which spares it the first evaluation. It
/// ends where others do, also where the actuation changes so from sample to sample that the middles of elements say little, where
/// it changes a lot, and where nothing changes; and it does not begin so where something else changes as well.
#[test]
fn solves_that_go_on_begin_by_the_change_of_the_actuation() {
    let (mesh, mut solver, parameters, _) = at_equilibrium();
    let reuse = SolveOptions {
        reuse: true,
        ..stop(1e-6)
    };
    let mut numbers = Numbers::new(12);
    let mut noisy = parameters.clone();
    for b in noisy.actuation.iter_mut().flatten() {
        *b += 0.02 * numbers.next();
    }
    let mut alternating = parameters.clone();
    for (sample, b) in alternating.actuation.iter_mut().enumerate() {
        b[0] += if sample % 2 == 0 { 0.05 } else { -0.05 };
    }
    let mut moved = smooth(&mesh, &solver, 0.707);
    for x in &mut moved.prescribed {
        x.y += 0.01;
    }
    // Whether an evaluation is spared.
    for (what, changed, spared) in [
        ("a hundredth", smooth(&mesh, &solver, 0.707), true),
        ("a half", smooth(&mesh, &solver, 1.0), true),
        ("noise", noisy, false),
        ("alternating", alternating, false),
        ("nothing", parameters.clone(), false),
        ("held nodes", moved, false),
    ] {
        let cold = solver.solve(&changed, None, &stop(1e-6)).unwrap();
        let mut warm_by_evaluations = [(); 2].map(|()| None);
        for (goes_on, warm) in [true, false].into_iter().zip(&mut warm_by_evaluations) {
            let at = solver.solve(&parameters, None, &stop(1e-6)).unwrap();
            let mut start = at.positions;
            // Elsewhere by a last digit: that is not where the last solve ended.
            start[0].x += f64::from(u8::from(!goes_on)) * f64::EPSILON;
            let before = solver.work().evaluations;
            let solved = solver.solve(&changed, Some(&start), &reuse).unwrap();
            assert_eq!(solved.status, Status::Converged, "{what}");
            let away = max_distance(&solved.positions, &cold.positions);
            assert!(away < 2e-6, "{what}: {away}");
            *warm = Some((solver.work().evaluations - before, solved));
        }
        let [Some((on, goes_on)), Some((off, other))] = warm_by_evaluations else {
            unreachable!("both were solved");
        };
        let limit = if spared { off - 1 } else { off + 2 };
        assert!(on <= limit, "{what}: {on} evaluations, else {off}");
        if what == "held nodes" || what == "nothing" {
            assert_eq!(goes_on.positions, other.positions, "{what}");
            assert_eq!(on, off, "{what}");
        }
    }
}

/// Weight has no actuation that could change and no samples that could be inside out: with it directions tell the error as without, and a solve
/// that goes on where nothing changed has nothing to do but to see that.
#[test]
fn effects_without_samples_raise_no_doubt() {
    let mesh = body([12, 6, 7], |_| true);
    let wall = nodes_where(&mesh, |x| x.x == 0.0);
    let weight = EffectSpec::Gravity {
        acceleration: [0.0, 0.0, -0.02],
        density: 1.0,
    };
    let mut solver = Solver::new(&mesh, &[elasticity(), held(wall), weight]).unwrap();
    let parameters = smooth(&mesh, &solver, 0.5);
    let reuse = SolveOptions {
        reuse: true,
        ..stop(1e-4)
    };
    let mut costs = Vec::new();
    for away in [0.0, f64::EPSILON] {
        let at = solver.solve(&parameters, None, &stop(1e-4)).unwrap();
        assert_eq!(at.stats.estimate, Estimate::Direction);
        let mut start = at.positions;
        start[0].x += away;
        let before = solver.work();
        solver.solve(&parameters, Some(&start), &reuse).unwrap();
        let after = solver.work();
        let evaluations = after.evaluations - before.evaluations;
        costs.push((
            evaluations,
            after.multigrid_cycles - before.multigrid_cycles,
        ));
    }
    // At rest, which says where to stop, and at the start.
    assert_eq!(costs, [(2, 0); 2]);
}

/// Solves that go on from each other by a length do not add up what each leaves: what was left is in the
/// gradient that the next one begins by.
#[test]
fn solves_that_go_on_do_not_drift() {
    let (mesh, mut solver, parameters, _) = at_equilibrium();
    let accuracy = 1e-3;
    let reuse = SolveOptions {
        reuse: true,
        ..SolveOptions::new(Stop::Accuracy(accuracy))
    };
    let mut at = solver.solve(&parameters, None, &reuse).unwrap();
    let mut only_predicted = 0;
    for call in 1..=120 {
        // Most changes move the body by less than the accuracy.
        let amplitude = 0.7 - 0.001 * f64::from(call);
        let changed = smooth(&mesh, &solver, amplitude);
        let start = at.positions.clone();
        solver
            .solve_into(&changed, Some(&start), &reuse, &mut at)
            .unwrap();
        assert_eq!(at.status, Status::Converged);
        assert!(at.stats.estimated_error.unwrap() <= accuracy);
        only_predicted += usize::from(at.stats.iterations == 1);
        if call % 20 == 0 {
            let (_, mut other, ..) = at_equilibrium();
            let tight = other.solve(&changed, None, &stop(1e-10)).unwrap();
            let away = max_distance(&at.positions, &tight.positions);
            assert!(away < 0.02 * accuracy, "{away} after {call} calls");
        }
    }
    assert!(only_predicted > 100, "{only_predicted}");
}

/// Solves repeated on one solver give the same bits, and so do any numbers of threads.
#[test]
fn the_same_bits_every_time_and_for_any_number_of_threads() {
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        pool.build().unwrap().install(|| {
            let mesh = body([16, 14, 15], |_| true);
            let wall = nodes_where(&mesh, |x| x.x == 0.0);
            let mut solver = Solver::new(&mesh, &[elasticity(), held(wall)]).unwrap();
            let parameters = smooth(&mesh, &solver, 1.0);
            let first = solver.solve(&parameters, None, &stop(1e-5)).unwrap();
            let weights = Numbers::new(5).vectors(mesh.nodes().len(), 1.0);
            let adjoint = solver
                .adjoint(&parameters, &first, &weights, &to(1e-6))
                .unwrap();
            let other = smooth(&mesh, &solver, -0.8);
            solver.solve(&other, None, &stop(1e-4)).unwrap();
            let again = solver.solve(&parameters, None, &stop(1e-5)).unwrap();
            assert_eq!(first.positions, again.positions);
            (first.positions, adjoint.multiplier)
        })
    };
    let one = run(1);
    assert_eq!(one, run(2));
    assert_eq!(one, run(3));
}

/// Far from anything smooth: independent random stretches in every sample, from mild to turning samples inside out.
#[test]
fn random_actuations_converge_or_say_so() {
    let mesh = body([10, 8, 9], |_| true);
    let wall = nodes_where(&mesh, |x| x.x == 0.0);
    let mut solver = Solver::new(&mesh, &[elasticity(), held(wall)]).unwrap();
    for (seed, strength) in [(1, 0.1), (2, 0.5), (3, 1.0), (4, 3.0)] {
        let mut parameters = solver.rest_parameters();
        parameters.actuation = Numbers::new(seed).actuation(parameters.actuation.len(), strength);
        let solution = solver.solve(&parameters, None, &stop(1e-6)).unwrap();
        assert!(
            solution
                .positions
                .iter()
                .all(|x| x.iter().all(|v| v.is_finite()))
        );
        if strength <= 1.0 {
            assert_eq!(solution.status, Status::Converged, "{strength}");
        }
        let rest = solver.rest().to_vec();
        let (at_rest, _) = solver.energy_gradient(&parameters, &rest).unwrap();
        assert!(solution.stats.energy <= at_rest);
    }
}
