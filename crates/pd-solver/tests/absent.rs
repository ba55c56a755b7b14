//! What is not listed costs nothing: the same counts, the same bits, no memory, no parameters; and an effect at its neutral value changes nothing.

mod common;

use common::{Numbers, boundary, elasticity, held, nodes_where};
use hex_mesh::{HexMesh, NodeRegion, Quadrature};
use pd_solver::{
    Adjoint, AdjointOptions, EffectSpec, ElementSet, Method, NodeSet, Parameters, Solution,
    SolveOptions, Solver, SpringPoints, Status, Stop, TimeScheme, Work,
};

/// A body small enough for the factor, and one that multigrid takes.
const SIZES: [[usize; 3]; 2] = [[4, 3, 2], [12, 6, 6]];

fn mesh(cells: [usize; 3]) -> HexMesh {
    HexMesh::solid_box(cells, 0.25, Quadrature::Eight).unwrap()
}

fn plain(mesh: &HexMesh) -> Vec<EffectSpec> {
    vec![elasticity(), held(nodes_where(mesh, |x| x.x == 0.0))]
}

fn with(mesh: &HexMesh, extra: &[EffectSpec]) -> Solver {
    let effects = [&plain(mesh), extra].concat();
    Solver::on_surface(mesh, &boundary(mesh), &effects).unwrap()
}

fn right_half() -> NodeRegion {
    NodeRegion::HalfSpace {
        normal: [1.0, 0.0, 0.0],
        offset: 0.5,
    }
}

/// Every effect that has something to hold, which those after may need; a new one adds a line here.
fn every_effect() -> Vec<(&'static str, EffectSpec)> {
    let all = vec![
        EffectSpec::Springs {
            points: SpringPoints::Nodes(NodeSet::Region(right_half())),
            stiffness: 0.3,
        },
        EffectSpec::Gravity {
            acceleration: [0.0, 0.1, -0.4],
            density: 1.3,
        },
        EffectSpec::Stiffness {
            elements: ElementSet::Region(right_half()),
            factor: 40.0,
        },
        EffectSpec::Activation {
            elements: ElementSet::Region(right_half()),
            scale: 0.25,
        },
        EffectSpec::Volume { stiffness: 5.0 },
        EffectSpec::Pressure {
            region: None,
            capped: false,
            pressure: 0.1,
        },
        EffectSpec::Force {
            region: Some(right_half()),
            force: [0.0, 0.05, -0.1],
        },
        EffectSpec::Wind {
            region: None,
            pressure: [-0.1, 0.0, 0.05],
        },
        EffectSpec::Damping { viscosity: 0.8 },
        EffectSpec::Inertia {
            density: 1.5,
            time_step: 0.7,
            scheme: TimeScheme::BackwardEuler,
        },
    ];
    all.into_iter().map(|e| (e.kind(), e)).collect()
}

fn actuated(solver: &Solver) -> Parameters {
    let mut parameters = solver.rest_parameters();
    parameters.actuation = Numbers::new(5).actuation(parameters.actuation.len(), 0.2);
    parameters
}

/// A solve and its adjoint.
fn answer(solver: &mut Solver, method: Method) -> (Solution, Adjoint, Work) {
    let parameters = actuated(solver);
    let options = SolveOptions::new(Stop::RelativeGradient(1e-6)).with_method(method);
    let mut solution = solver.solve(&parameters, None, &options).unwrap();
    assert_eq!(solution.status, Status::Converged);
    let cotangent = Numbers::new(9).vectors(solution.positions.len(), 1.0);
    let options = AdjointOptions::default();
    let adjoint = solver.adjoint(&parameters, &solution, &cotangent, &options);
    let mut adjoint = adjoint.unwrap();
    let work = solver.work();
    // Seconds are what may differ.
    solution.stats.seconds = 0.0;
    solution.stats.local_seconds = 0.0;
    adjoint.stats.seconds = 0.0;
    (solution, adjoint, work)
}

/// Effects that a surface is there for are absent from a list without them: the surface itself costs nothing.
#[test]
fn a_surface_without_effects_on_it_changes_no_count_and_no_bit() {
    for cells in SIZES {
        let mesh = mesh(cells);
        for method in [Method::Automatic, Method::LocalGlobal, Method::Newton] {
            let bare = answer(&mut Solver::new(&mesh, &plain(&mesh)).unwrap(), method);
            let dressed = answer(&mut with(&mesh, &[]), method);
            assert!(bare == dressed, "{cells:?} {method:?}");
        }
    }
}

/// What a list holds before any solve, and what one evaluation of it does.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Held {
    bytes: usize,
    projections: u64,
    queries: u64,
    /// Entries of all parameters.
    parameters: usize,
}

impl Held {
    fn of(solver: &mut Solver) -> Self {
        let bytes = solver.work().effect_bytes;
        let p = solver.rest_parameters();
        let rest = solver.rest().to_vec();
        solver.energy_gradient(&p, &rest).unwrap();
        let work = solver.work();
        let vectors = [
            &p.prescribed,
            &p.spring_targets,
            &p.acceleration,
            &p.forces,
            &p.inertia,
            &p.before,
            &p.obstacles,
        ];
        Self {
            bytes,
            projections: work.local_projections,
            queries: work.contact_queries,
            parameters: vectors.map(Vec::len).iter().sum::<usize>()
                + p.actuation.len()
                + p.pressures.len(),
        }
    }

    fn combine(self, other: Self, up: bool) -> Self {
        let u = |a: usize, b: usize| if up { a + b } else { a - b };
        let w = |a: u64, b: u64| if up { a + b } else { a - b };
        Self {
            bytes: u(self.bytes, other.bytes),
            projections: w(self.projections, other.projections),
            queries: w(self.queries, other.queries),
            parameters: u(self.parameters, other.parameters),
        }
    }
}

/// Memory, parameters, projections and queries of a list are those of its effects and nothing else: without one of them, what that one alone has is
/// gone, whatever else is listed.
#[test]
fn a_list_without_an_effect_holds_nothing_of_it() {
    let mesh = mesh(SIZES[0]);
    let none = Held::of(&mut Solver::new(&mesh, &plain(&mesh)).unwrap());
    let all = every_effect();
    let list: Vec<EffectSpec> = all.iter().map(|(_, e)| e.clone()).collect();
    let together = Held::of(&mut with(&mesh, &list));
    let inertia = list.last().expect("inertia comes last").clone();
    for (kind, effect) in &all {
        let own = match effect {
            EffectSpec::Damping { .. } => {
                let both = Held::of(&mut with(&mesh, &[effect.clone(), inertia.clone()]));
                both.combine(
                    Held::of(&mut with(&mesh, std::slice::from_ref(&inertia))),
                    false,
                )
            }
            _ => Held::of(&mut with(&mesh, std::slice::from_ref(effect))).combine(none, false),
        };
        assert!(own.bytes > 0, "{kind} holds something");
        let others = { list.iter() }.filter(|e| match effect {
            // Damping cannot do without it.
            EffectSpec::Inertia { .. } => !["inertia", "damping"].contains(&e.kind()),
            _ => e.kind() != *kind,
        });
        let without = Held::of(&mut with(&mesh, &others.cloned().collect::<Vec<_>>()));
        let expected = match effect {
            EffectSpec::Inertia { .. } => {
                let pair = &list[list.len() - 2..];
                together.combine(Held::of(&mut with(&mesh, pair)).combine(none, false), false)
            }
            _ => together.combine(own, false),
        };
        assert_eq!(without, expected, "{kind}");
    }
}

/// Fields of ones, and loads of zero, change no bit of the positions and no step.
#[test]
fn neutral_values_change_no_bit() {
    let elements = || ElementSet::Region(right_half());
    let neutral = [
        EffectSpec::Stiffness {
            elements: elements(),
            factor: 1.0,
        },
        EffectSpec::Activation {
            elements: elements(),
            scale: 1.0,
        },
        EffectSpec::Gravity {
            acceleration: [0.0; 3],
            density: 1.0,
        },
        EffectSpec::Force {
            region: Some(right_half()),
            force: [0.0; 3],
        },
        EffectSpec::Wind {
            region: None,
            pressure: [0.0; 3],
        },
        EffectSpec::Pressure {
            region: None,
            capped: false,
            pressure: 0.0,
        },
    ];
    for cells in SIZES {
        let mesh = mesh(cells);
        for method in [Method::Automatic, Method::Newton] {
            let (expected, gradient, _) = answer(&mut with(&mesh, &[]), method);
            for effect in &neutral {
                let found = answer(&mut with(&mesh, std::slice::from_ref(effect)), method);
                let what = format!("{} {cells:?} {method:?}", effect.kind());
                assert!(found.0.positions == expected.positions, "{what}");
                assert_eq!(
                    found.0.stats.iterations, expected.stats.iterations,
                    "{what}"
                );
                assert_eq!(found.0.stats.energy, expected.stats.energy, "{what}");
                assert!(found.1.multiplier == gradient.multiplier, "{what}");
            }
        }
    }
}

/// The counts of a scene that has elasticity and a held wall, and nothing else: no later effect may change them.
#[test]
fn a_plain_scene_does_what_it_did() {
    let counts = SIZES.map(|cells| {
        let mesh = mesh(cells);
        let mut solver = Solver::new(&mesh, &plain(&mesh)).unwrap();
        let built = solver.work();
        let rest = solver.rest().to_vec();
        let ten_steps = SolveOptions {
            max_iterations: 10,
            ..SolveOptions::new(Stop::RelativeGradient(1e-12)).with_method(Method::LocalGlobal)
        };
        let parameters = actuated(&solver);
        let solution = solver.solve(&parameters, Some(&rest), &ten_steps).unwrap();
        assert_eq!(solution.status, Status::IterationLimit);
        let w = solver.work();
        format!(
            "{} factorisations when built; {} then, {} non-zeros, {} factor entries, {} evaluations, {} projections, {} constant solves, {} queries",
            built.factorisations,
            w.factorisations,
            w.matrix_nonzeros,
            w.factor_entries,
            w.evaluations,
            w.local_projections,
            w.constant_solves,
            w.contact_queries,
        )
    });
    insta::assert_snapshot!(counts.join("\n"), @r"
    1 factorisations when built; 1 then, 374 non-zeros, 1296 factor entries, 12 evaluations, 2304 projections, 10 constant solves, 0 queries
    0 factorisations when built; 1 then, 6431 non-zeros, 38827 factor entries, 12 evaluations, 41472 projections, 10 constant solves, 0 queries
    ");
}
