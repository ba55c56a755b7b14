//! Effects against textbooks, and what they refuse.

mod common;

use common::{boundary, elasticity, held, nodes_where, tight};
use hex_mesh::{EmbeddedPoint, HexMesh, NodeRegion, Quadrature, embed};
use nalgebra::Vector3;
use pd_solver::{
    EffectSpec, ElementSet, EmbeddedSurface, Method, Motion, SolveOptions, Solver, SolverError,
    Status, Stop, TimeScheme,
};

fn above(x: f64) -> NodeRegion {
    NodeRegion::HalfSpace {
        normal: [1.0, 0.0, 0.0],
        offset: x,
    }
}

fn bar(cells: [usize; 3], size: f64, extra: Vec<EffectSpec>) -> (HexMesh, Solver) {
    let mesh = HexMesh::solid_box(cells, size, Quadrature::Eight).unwrap();
    let wall = nodes_where(&mesh, |x| x.x == 0.0);
    let mut effects = vec![elasticity(), held(wall)];
    effects.extend(extra);
    let solver = Solver::on_surface(&mesh, &boundary(&mesh), &effects).unwrap();
    (mesh, solver)
}

fn solved(solver: &mut Solver) -> Vec<Vector3<f64>> {
    let parameters = solver.rest_parameters();
    let solution = solver.solve(&parameters, None, &tight()).unwrap();
    assert_eq!(solution.status, Status::Converged);
    solution.positions
}

fn mean_x(mesh: &HexMesh, u: &[Vector3<f64>], at: f64) -> f64 {
    let nodes = nodes_where(mesh, |x| (x.x - at).abs() < 1e-9);
    nodes.iter().map(|&n| u[n as usize].x).sum::<f64>() / nodes.len() as f64
}

/// A bar without lateral contraction (nu = 0) stretches by F L / (E A), with E the stiffness; the soft half of a bar of two materials by as much
/// more as it is softer, up to a contrast of 1e4.
#[test]
fn a_bar_of_two_materials_stretches_like_springs_in_series() {
    for factor in [1.0, 1e2, 1e4, 1e-4] {
        let force = 1e-3 * f64::min(factor, 1.0);
        let extra = vec![
            EffectSpec::Stiffness {
                elements: ElementSet::Region(above(1.0)),
                factor,
            },
            EffectSpec::Force {
                region: Some(above(2.0)),
                force: [force, 0.0, 0.0],
            },
        ];
        let (mesh, mut solver) = bar([16, 4, 4], 0.125, extra);
        let u = solved(&mut solver);
        let area = 0.25;
        let near = mean_x(&mesh, &u, 1.0) - 1.0;
        let far = mean_x(&mesh, &u, 2.0) - 2.0 - near;
        // The force is shared by the triangles of the end, which is not quite even.
        assert!((near / (force / area) - 1.0).abs() < 1e-3, "{near}");
        assert!((far / (force / area / factor) - 1.0).abs() < 1e-3, "{far}");
    }
}

/// The force of a wind is its pressure times the area across it; facing away there is none.
#[test]
fn wind_presses_on_what_faces_it() {
    let at = |pressure: f64, region| {
        let wind = EffectSpec::Wind {
            region,
            pressure: [pressure, 0.0, 0.0],
        };
        let (mesh, mut solver) = bar([8, 4, 4], 0.25, vec![wind]);
        mean_x(&mesh, &solved(&mut solver), 2.0) - 2.0
    };
    // On the end face alone: a pressure makes a strain of its own size.
    let pressed = at(-1e-3, Some(above(2.0)));
    assert!((pressed / -2e-3 - 1.0).abs() < 2e-3, "{pressed}");
    assert!(at(1e-3, Some(above(2.0))).abs() < 1e-12);
}

/// A scale of zero makes material that no actuation moves, and has no gradient.
#[test]
fn passive_material_is_that_without_actuation() {
    let passive = EffectSpec::Activation {
        elements: ElementSet::Region(above(1.0)),
        scale: 0.0,
    };
    let (mesh, mut masked) = bar([8, 4, 4], 0.25, vec![passive]);
    let (_, mut plain) = bar([8, 4, 4], 0.25, vec![]);
    let mut numbers = common::Numbers::new(3);
    let mut parameters = masked.rest_parameters();
    parameters.actuation = numbers.actuation(parameters.actuation.len(), 0.3);
    let solution = masked.solve(&parameters, None, &tight()).unwrap();
    let mut cleared = parameters.clone();
    let centres = (0..mesh.elements().len()).map(|e| mesh.element_corner(e).x + 0.125);
    let is_passive: Vec<bool> = centres.map(|x| x > 1.0).collect();
    for (samples, passive) in cleared.actuation.chunks_mut(8).zip(&is_passive) {
        if *passive {
            samples.fill([0.0; 6]);
        }
    }
    let expected = plain.solve(&cleared, None, &tight()).unwrap();
    assert_eq!(solution.positions, expected.positions);
    let cotangent = numbers.vectors(mesh.nodes().len(), 1.0);
    let adjoint = masked.adjoint(&parameters, &solution, &cotangent, &Default::default());
    let gradient = adjoint.unwrap().gradient.unwrap();
    for (samples, passive) in gradient.actuation.chunks(8).zip(&is_passive) {
        assert_eq!(samples.iter().flatten().all(|g| *g == 0.0), *passive);
    }
}

fn volume_of(mesh: &HexMesh, u: &[Vector3<f64>]) -> f64 {
    let gradients = pd_solver::deformation_gradients(mesh, u);
    let sum: f64 = gradients.iter().map(|f| f.determinant()).sum();
    sum / gradients.len() as f64
}

/// A bar that is pulled to 1.4 times its length keeps its volume, by all methods alike.
#[test]
fn volume_is_kept_when_a_bar_is_pulled() {
    let pulled = |stiffness: Option<f64>, method| {
        let mesh = HexMesh::solid_box([8, 4, 4], 0.25, Quadrature::Eight).unwrap();
        let ends = nodes_where(&mesh, |x| x.x == 0.0 || x.x == 2.0);
        let mut effects = vec![elasticity(), held(ends)];
        effects.extend(stiffness.map(|stiffness| EffectSpec::Volume { stiffness }));
        let mut solver = Solver::new(&mesh, &effects).unwrap();
        let mut parameters = solver.rest_parameters();
        for x in &mut parameters.prescribed {
            x.x *= 1.4;
        }
        let options = SolveOptions {
            max_iterations: 20_000,
            ..SolveOptions::new(Stop::RelativeGradient(1e-8)).with_method(method)
        };
        let solution = solver.solve(&parameters, None, &options).unwrap();
        assert_eq!(solution.status, Status::Converged, "{method:?}");
        (volume_of(&mesh, &solution.positions), solution.stats.energy)
    };
    let (free, _) = pulled(None, Method::Automatic);
    assert!(free > 1.3, "{free}");
    let (soft, _) = pulled(Some(10.0), Method::Automatic);
    let (kept, energy) = pulled(Some(100.0), Method::Automatic);
    assert!(
        (soft - 1.0).abs() < 0.06 && (kept - 1.0).abs() < 0.008,
        "{soft} {kept}"
    );
    for method in [
        Method::LocalGlobal,
        Method::Anderson,
        Method::Lbfgs,
        Method::Newton,
    ] {
        let (_, other) = pulled(Some(10.0), method);
        let (_, own) = pulled(Some(10.0), Method::Automatic);
        assert!(
            (other / own - 1.0).abs() < 1e-9,
            "{method:?} {other} {own} {energy}"
        );
    }
}

/// Turned inside out, material that keeps its volume finds its rest shape again.
#[test]
fn volume_is_right_under_inversion() {
    let (mesh, mut solver) = bar(
        [6, 3, 3],
        0.25,
        vec![EffectSpec::Volume { stiffness: 10.0 }],
    );
    let mirrored: Vec<_> = { mesh.nodes().iter() }
        .map(|x| Vector3::new(-x.x, x.y, x.z))
        .collect();
    let parameters = solver.rest_parameters();
    let back = solver.solve(&parameters, Some(&mirrored), &tight().leaving_saddles());
    let back = back.unwrap();
    assert_eq!(back.status, Status::Converged);
    let error = common::max_distance(&back.positions, mesh.nodes());
    assert!(error < 1e-6, "{error} {:?}", back.stats);
}

/// A hollow ball of cells, and its inner and outer surface.
fn hollow_ball(inner: f64, outer: f64, size: f64) -> HexMesh {
    let n = (outer / size).ceil() as i32 + 1;
    let centre = |c: [i32; 3]| Vector3::from(c.map(|c| (f64::from(c) + 0.5) * size)).norm();
    let all = (-n..n).flat_map(|x| (-n..n).flat_map(move |y| (-n..n).map(move |z| [x, y, z])));
    let cells = all.filter(|&c| (inner..outer).contains(&centre(c)));
    HexMesh::from_cells(cells.collect(), Vector3::zeros(), size, Quadrature::Eight).unwrap()
}

/// A ball that is blown up widens as Lame's solution for a thick sphere says (nu = 0, of which the thin wall `p r^2 / (2 t E)` is the limit).
#[test]
fn a_blown_up_ball_widens_as_the_textbook_says() {
    let pressure = 1e-4;
    for (inner, outer, size) in [(0.6, 1.0, 1.0 / 14.0), (0.8, 1.0, 1.0 / 20.0)] {
        let mesh = hollow_ball(inner, outer, size);
        // The walls of the cells, moved onto the sphere: the cavity is a sphere though its walls are steps.
        let steps = boundary(&mesh);
        let rest: Vec<_> = steps
            .points
            .iter()
            .map(|p| at(&mesh, p, mesh.nodes()))
            .collect();
        let middle = 0.5 * (inner + outer);
        let onto =
            |x: &Vector3<f64>| x * (if x.norm() < middle { inner } else { outer } / x.norm());
        let points: Vec<_> = rest.iter().map(onto).collect();
        let surface = EmbeddedSurface {
            points: embed(&mesh, &points).unwrap().vertices().to_vec(),
            triangles: steps.triangles,
        };
        let effects = [
            elasticity(),
            EffectSpec::Floating {},
            EffectSpec::Pressure {
                region: Some(NodeRegion::Sphere {
                    center: [0.0; 3],
                    radius: middle,
                }),
                capped: false,
                pressure,
            },
        ];
        let mut solver = Solver::on_surface(&mesh, &surface, &effects).unwrap();
        let u = solved(&mut solver);
        let (mut widened, mut count) = (0.0, 0.0);
        for (point, x) in surface.points.iter().zip(&points) {
            if x.norm() < middle {
                widened += at(&mesh, point, &u).norm() - x.norm();
                count += 1.0;
            }
        }
        let (a, b) = (inner.powi(3), outer.powi(3));
        let exact = pressure * a / (b - a) * (inner + b / (2.0 * inner * inner));
        let thin = pressure * middle * middle / (2.0 * (outer - inner));
        let ratio = widened / count / exact;
        assert!((ratio - 1.0).abs() < 0.06, "{ratio} {exact} {thin}");
    }
}

/// A pressure that no wall can bear: volume grows by the cube and elastic energy by the square of a length, so there is no equilibrium, and no
/// status may claim one.
#[test]
fn a_ball_that_bursts_has_no_equilibrium() {
    let mesh = hollow_ball(0.6, 1.0, 0.2);
    let surface = boundary(&mesh);
    let pressure = EffectSpec::Pressure {
        region: Some(NodeRegion::Sphere {
            center: [0.0; 3],
            radius: 0.75,
        }),
        capped: true,
        pressure: 1e3,
    };
    let effects = [elasticity(), EffectSpec::Floating {}, pressure];
    let mut solver = Solver::on_surface(&mesh, &surface, &effects).unwrap();
    let parameters = solver.rest_parameters();
    for method in [Method::Lbfgs, Method::Multigrid, Method::Newton] {
        let options = SolveOptions::new(Stop::Accuracy(1e-6)).with_method(method);
        let solution = solver.solve(&parameters, None, &options).unwrap();
        assert_eq!(solution.status, Status::NotFinite, "{method:?}");
        let mut numbers = solution.positions.iter().flatten();
        assert!(numbers.all(|x| x.is_finite()), "{method:?}");
    }
}

fn at(mesh: &HexMesh, point: &EmbeddedPoint, u: &[Vector3<f64>]) -> Vector3<f64> {
    let corners = mesh.elements()[point.element as usize].iter();
    corners
        .zip(&point.weights)
        .map(|(&n, w)| u[n as usize] * *w)
        .sum()
}

fn refused(extra: Vec<EffectSpec>) -> SolverError {
    let mesh = common::small_box(Quadrature::Eight);
    let wall = nodes_where(&mesh, |x| x.x == 0.0);
    let mut effects = vec![elasticity(), held(wall)];
    effects.extend(extra);
    Solver::on_surface(&mesh, &boundary(&mesh), &effects)
        .err()
        .expect("refused")
}

#[test]
fn senseless_effects_are_refused_with_their_place() {
    let inertia = |density, time_step| EffectSpec::Inertia {
        density,
        time_step,
        scheme: TimeScheme::Midpoint,
    };
    let elements = ElementSet::Region(above(0.5));
    let nowhere = Some(above(77.0));
    let cases = [
        (inertia(0.0, 1.0), "effect 2: `density` is 0"),
        (inertia(-1.0, 1.0), "effect 2: `density` is -1"),
        (inertia(1.0, 0.0), "effect 2: `time_step` is 0"),
        (
            EffectSpec::Damping { viscosity: 1.0 },
            "there is no damping where there is no `inertia`",
        ),
        (
            EffectSpec::Volume { stiffness: -2.0 },
            "effect 2: `stiffness` is -2",
        ),
        (
            EffectSpec::Gravity {
                acceleration: [0.0, f64::NAN, 0.0],
                density: 1.0,
            },
            "effect 2: `acceleration` is NaN",
        ),
        (
            EffectSpec::Wind {
                region: None,
                pressure: [0.0, 0.0, f64::INFINITY],
            },
            "effect 2: `pressure` is inf",
        ),
        (
            EffectSpec::Pressure {
                region: None,
                capped: false,
                pressure: f64::NEG_INFINITY,
            },
            "effect 2: `pressure` is -inf",
        ),
        (
            EffectSpec::Stiffness {
                elements: elements.clone(),
                factor: 0.0,
            },
            "effect 2: `factor` is 0",
        ),
        (
            EffectSpec::Activation {
                elements,
                scale: f64::NAN,
            },
            "effect 2: `scale` is NaN",
        ),
        (
            EffectSpec::Stiffness {
                elements: ElementSet::Region(above(77.0)),
                factor: 2.0,
            },
            "effect 2: no element lies in the region",
        ),
        (
            EffectSpec::Stiffness {
                elements: ElementSet::Painted(vec![2.0; 24]),
                factor: 2.0,
            },
            "shares from 0 to 1",
        ),
        (
            EffectSpec::Force {
                region: nowhere,
                force: [1.0; 3],
            },
            "no vertex of the surface lies in the region",
        ),
        (
            EffectSpec::Pressure {
                region: Some(above(0.5)),
                capped: false,
                pressure: 1.0,
            },
            "effect 2: the cavity is open along 10 edges",
        ),
    ];
    for (effect, text) in cases {
        let message = refused(vec![effect]).to_string();
        assert!(message.contains(text), "{message}");
    }
    let twice = vec![
        EffectSpec::Volume { stiffness: 1.0 },
        EffectSpec::Volume { stiffness: 1.0 },
    ];
    assert!(matches!(
        refused(twice),
        SolverError::DuplicateEffect { index: 3, .. }
    ));
    let mesh = common::small_box(Quadrature::Eight);
    let wall = nodes_where(&mesh, |x| x.x == 0.0);
    let force = EffectSpec::Force {
        region: None,
        force: [1.0; 3],
    };
    let without = Solver::new(&mesh, &[elasticity(), held(wall.clone()), force]).err();
    assert!(matches!(
        without,
        Some(SolverError::NoSurface { index: 2, .. })
    ));
    let mut solver = Solver::new(&mesh, &[elasticity(), held(wall)]).unwrap();
    let still = Motion::still(mesh.nodes().to_vec());
    let parameters = solver.rest_parameters();
    let step = solver.time_step(&still, &parameters, &tight());
    assert_eq!(step.err(), Some(SolverError::NoInertia));
}
