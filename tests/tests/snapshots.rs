//! Energies of known shapes and the work of known solves, as snapshots: a change of either must be meant.
//!
//! Energies are rounded to what is guaranteed. Work is counted, not timed, and only where roundoff cannot change it: all counts must
//! come out the same for other tolerances and starts nearby, so they do on another processor too.

use hex_mesh::{Axis, HexMesh, NodeRegion, Quadrature};
use insta::assert_snapshot;
use nalgebra::{Matrix3, Vector3};
use pd_solver::{
    AdjointOptions, AdjointStatus, EffectSpec, Method, NodeSet, Parameters, Solution, SolveOptions,
    Solver, SpringPoints, Status, Stop, Work, deformation_gradients,
};
use std::fmt::Write;
use std::path::Path;
use trainer::body::Body;
use trainer::scene::Scene;
use trainer::shapes::load_shapes;

/// A block of 2 x 1 x 1.
fn block(quadrature: Quadrature) -> HexMesh {
    HexMesh::solid_box([8, 4, 4], 0.25, quadrature).expect("a valid box")
}

fn elasticity() -> EffectSpec {
    EffectSpec::Elasticity { stiffness: 1.0 }
}

fn plane(value: f64) -> NodeSet {
    let axis = Axis::X;
    NodeSet::Region(NodeRegion::Plane { axis, value })
}

fn wall() -> EffectSpec {
    EffectSpec::Prescribed { nodes: plane(0.0) }
}

fn gravity() -> EffectSpec {
    EffectSpec::Gravity {
        acceleration: [0.0, 0.0, -1.0],
        density: 1e-3,
    }
}

fn springs() -> EffectSpec {
    EffectSpec::Springs {
        points: SpringPoints::Nodes(plane(2.0)),
        stiffness: 1e-3,
    }
}

/// Energy of the block when every node goes where `map` says, under the same `b` everywhere.
fn energy(quadrature: Quadrature, b: [f64; 6], map: impl Fn(&Vector3<f64>) -> Vector3<f64>) -> f64 {
    let mesh = block(quadrature);
    let mut solver = Solver::new(&mesh, &[elasticity(), wall()]).expect("a valid problem");
    let mut parameters = solver.rest_parameters();
    parameters.actuation.fill(b);
    let u: Vec<_> = mesh.nodes().iter().map(map).collect();
    solver.energy_gradient(&parameters, &u).expect("fits").0
}

fn linear(f: [f64; 9]) -> impl Fn(&Vector3<f64>) -> Vector3<f64> {
    let f = Matrix3::from_row_slice(&f);
    move |x| f * x
}

fn turned(x: &Vector3<f64>, angle: f64) -> Vector3<f64> {
    let (sin, cos) = angle.sin_cos();
    let (y, z) = (x.y - 0.5, x.z - 0.5);
    Vector3::new(x.x, cos * y - sin * z + 0.5, sin * y + cos * z + 0.5)
}

/// Every number has an independent answer beside it, or is a sum over samples of the formula itself.
#[test]
fn energies_of_given_shapes() {
    let passive = [0.0; 6];
    let longer = [0.2, 0.0, 0.0, 0.0, 0.0, 0.0];
    let sheared = [0.0, 0.1, 0.0, 0.0, 0.0, 0.0];
    let stretch = linear([1.2, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    let shear = linear([1.0, 0.3, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    let squeezed = linear([0.5, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.5]);
    let mirrored = linear([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0]);
    let flat = linear([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0]);
    let twist = |x: &Vector3<f64>| turned(x, 0.6 * x.x);
    let pushed_through = |x: &Vector3<f64>| {
        let corner = Vector3::new(2.0, 1.0, 1.0);
        if *x == corner {
            x - Vector3::repeat(0.4)
        } else {
            *x
        }
    };
    let eight = Quadrature::Eight;
    let mut text = String::new();
    let mut row =
        |name: &str, value: f64| writeln!(text, "{name:<36}{value:.9}").expect("a string");
    row("rest", energy(eight, passive, |x| *x));
    row(
        "turned by 1 radian",
        energy(eight, passive, |x| turned(x, 1.0)),
    );
    row("stretched by 1.2", energy(eight, passive, &stretch));
    row("sheared by 0.3", energy(eight, passive, &shear));
    row("squeezed to half", energy(eight, passive, &squeezed));
    row("pressed flat", energy(eight, passive, &flat));
    row("mirrored", energy(eight, passive, &mirrored));
    row(
        "one corner pushed through",
        energy(eight, passive, pushed_through),
    );
    row("twisted, 1 sample", energy(Quadrature::One, passive, twist));
    row("twisted, 8 samples", energy(eight, passive, twist));
    row(
        "twisted, 27 samples",
        energy(Quadrature::TwentySeven, passive, twist),
    );
    row("rest, actuated to 1.2", energy(eight, longer, |x| *x));
    row(
        "stretched and actuated to 1.2",
        energy(eight, longer, &stretch),
    );
    row("rest, actuated to shear", energy(eight, sheared, |x| *x));
    row(
        "mirrored, actuated to 1.2",
        energy(eight, longer, &mirrored),
    );
    assert_snapshot!(text, @r"
    rest                                0.000000000
    turned by 1 radian                  0.000000000
    stretched by 1.2                    0.040000000
    sheared by 0.3                      0.045250317
    squeezed to half                    0.750000000
    pressed flat                        1.000000000
    mirrored                            4.000000000
    one corner pushed through           0.012114723
    twisted, 1 sample                   0.035663778
    twisted, 8 samples                  0.030078008
    twisted, 27 samples                 0.030079571
    rest, actuated to 1.2               0.040000000
    stretched and actuated to 1.2       0.000000000
    rest, actuated to shear             0.020000000
    mirrored, actuated to 1.2           4.040000000
    ");
}

/// Factors on the tolerance and displacements of the start, as a share of an element, that must not change any count.
const VARIATIONS: [(f64, f64); 3] = [(1.0, 0.0), (0.995, 1e-11), (1.005, -1e-11)];

/// What was counted between two moments.
fn counts(before: &Work, after: &Work) -> String {
    format!(
        "{} evaluations, {} constant solves, {} linearisations, {} Hessian products",
        after.evaluations - before.evaluations,
        after.constant_solves - before.constant_solves,
        after.linearisations - before.linearisations,
        after.hessian_products - before.hessian_products,
    )
}

/// Reproducible vectors of about unit length.
fn waves(count: usize) -> impl Iterator<Item = Vector3<f64>> {
    (0..count).map(|i| Vector3::new(1.0, (0.7 * i as f64).sin(), (1.3 * i as f64).cos()))
}

/// What it takes to solve from rest, the same for all [`VARIATIONS`].
fn forward_work(solver: &mut Solver, parameters: &Parameters, method: Method, t: f64) -> String {
    let size = 0.1;
    let [text, tighter, looser] = VARIATIONS.map(|(factor, displacement)| {
        let before = solver.work();
        let noise = waves(solver.rest().len());
        let start = solver
            .rest()
            .iter()
            .zip(noise)
            .map(|(x, n)| x + n * (displacement * size));
        let start: Vec<_> = start.collect();
        let options = SolveOptions::new(Stop::RelativeGradient(t * factor)).with_method(method);
        let solution = solver
            .solve(parameters, Some(&start), &options)
            .expect("fits");
        assert_eq!(solution.status, Status::Converged);
        assert!(!solution.stats.fell_back);
        let counts = counts(&before, &solution.stats.work);
        format!("{} iterations, {counts}", solution.stats.iterations)
    });
    assert_eq!(tighter, text, "{t:e} is too near a step");
    assert_eq!(looser, text, "{t:e} is too near a step");
    text
}

/// What the adjoint of a reproducible cotangent takes, the same for all [`VARIATIONS`].
fn adjoint_work(solver: &mut Solver, parameters: &Parameters, at: &Solution, t: f64) -> String {
    let cotangent: Vec<_> = waves(at.positions.len()).collect();
    let [text, tighter, looser] = VARIATIONS.map(|(factor, _)| {
        let before = solver.work();
        let options = AdjointOptions {
            tolerance: t * factor,
            ..AdjointOptions::default()
        };
        let adjoint = solver
            .adjoint(parameters, at, &cotangent, &options)
            .expect("fits");
        assert_eq!(adjoint.status, AdjointStatus::Converged);
        let counts = counts(&before, &solver.work());
        format!("{} iterations, {counts}", adjoint.stats.iterations)
    });
    assert_eq!(tighter, text, "{t:e} is too near a step");
    assert_eq!(looser, text, "{t:e} is too near a step");
    text
}

/// The equilibrium from rest, sharp enough for all digits of the energy that are shown.
fn equilibrium(solver: &mut Solver, parameters: &Parameters) -> Solution {
    let sharp = SolveOptions::new(Stop::RelativeGradient(1e-8));
    let solution = solver.solve(parameters, None, &sharp).expect("fits");
    assert_eq!(solution.status, Status::Converged);
    solution
}

/// Fibres along x, longer at the bottom and shorter at the top.
fn bending(mesh: &HexMesh, mut parameters: Parameters) -> Parameters {
    for (b, x) in parameters.actuation.iter_mut().zip(mesh.sample_positions()) {
        b[0] = 0.3 * (1.0 - 2.0 * x.z);
        b[4] = 0.1 * x.x;
    }
    parameters
}

/// The block bends: its energy, and the work of every method and of the adjoint.
#[test]
fn an_actuated_block() {
    let mesh = block(Quadrature::Eight);
    let mut solver = Solver::new(&mesh, &[elasticity(), wall()]).expect("a valid problem");
    let parameters = bending(&mesh, solver.rest_parameters());
    let at = equilibrium(&mut solver, &parameters);
    let mut text = format!("energy {:.9}\n", at.stats.energy);
    for (method, t) in [
        (Method::LocalGlobal, 1e-3),
        (Method::Lbfgs, 1e-4),
        (Method::Newton, 1e-6),
    ] {
        let work = forward_work(&mut solver, &parameters, method, t);
        writeln!(text, "{method:?} to {t:.0e}: {work}").expect("a string");
    }
    let work = adjoint_work(&mut solver, &parameters, &at, 1e-6);
    writeln!(text, "adjoint to 1e-6: {work}").expect("a string");
    assert_snapshot!(text, @r"
    energy 0.001014369
    LocalGlobal to 1e-3: 197 iterations, 199 evaluations, 208 constant solves, 1 linearisations, 11 Hessian products
    Lbfgs to 1e-4: 38 iterations, 40 evaluations, 49 constant solves, 1 linearisations, 11 Hessian products
    Newton to 1e-6: 8 iterations, 11 evaluations, 48 constant solves, 8 linearisations, 48 Hessian products
    adjoint to 1e-6: 31 iterations, 1 evaluations, 31 constant solves, 1 linearisations, 31 Hessian products
    ");
}

/// Shorter lists of effects do less: absent effects show in no count.
#[test]
fn effects_that_are_not_listed_cost_nothing() {
    let mesh = block(Quadrature::Eight);
    let mut text = String::new();
    let mut alone = None;
    for (name, extra) in [
        ("elasticity", vec![]),
        ("and gravity", vec![gravity()]),
        ("and springs", vec![springs()]),
        ("and both", vec![gravity(), springs()]),
    ] {
        let mut effects = vec![elasticity(), wall()];
        effects.extend(extra);
        let mut solver = Solver::new(&mesh, &effects).expect("a valid problem");
        let rest = solver.rest_parameters();
        let ten_steps = SolveOptions {
            max_iterations: 10,
            ..SolveOptions::new(Stop::RelativeGradient(1e-12)).with_method(Method::LocalGlobal)
        };
        let set_up = solver.work();
        let least = *alone.get_or_insert(set_up.effect_bytes);
        let parameters = bending(&mesh, rest.clone());
        let solution = solver.solve(&parameters, None, &ten_steps).expect("fits");
        assert_eq!(solution.status, Status::IterationLimit);
        let work = solution.stats.work;
        writeln!(
            text,
            "{name}: {} factorisation, {} non-zeros, {} factor entries, {} more bytes, {} targets, {} accelerations, \
             {} evaluations, {} projections, {} constant solves",
            work.factorisations,
            work.matrix_nonzeros,
            work.factor_entries,
            set_up.effect_bytes - least,
            rest.spring_targets.len(),
            rest.acceleration.len(),
            work.evaluations - set_up.evaluations,
            work.local_projections - set_up.local_projections,
            work.constant_solves - set_up.constant_solves,
        )
        .expect("a string");
    }
    assert_snapshot!(text, @r"
    elasticity: 1 factorisation, 1959 non-zeros, 9293 factor entries, 0 more bytes, 0 targets, 0 accelerations, 12 evaluations, 12288 projections, 10 constant solves
    and gravity: 1 factorisation, 1959 non-zeros, 9293 factor entries, 1800 more bytes, 0 targets, 1 accelerations, 12 evaluations, 12288 projections, 10 constant solves
    and springs: 1 factorisation, 1959 non-zeros, 9293 factor entries, 2300 more bytes, 25 targets, 0 accelerations, 12 evaluations, 12288 projections, 10 constant solves
    and both: 1 factorisation, 1959 non-zeros, 9293 factor entries, 4100 more bytes, 25 targets, 1 accelerations, 12 evaluations, 12288 projections, 10 constant solves
    ");
}

/// A coarse starfish with one pose of each kind.
const STARFISH: &str = r#"
name = "starfish"
[surface.starfish]
radius = 1.0
[mesh]
element_size = 0.09
[[effects]]
type = "elasticity"
[[effects]]
type = "prescribed"
nodes = { type = "sphere", center = [0, 0, 0], radius = 0.2 }
[network]
width = 64
[[pose]]
name = "curl"
arms = [{ curl = 50 }]
[[pose]]
name = "twist"
arms = [{}, { twist = 60 }]
[[pose]]
name = "bloom"
arms = [{ lift = 25 }, { lift = 25 }, { lift = 25 }, { lift = 25 }, { lift = 25 }]
"#;

/// Springs pull the passive starfish onto every pose; then the stretch that appeared, as actuation, holds it there by itself.
#[test]
fn shapes_of_the_starfish() {
    let scene = Scene::parse(STARFISH, Path::new("starfish.toml")).expect("a valid scene");
    let inputs = load_shapes(&scene, Path::new(""))
        .expect("a generated surface")
        .shapes;
    let size = scene.mesh.element_size;
    let body = Body::new("starfish", inputs.surface.clone(), size, 8).expect("closed");
    let mut pulled_effects = scene.effects.clone();
    pulled_effects.push(EffectSpec::Springs {
        points: SpringPoints::Embedded {
            points: body.embedding.vertices().to_vec(),
            factors: body.surface.vertex_areas(),
        },
        stiffness: 20.0 / size,
    });
    let mut puller = Solver::new(&body.mesh, &pulled_effects).expect("a valid problem");
    let mut solver = Solver::new(&body.mesh, &scene.effects).expect("a valid problem");
    let mut text = format!(
        "{} elements, {} nodes, {} of them prescribed, elements of all levels {:?}\n",
        body.mesh.elements().len(),
        body.mesh.nodes().len(),
        solver.prescribed().len(),
        solver.levels(),
    );
    for (i, target) in inputs.targets.iter().enumerate() {
        let name = &target.name;
        let mut springs = puller.rest_parameters();
        springs.spring_targets = inputs.shape(i);
        let pulled = equilibrium(&mut puller, &springs);
        let work = forward_work(&mut puller, &springs, Method::Lbfgs, 1e-5);
        let energy = pulled.stats.energy;
        writeln!(text, "{name}, pulled: energy {energy:.5e}; {work}").expect("a string");

        let mut stretched = solver.rest_parameters();
        let passive = solver.energy_gradient(&stretched, &pulled.positions);
        let energy = passive.expect("fits").0;
        let gradients = deformation_gradients(&body.mesh, &pulled.positions);
        for (b, f) in stretched.actuation.iter_mut().zip(&gradients) {
            let stretch = polar_grad::polar(f).stretch;
            *b = polar_grad::symmetric_entries(&(stretch - Matrix3::identity()));
        }
        let at = equilibrium(&mut solver, &stretched);
        let work = forward_work(&mut solver, &stretched, Method::Lbfgs, 7e-4);
        writeln!(
            text,
            "{name}, actuated: passive energy {energy:.5e}; {work}"
        )
        .expect("a string");
        let work = adjoint_work(&mut solver, &stretched, &at, 1e-4);
        writeln!(text, "{name}, adjoint: {work}").expect("a string");
        // The pulled shape has no energy left under its own stretch, so it is where the body goes.
        let pairs = at.positions.iter().zip(&pulled.positions);
        let off = pairs.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        assert!(
            at.stats.energy < 1e-12 && off < 1e-4 * size,
            "{name}: {off}"
        );
    }
    assert_snapshot!(text, @r"
    198 elements, 456 nodes, 49 of them prescribed, elements of all levels [198]
    curl, pulled: energy 1.10928e-4; 5 iterations, 7 evaluations, 5 constant solves, 0 linearisations, 0 Hessian products
    curl, actuated: passive energy 3.93612e-5; 52 iterations, 54 evaluations, 79 constant solves, 1 linearisations, 27 Hessian products
    curl, adjoint: 53 iterations, 1 evaluations, 53 constant solves, 1 linearisations, 53 Hessian products
    twist, pulled: energy 1.00613e-4; 6 iterations, 8 evaluations, 6 constant solves, 0 linearisations, 0 Hessian products
    twist, actuated: passive energy 6.51551e-5; 59 iterations, 61 evaluations, 86 constant solves, 1 linearisations, 27 Hessian products
    twist, adjoint: 54 iterations, 1 evaluations, 54 constant solves, 1 linearisations, 54 Hessian products
    bloom, pulled: energy 1.69683e-4; 5 iterations, 7 evaluations, 5 constant solves, 0 linearisations, 0 Hessian products
    bloom, actuated: passive energy 1.32026e-4; 58 iterations, 60 evaluations, 85 constant solves, 1 linearisations, 27 Hessian products
    bloom, adjoint: 53 iterations, 1 evaluations, 53 constant solves, 1 linearisations, 53 Hessian products
    ");
}
