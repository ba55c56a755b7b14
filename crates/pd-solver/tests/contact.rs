//! Contact: equilibria, derivatives, walks, and that nothing passes through anything.

mod common;
#[path = "common/skin.rs"]
mod skin;

use common::{difference, dot, elasticity, held, max_distance, nodes_where, tight};
use hex_mesh::{HexMesh, Quadrature};
use nalgebra::Vector3;
use pd_solver::{
    AdjointOptions, EffectSpec, Method, NodeSet, Obstacle, Parameters, Solution, SolveOptions,
    Solver, SolverError, SpringPoints, Status, Stop,
};
use skin::{block, crossings, lattice, skin, stamp};

const DISTANCE: f64 = 0.05;

fn contact(own: bool, obstacles: Vec<Obstacle>) -> EffectSpec {
    EffectSpec::Contact {
        region: None,
        distance: DISTANCE,
        stiffness: None,
        own,
        obstacles,
    }
}

fn floor(offset: f64) -> Obstacle {
    Obstacle::Plane {
        normal: [0.0, 0.0, 2.0],
        offset: 2.0 * offset,
    }
}

fn gravity(z: f64) -> EffectSpec {
    EffectSpec::Gravity {
        acceleration: [0.0, 0.0, z],
        density: 1.0,
    }
}

/// Springs that hold what else could slide away.
fn weakly_held(nodes: Vec<u32>) -> EffectSpec {
    EffectSpec::Springs {
        points: SpringPoints::Nodes(NodeSet::Indices(nodes)),
        stiffness: 1e-3,
    }
}

/// A cube of edge 1 at the origin.
fn cube(n: usize) -> HexMesh {
    HexMesh::solid_box([n, n, n], 1.0 / n as f64, Quadrature::Eight).unwrap()
}

fn solved(solver: &mut Solver, parameters: &Parameters, options: &SolveOptions) -> Solution {
    let solution = solver.solve(parameters, None, options).unwrap();
    println!(
        "{:?}: {} steps, {} products, {} searches, {} evaluations, {:.3} s",
        solution.status,
        solution.stats.iterations,
        solution.stats.work.hessian_products,
        solution.stats.work.contact_queries,
        solution.stats.work.evaluations,
        solution.stats.seconds
    );
    assert_eq!(solution.status, Status::Converged);
    solution
}

#[test]
fn a_cube_rests_on_a_plane_by_its_weight() {
    for n in [4, 8] {
        let mesh = cube(n);
        let surface = skin(&mesh);
        let all = nodes_where(&mesh, |_| true);
        let others = [elasticity(), gravity(-0.3), weakly_held(all)];
        let touching = contact(false, vec![floor(-0.5 * DISTANCE)]);
        let effects = [&others[..], &[touching]].concat();
        let mut solver = Solver::on_surface(&mesh, &surface, &effects).unwrap();
        let parameters = solver.rest_parameters();
        let solution = solved(&mut solver, &parameters, &tight());
        assert_eq!(solution.stats.method, Method::Newton);
        let report = &solver.contact_reports(&solution.positions).unwrap()[0];
        let nearest = report.nearest.unwrap();
        assert!(nearest > 0.0 && nearest < DISTANCE, "{report:?}");
        // What the others leave is what contact gives: it balances them, and they are weight and springs.
        let mut without = Solver::new(&mesh, &others).unwrap();
        let parameters = without.rest_parameters();
        let (_, gradient) = without
            .energy_gradient(&parameters, &solution.positions)
            .unwrap();
        let carried: Vector3<f64> = gradient.iter().sum();
        let moved: Vector3<f64> = solution
            .positions
            .iter()
            .zip(mesh.nodes())
            .map(|(u, x)| u - x)
            .sum();
        let weight = 0.3 + 1e-3 * moved.z;
        assert!(
            (carried.z / weight - 1.0).abs() < 1e-6,
            "{carried} {weight}"
        );
        let contact_only = solver
            .energy_gradient(&solver.rest_parameters(), &solution.positions)
            .unwrap()
            .1;
        let left: Vector3<f64> = contact_only.iter().sum();
        assert!(left.norm() < 1e-8, "{left}");
    }
}

/// A held block below and a block above it, a gap between.
fn two_blocks(n: i32, gap_cells: i32) -> HexMesh {
    let mut cells = block([0, 0, 0], [n, n, n]);
    cells.extend(block([0, 0, n + gap_cells], [n, n, 2 * n + gap_cells]));
    lattice(cells, 1.0 / f64::from(n))
}

#[test]
fn a_block_is_set_on_another_and_they_stay_apart() {
    let mesh = two_blocks(4, 1);
    let surface = skin(&mesh);
    let below = nodes_where(&mesh, |x| x.z == 0.0);
    let above = nodes_where(&mesh, |x| x.z > 2.2);
    let count = below.len();
    let effects = [
        elasticity(),
        held(below),
        held(above),
        contact(true, vec![]),
    ];
    let mut solver = Solver::on_surface(&mesh, &surface, &effects).unwrap();
    let mut parameters = solver.rest_parameters();
    // Half a block farther down than the gap is wide.
    for (k, x) in parameters.prescribed[count..].iter_mut().enumerate() {
        *x += Vector3::new(0.013, 0.021, -0.6 - 1e-4 * k as f64);
    }
    let options = SolveOptions::new(Stop::Accuracy(1e-4));
    let solution = solved(&mut solver, &parameters, &options);
    assert_eq!(crossings(&surface, &mesh, &solution.positions, None), 0);
    let again = solved(&mut solver, &parameters, &options);
    assert_eq!(solution.positions, again.positions, "the same bits");
    // Without contact they pass through each other.
    let mut without = Solver::on_surface(&mesh, &surface, &effects[..3]).unwrap();
    let through = without.solve(&parameters, None, &options).unwrap();
    assert!(crossings(&surface, &mesh, &through.positions, None) > 0);
}

/// A cube held at its base and a stamp above it.
fn stamped(n: usize) -> (HexMesh, Vec<EffectSpec>, Vec<[u32; 3]>) {
    let mesh = cube(n);
    let base = nodes_where(&mesh, |x| x.z == 0.0);
    let (vertices, triangles) = stamp([0.32, 0.27, 1.1], [0.71, 0.68, 1.3], 2);
    let obstacle = Obstacle::Surface {
        vertices,
        triangles: triangles.clone(),
    };
    let effects = vec![elasticity(), held(base), contact(true, vec![obstacle])];
    (mesh, effects, triangles)
}

#[test]
fn a_stamp_that_comes_by_more_than_its_size_is_walked_in() {
    let (mesh, effects, triangles) = stamped(5);
    let surface = skin(&mesh);
    let mut solver = Solver::on_surface(&mesh, &surface, &effects).unwrap();
    let mut parameters = solver.rest_parameters();
    for x in &mut parameters.obstacles {
        x.z -= 0.45;
    }
    let options = SolveOptions::new(Stop::Accuracy(1e-5));
    let solution = solved(&mut solver, &parameters, &options);
    let obstacle = Some((&parameters.obstacles[..], &triangles[..]));
    assert_eq!(crossings(&surface, &mesh, &solution.positions, obstacle), 0);
    let report = &solver.contact_reports(&solution.positions).unwrap()[0];
    assert!(report.felt > 20, "{report:?}");
    // And out again, from there.
    let out = solver.rest_parameters();
    let back = solver
        .solve(&out, Some(&solution.positions), &options)
        .unwrap();
    assert_eq!(back.status, Status::Converged);
    assert!(max_distance(&back.positions, mesh.nodes()) < 1e-4);
}

#[test]
fn derivatives_are_those_of_solves() {
    let (mesh, mut effects, _) = stamped(4);
    effects.push(gravity(-0.05));
    let surface = skin(&mesh);
    let mut solver = Solver::on_surface(&mesh, &surface, &effects).unwrap();
    let mut parameters = solver.rest_parameters();
    for x in &mut parameters.obstacles {
        x.z -= 0.17;
    }
    let options = SolveOptions::new(Stop::RelativeGradient(1e-11));
    let at = solved(&mut solver, &parameters, &options);
    let mut numbers = common::Numbers::new(4);
    let cotangent = numbers.vectors(mesh.nodes().len(), 1.0);
    let exact = AdjointOptions {
        tolerance: 1e-12,
        ..AdjointOptions::default()
    };
    let adjoint = solver
        .adjoint(&parameters, &at, &cotangent, &exact)
        .unwrap();
    println!("{:?} {:?}", adjoint.status, adjoint.stats);
    let gradient = adjoint.gradient.unwrap();
    let rest = solver.rest_parameters();
    let zero = || rest.moved(-1.0, &rest);
    let mut obstacles = zero();
    obstacles.obstacles = numbers.vectors(rest.obstacles.len(), 1.0);
    let mut acceleration = zero();
    acceleration.acceleration = vec![Vector3::new(1.0, -2.0, 3.0)];
    let mut actuation = zero();
    actuation.actuation = numbers.actuation(rest.actuation.len(), 1.0);
    for (name, direction, step) in [
        ("obstacles", obstacles, 1e-5),
        ("acceleration", acceleration, 1e-5),
        ("actuation", actuation, 1e-5),
    ] {
        let slope = difference(step, |t| {
            let moved = parameters.moved(t, &direction);
            let solution = solver.solve(&moved, Some(&at.positions), &options).unwrap();
            assert_eq!(solution.status, Status::Converged);
            dot(&solution.positions, &cotangent)
        });
        let exact = gradient.dot(&direction);
        let error = (slope - exact).abs() / exact.abs();
        assert!(error < 1e-5, "{name}: {slope} against {exact}: {error:e}");
    }
}

/// Two arms on a base, like a U, whose insides are stretched so that they close.
fn arms() -> (HexMesh, Vec<u32>) {
    let mut cells = block([0, 0, 0], [8, 2, 2]);
    cells.extend(block([0, 0, 2], [2, 2, 10]));
    cells.extend(block([6, 0, 2], [8, 2, 10]));
    let mesh = lattice(cells, 0.1);
    let base = nodes_where(&mesh, |x| x.z < 0.05);
    (mesh, base)
}

fn closing(mesh: &HexMesh, parameters: &mut Parameters, strength: f64) {
    for (b, x) in parameters.actuation.iter_mut().zip(mesh.sample_positions()) {
        if x.z > 0.2 {
            let from_middle = if x.x < 0.4 { 0.1 - x.x } else { x.x - 0.7 };
            b[5] = strength * from_middle;
        }
    }
}

#[test]
fn arms_that_close_touch_and_do_not_cross() {
    let (mesh, base) = arms();
    let surface = skin(&mesh);
    let effects = [elasticity(), held(base), contact(true, vec![])];
    let options = SolveOptions::new(Stop::Accuracy(1e-4));
    let mut solver = Solver::on_surface(&mesh, &surface, &effects).unwrap();
    let mut parameters = solver.rest_parameters();
    closing(&mesh, &mut parameters, 6.0);
    let solution = solved(&mut solver, &parameters, &options);
    assert_eq!(crossings(&surface, &mesh, &solution.positions, None), 0);
    assert!(solver.contact_reports(&solution.positions).unwrap()[0].felt > 0);
    let mut without = Solver::on_surface(&mesh, &surface, &effects[..2]).unwrap();
    let through = solved(&mut without, &parameters, &options);
    assert!(crossings(&surface, &mesh, &through.positions, None) > 0);
}

#[test]
fn rest_feels_nothing_of_itself_however_near() {
    // A slit that is much narrower than the barrier's distance.
    let (mesh, base) = arms();
    let surface = skin(&mesh);
    let wide = EffectSpec::Contact {
        region: None,
        distance: 0.6,
        stiffness: None,
        own: true,
        obstacles: vec![],
    };
    let mut solver =
        Solver::on_surface(&mesh, &surface, &[elasticity(), held(base), wide]).unwrap();
    let parameters = solver.rest_parameters();
    let (energy, gradient) = solver.energy_gradient(&parameters, mesh.nodes()).unwrap();
    assert!(energy < 1e-30, "{energy}");
    assert!(gradient.iter().all(|g| g.norm() < 1e-13));
    assert!(
        solver.contact_reports(mesh.nodes()).unwrap()[0]
            .left_out
            .is_empty()
    );
}

#[test]
fn starts_at_first_touch_and_deep_in_the_barrier_converge() {
    let mesh = cube(4);
    let surface = skin(&mesh);
    for gap in [DISTANCE, 1e-3 * DISTANCE] {
        let top = nodes_where(&mesh, |x| x.z == 1.0);
        let effects = [elasticity(), held(top), contact(false, vec![floor(-gap)])];
        let mut solver = Solver::on_surface(&mesh, &surface, &effects).unwrap();
        let parameters = solver.rest_parameters();
        let solution = solved(
            &mut solver,
            &parameters,
            &SolveOptions::new(Stop::Accuracy(1e-6)),
        );
        let lowest = solution.positions.iter().map(|x| x.z).fold(1.0, f64::min);
        assert!(lowest > -gap);
        match gap == DISTANCE {
            true => assert!(max_distance(&solution.positions, mesh.nodes()) < 1e-12),
            false => assert!(lowest > 0.5 * DISTANCE, "{lowest}"),
        }
    }
}

#[test]
fn what_passes_through_is_refused_with_its_place() {
    let (mesh, mut effects, _) = stamped(4);
    let surface = skin(&mesh);
    let mut solver = Solver::on_surface(&mesh, &surface, &effects).unwrap();
    let parameters = solver.rest_parameters();
    let mut start = mesh.nodes().to_vec();
    start
        .iter_mut()
        .filter(|x| x.z > 0.9)
        .for_each(|x| x.z += 0.2);
    let error = solver
        .solve(&parameters, Some(&start), &tight())
        .unwrap_err();
    let text = error.to_string();
    assert!(
        matches!(error, SolverError::Intersects { index: 2, .. }),
        "{text}"
    );
    assert!(text.contains("effect 2 (`contact`): triangle"), "{text}");
    assert!(
        text.contains("of obstacle 0, or touches it, near (0."),
        "{text}"
    );
    assert!(text.contains("begin at positions"), "{text}");
    effects[2] = contact(false, vec![floor(0.1)]);
    let Err(error) = Solver::on_surface(&mesh, &surface, &effects) else {
        panic!("a plane in the body");
    };
    assert!(
        error.to_string().contains("the plane that is obstacle 0"),
        "{error}"
    );
    effects[2] = contact(
        false,
        vec![Obstacle::Plane {
            normal: [0.0; 3],
            offset: 0.0,
        }],
    );
    let Err(error) = Solver::on_surface(&mesh, &surface, &effects) else {
        panic!("a plane without a direction");
    };
    assert!(error.to_string().contains("`normal` is 0"), "{error}");
}

#[test]
fn what_cannot_be_reached_stalls_without_passing_through() {
    let (mesh, effects, _) = stamped(4);
    let surface = skin(&mesh);
    let mut solver = Solver::on_surface(&mesh, &surface, &effects).unwrap();
    let mut parameters = solver.rest_parameters();
    // Through the base that is held.
    for x in &mut parameters.obstacles {
        x.z -= 1.4;
    }
    let options = SolveOptions {
        max_iterations: 300,
        ..SolveOptions::new(Stop::Accuracy(1e-4))
    };
    let solution = solver.solve(&parameters, None, &options).unwrap();
    println!(
        "{:?} after {} steps",
        solution.status, solution.stats.iterations
    );
    assert_eq!(solution.status, Status::Stalled);
    assert_eq!(crossings(&surface, &mesh, &solution.positions, None), 0);
}

#[test]
fn triangles_that_pass_through_each_other_at_rest_are_left_out() {
    let mesh = two_blocks(2, 1);
    let mut surface = skin(&mesh);
    // A flap from the lower block into the upper one.
    let flap = [[0.3, 0.3, 1.0], [0.35, 0.3, 1.7], [0.3, 0.36, 1.7]].map(Vector3::from);
    let first = surface.points.len() as u32;
    let embedded = hex_mesh::embed(&mesh, &flap).unwrap();
    surface.points.extend_from_slice(embedded.vertices());
    surface.triangles.push([first, first + 1, first + 2]);
    let ends = nodes_where(&mesh, |x| x.z == 0.0 || x.z > 2.4);
    let effects = [elasticity(), held(ends), contact(true, vec![])];
    let mut solver = Solver::on_surface(&mesh, &surface, &effects).unwrap();
    let report = &solver.contact_reports(mesh.nodes()).unwrap()[0];
    let flap = surface.triangles.len() as u32 - 1;
    assert!(report.left_out.contains(&flap), "{report:?}");
    assert!(report.left_out.len() < 6, "{report:?}");
    let parameters = solver.rest_parameters();
    assert_eq!(
        solver.energy_gradient(&parameters, mesh.nodes()).unwrap().0,
        0.0
    );
}

#[test]
fn the_bits_do_not_depend_on_the_number_of_threads() {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.unwrap().install(|| {
            let (mesh, effects, _) = stamped(6);
            let surface = skin(&mesh);
            let mut solver = Solver::on_surface(&mesh, &surface, &effects).unwrap();
            let mut parameters = solver.rest_parameters();
            for x in &mut parameters.obstacles {
                x.z -= 0.2;
            }
            let options = SolveOptions::new(Stop::Accuracy(1e-4));
            solved(&mut solver, &parameters, &options).positions
        })
    };
    assert_eq!(run(1), run(3));
}

/// Pressures between flat faces of several finenesses, in units of that above a plane.
#[test]
fn pressures_between_faces_are_as_documented() {
    let measured = |n: i32, gap: f64, shift: [f64; 2]| {
        let mesh = two_blocks(n, 1);
        let surface = skin(&mesh);
        let ends = nodes_where(&mesh, |x| x.z == 0.0 || x.z > 2.0 + 0.5 / f64::from(n));
        let effects = [elasticity(), held(ends), contact(true, vec![])];
        let mut solver = Solver::on_surface(&mesh, &surface, &effects).unwrap();
        let rest = mesh.nodes().iter();
        let down = gap - 1.0 / f64::from(n);
        let moved = rest.map(|x| match x.z > 1.0 + 0.5 / f64::from(n) {
            true => x + Vector3::new(shift[0], shift[1], down),
            false => *x,
        });
        let u: Vec<_> = moved.collect();
        let parameters = solver.rest_parameters();
        let (_, gradient) = solver.energy_gradient(&parameters, &u).unwrap();
        let below = mesh.nodes().iter().zip(&gradient);
        let force: f64 = below.filter(|(x, _)| x.z < 1.01).map(|(_, g)| g.z).sum();
        let t = gap / DISTANCE;
        force.abs() / ((1.0 - t) * (1.0 - t) / t - 2.0 * (1.0 - t) * t.ln())
    };
    for n in [2, 4, 8, 16] {
        let h = 1.0 / f64::from(n);
        // Coarser than the barrier's distance, and next to it.
        let most = if DISTANCE < 0.45 * h { 2.2 } else { 4.0 };
        for share in [0.2, 0.5, 0.8] {
            let aligned = measured(n, share * DISTANCE, [0.0, 0.0]);
            assert!((6.0..10.5).contains(&aligned), "{n}, {share}: {aligned}");
            for shift in [[0.13 * h, 0.29 * h], [0.5 * h, 0.4 * h]] {
                let ratio = measured(n, share * DISTANCE, shift);
                assert!((0.9..most).contains(&ratio), "{n}, {share}: {ratio}");
            }
        }
    }
}

/// Far from everything contact is not felt, however much a step sweeps over on its way: the boxes around the ways of all parts of a bar that swings
/// meet each other, but its parts do not.
#[test]
fn a_bar_that_swings_far_takes_the_steps_that_it_takes_without_contact() {
    let mesh = HexMesh::solid_box([48, 4, 4], 0.25, Quadrature::Eight).unwrap();
    let end = nodes_where(&mesh, |x| x.x < 1e-9);
    let others = [elasticity(), held(end), gravity(-4e-3)];
    let options = SolveOptions {
        method: Method::Newton,
        ..tight()
    };
    let mut free = Solver::new(&mesh, &others).unwrap();
    let parameters = free.rest_parameters();
    let free = solved(&mut free, &parameters, &options);
    let effects = [&others[..], &[contact(true, vec![])]].concat();
    let mut solver = Solver::on_surface(&mesh, &skin(&mesh), &effects).unwrap();
    let parameters = solver.rest_parameters();
    let solution = solved(&mut solver, &parameters, &options);
    let moved = max_distance(&solution.positions, mesh.nodes());
    assert!(moved > 4.0, "{moved}");
    assert!(max_distance(&solution.positions, &free.positions) < 1e-6);
    let steps = [&solution, &free].map(|s| s.stats.iterations);
    assert!(steps[0] <= steps[1] + 3, "{steps:?}");
    // One look at the start, one at most for every step.
    let looks = solution.stats.work.contact_queries as usize;
    assert!(looks <= solution.stats.iterations + 2, "{looks} looks");
}
