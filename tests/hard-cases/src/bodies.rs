//! Bodies that hardly hang together, or hang on nothing, or have a size that nothing has.

use crate::body::{Body, METHODS, elasticity, held, max_distance, name, nodes_where};
use crate::case::{Case, Entry, Finding, Section};
use crate::check::{checked_solve, gradient_holds};
use hex_mesh::{HexMesh, Quadrature};
use nalgebra::{Rotation3, Vector3};
use pd_solver::{
    AdjointOptions, AdjointStatus, EffectSpec, Method, NodeSet, Parameters, SolveOptions, Solver,
    SolverError, SpringPoints, Status, Stop,
};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// What the solver is asked for, and how near the answer must be, in edges of an element.
const ASKED: f64 = 1e-8;
const NEAR: f64 = 1e-6;

pub fn cases() -> Vec<Case> {
    let all: [Entry; 11] = [
        (
            "one element",
            "eight nodes, one of them held: the element takes the size it wants about it, and what turns it has no resistance",
            |_| hinged(vec![[0, 0, 0]], |x| x.norm() == 0.0),
        ),
        (
            "chain by edges",
            "elements that share one edge each, free to swing about it",
            |_| hinged((0..6).map(|i| [i, i, 0]).collect(), |x| x.x == 0.0),
        ),
        (
            "chain by nodes",
            "elements that share one node each, free to turn about it",
            |_| hinged((0..6).map(|i| [i, i, i]).collect(), |x| x.x == 0.0),
        ),
        (
            "sheet",
            "one element thick and thirty wide: bending costs next to nothing",
            |_| swings_back([30, 30, 1]),
        ),
        ("rod", "one element thick and eighty long", |_| {
            swings_back([80, 1, 1])
        }),
        (
            "one of two components unheld",
            "nothing holds the second component: refused, with the node and the mend",
            |_| unheld(),
        ),
        (
            "nothing held",
            "a box that may float, started turned and far away: every method ends at the same place, that of the convention, and gradients follow it",
            |_| floats(),
        ),
        (
            "all nodes held",
            "no unknowns: nothing to solve, and the gradient by the positions is the cotangent",
            |_| all_held(),
        ),
        (
            "a nanometre",
            "elements of 2^-30 m: the result is that of metres, times 2^-30, to the last bit",
            |_| sized(-30),
        ),
        (
            "a million kilometres",
            "elements of 2^30 m: the result is that of metres, times 2^30, to the last bit",
            |_| sized(30),
        ),
        (
            "contrast of a million",
            "half of the nodes on springs a million times stiffer than the material",
            |_| contrast(),
        ),
    ];
    all.into_iter()
        .map(|(name, story, run)| Case::new(Section::Bodies, format!("body {name}"), story, run))
        .collect()
}

fn options(body: &Body, method: Method) -> SolveOptions {
    SolveOptions {
        max_iterations: 20_000,
        ..SolveOptions::new(Stop::Accuracy(ASKED * body.mesh.element_size())).with_method(method)
    }
}

/// Elements that turn freely about what they share. All want to be larger: whatever the turns, the energy can be zero, and must be.
fn hinged(cells: Vec<[i32; 3]>, keep: fn(&Vector3<f64>) -> bool) -> Finding {
    let mesh = HexMesh::from_cells(cells, Vector3::zeros(), 0.25, Quadrature::Eight)
        .expect("a valid mesh");
    let one_node = vec![nodes_where(&mesh, keep)[0]];
    let mut body = Body::new(mesh, &[elasticity(), held(one_node)]);
    let parameters = body.actuated(|_, _| [0.3, 0.0, 0.0, 0.3, 0.0, 0.3]);
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let mut start = body.mesh.nodes().to_vec();
    for x in &mut start {
        *x += Vector3::from_fn(|_, _| rng.random_range(-0.05..0.05));
    }
    let mut finding = Finding::default();
    for method in METHODS {
        let options = options(&body, method);
        let (solution, part) = checked_solve(&mut body, &parameters, Some(&start), &options);
        finding.merge(part);
        let volume = body.mesh.volume();
        finding.require(solution.stats.energy < 1e-12 * volume, || {
            format!("{}: energy {:.1e}", name(method), solution.stats.energy)
        });
        // Newton steps along free turns are noise, so that at energy zero no step is left: that is no lie.
        finding.require(solution.status != Status::IterationLimit, || {
            format!("{}: {:?}", name(method), solution.status)
        });
        // Where it may turn, a push that turns it has no answer.
        let push: Vec<_> = (body.mesh.nodes().iter().enumerate())
            .map(|(i, _)| Vector3::new((i as f64).sin(), (1.7 * i as f64).cos(), 0.3))
            .collect();
        let adjoint = body
            .solver
            .adjoint(&parameters, &solution, &push, &AdjointOptions::default())
            .expect("a state of this body");
        finding.negative_curvature |= adjoint.stats.negative_curvature;
        finding.require(!adjoint.status.is_reliable(), || {
            format!(
                "{}: a gradient by free turns is called {:?}",
                name(method),
                adjoint.status
            )
        });
    }
    finding
}

/// A thin body bent far over swings back.
fn swings_back(cells: [usize; 3]) -> Finding {
    let mut body = Body::bar(cells, 0.25);
    let parameters = body.solver.rest_parameters();
    let [low, high] = body.bounds();
    let long = high.x - low.x;
    // Half a turn about y, along a circle.
    let start: Vec<_> = (body.mesh.nodes().iter())
        .map(|x| {
            let angle = std::f64::consts::PI * x.x / long;
            let radius = long / std::f64::consts::PI - x.z;
            Vector3::new(
                radius * angle.sin(),
                x.y,
                long / std::f64::consts::PI - radius * angle.cos(),
            )
        })
        .collect();
    let mut finding = Finding::default();
    for method in [Method::Lbfgs, Method::Multigrid, Method::Newton] {
        let options = options(&body, method);
        let (solution, part) = checked_solve(&mut body, &parameters, Some(&start), &options);
        finding.merge(part);
        let off = max_distance(&solution.positions, body.mesh.nodes()) / body.mesh.element_size();
        let back = off <= NEAR;
        finding.recovered.push((method, usize::from(back), 1));
        finding.require(back, || {
            format!(
                "{}: {:?}, {off:.1e} edges off",
                name(method),
                solution.status
            )
        });
    }
    let options = options(&body, Method::Automatic);
    let (solution, _) = checked_solve(&mut body, &parameters, None, &options);
    finding.merge(gradient_holds(
        &mut body,
        &parameters,
        &solution,
        Method::Automatic,
    ));
    finding
}

/// A box that nothing holds, from a start that is turned and far away.
fn floats() -> Finding {
    let mesh = HexMesh::solid_box([9, 5, 4], 0.25, Quadrature::Eight).expect("a valid box");
    let mut body = Body::new(mesh, &[elasticity(), EffectSpec::Floating {}]);
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    let parameters = body.actuated(|_, _| std::array::from_fn(|_| rng.random_range(-0.2..0.2)));
    let turn = Rotation3::new(Vector3::new(1.0, -2.0, 0.5));
    let far = body
        .mesh
        .nodes()
        .iter()
        .map(|x| turn * x + Vector3::new(5.0, 4.0, -3.0));
    let far: Vec<_> = far.collect();
    let options = options(&body, Method::Automatic);
    let (here, mut finding) = checked_solve(&mut body, &parameters, None, &options);
    for method in METHODS {
        let options = self::options(&body, method);
        let (solution, part) = checked_solve(&mut body, &parameters, Some(&far), &options);
        finding.merge(part);
        let off = max_distance(&solution.positions, &here.positions) / body.mesh.element_size();
        finding.require(off <= NEAR, || {
            format!("{}: {off:.1e} edges elsewhere", name(method))
        });
    }
    finding.merge(gradient_holds(
        &mut body,
        &parameters,
        &here,
        Method::Automatic,
    ));
    finding
}

fn unheld() -> Finding {
    let cells = vec![[0, 0, 0], [1, 0, 0], [5, 0, 0], [6, 0, 0]];
    let mesh = HexMesh::from_cells(cells, Vector3::zeros(), 0.25, Quadrature::Eight)
        .expect("a valid mesh");
    let wall = nodes_where(&mesh, |x| x.x == 0.0);
    let mut finding = Finding {
        status: "refused".into(),
        ..Finding::default()
    };
    match Solver::new(&mesh, &[elasticity(), held(wall)]) {
        Err(error @ SolverError::NotHeld { count: 12, .. }) => {
            finding.notes.push(format!("\"{error}\""));
        }
        Err(error) => finding
            .broken
            .push(format!("refused for another reason: {error}")),
        Ok(_) => finding.broken.push("not refused".into()),
    }
    finding
}

fn all_held() -> Finding {
    let mesh = HexMesh::solid_box([4, 3, 3], 0.25, Quadrature::Eight).expect("a valid box");
    let all = nodes_where(&mesh, |_| true);
    let mut body = Body::new(mesh, &[elasticity(), held(all)]);
    let parameters = body.actuated(|_, _| [0.5, 0.1, 0.0, 0.2, 0.0, -0.3]);
    let mut finding = Finding::default();
    for method in METHODS {
        let options = options(&body, method);
        let (solution, part) = checked_solve(&mut body, &parameters, None, &options);
        finding.merge(part);
        finding.require(solution.positions == parameters.prescribed, || {
            format!("{}: held nodes moved", name(method))
        });
        finding.require(solution.status == Status::Converged, || {
            format!("{}: {:?}", name(method), solution.status)
        });
        let cotangent: Vec<_> = (0..solution.positions.len())
            .map(|i| Vector3::new(i as f64, 1.0, -1.0))
            .collect();
        let adjoint = body
            .solver
            .adjoint(
                &parameters,
                &solution,
                &cotangent,
                &AdjointOptions::default(),
            )
            .expect("a state of this body");
        finding.require(adjoint.status == AdjointStatus::Converged, || {
            format!("{}: adjoint {:?}", name(method), adjoint.status)
        });
        let same = adjoint.gradient.is_some_and(|g| {
            g.prescribed == cotangent && g.actuation.iter().flatten().all(|&b| b == 0.0)
        });
        finding.require(same, || {
            format!("{}: another gradient than the cotangent", name(method))
        });
    }
    finding
}

/// One bar in metres, and one 2^power times as large: every length and every force scales.
fn sized(power: i32) -> Finding {
    let scale = 2f64.powi(power);
    let solve = |scale: f64, method: Method| {
        let mut body = Body::bar([9, 4, 4], 0.25 * scale);
        let mut rng = ChaCha8Rng::seed_from_u64(9);
        let parameters = body.actuated(|_, _| std::array::from_fn(|_| rng.random_range(-0.3..0.3)));
        let options = options(&body, method);
        let (solution, finding) = checked_solve(&mut body, &parameters, None, &options);
        let cotangent = vec![Vector3::new(1.0, -0.5, 0.25); solution.positions.len()];
        let adjoint = body
            .solver
            .adjoint(
                &parameters,
                &solution,
                &cotangent,
                &AdjointOptions::default(),
            )
            .expect("a state of this body");
        (solution, adjoint, finding)
    };
    let mut finding = Finding::default();
    for method in METHODS {
        let (metres, of_metres, _) = solve(1.0, method);
        let (solution, adjoint, part) = solve(scale, method);
        finding.merge(part);
        let same = |a: &Vector3<f64>, b: &Vector3<f64>| *b == a * scale;
        let pairs = metres.positions.iter().zip(&solution.positions);
        let differing = pairs.filter(|(a, b)| !same(a, b)).count();
        finding.require(differing == 0, || {
            format!(
                "{}: {differing} nodes are not those of metres",
                name(method)
            )
        });
        finding.require(metres.status == solution.status, || {
            format!(
                "{}: {:?}, in metres {:?}",
                name(method),
                solution.status,
                metres.status
            )
        });
        let gradients = [of_metres.gradient, adjoint.gradient].map(|g| g.map(|g| g.actuation));
        let [Some(one), Some(other)] = gradients else {
            finding
                .broken
                .push(format!("{}: no gradient", name(method)));
            continue;
        };
        let pairs = one.iter().flatten().zip(other.iter().flatten());
        let differing = pairs.filter(|(a, b)| **b != **a * scale).count();
        finding.require(differing == 0, || {
            format!(
                "{}: {differing} entries of the gradient are not those of metres",
                name(method)
            )
        });
    }
    finding
}

/// Stiff springs pull one half of a bar sideways; the other half is soft.
fn contrast() -> Finding {
    let mesh = HexMesh::solid_box([12, 4, 4], 0.25, Quadrature::Eight).expect("a valid box");
    let wall = nodes_where(&mesh, |x| x.x == 0.0);
    let pulled = nodes_where(&mesh, |x| x.x > 1.5);
    let springs = EffectSpec::Springs {
        points: SpringPoints::Nodes(NodeSet::Indices(pulled.clone())),
        stiffness: 1e6 * 0.25,
    };
    let mut body = Body::new(mesh, &[elasticity(), held(wall), springs]);
    let mut parameters: Parameters = body.solver.rest_parameters();
    for target in &mut parameters.spring_targets {
        target.y += 0.4;
    }
    let mut finding = Finding::default();
    let mut energies = Vec::new();
    for method in METHODS {
        let options = options(&body, method);
        let (solution, part) = checked_solve(&mut body, &parameters, None, &options);
        finding.merge(part);
        energies.push(solution.stats.energy);
        let farthest = pulled.iter().zip(&parameters.spring_targets);
        let farthest = farthest.fold(0.0, |m: f64, (&n, t)| {
            m.max((solution.positions[n as usize] - t).norm())
        });
        finding.require(farthest < 1e-4, || {
            format!(
                "{}: a spring a million times stiffer gives by {farthest:.1e}",
                name(method)
            )
        });
        if solution.status == Status::Converged {
            finding.merge(gradient_holds(&mut body, &parameters, &solution, method));
        }
    }
    let least = energies.iter().copied().fold(f64::INFINITY, f64::min);
    let most = energies.iter().copied().fold(0.0, f64::max);
    finding.require(most - least < 1e-6 * most, || {
        format!("energies from {least:.9} to {most:.9}")
    });
    finding
}
