//! What effects tell of themselves, against what they do: their twins on coarser grids, their size, their counts.

use super::{Effect, build};
use crate::constant::ConstantMatrix;
use crate::multigrid::Hierarchy;
use crate::problem::Problem;
use crate::spec::{EffectSpec, ElementSet, NodeSet, SpringPoints, TimeScheme};
use crate::surface::EmbeddedSurface;
use crate::vector::{NodalVector, dot, zeros};
use hex_mesh::{HexMesh, NodeRegion, Quadrature, embed};
use nalgebra::{Matrix3, Vector3};
use polar_grad::testing::Random;

/// Full blocks of two cells along x, and one of three along the others.
fn body() -> HexMesh {
    HexMesh::solid_box([8, 5, 7], 0.25, Quadrature::Eight).unwrap()
}

/// A body whose coarse elements are filled in part.
fn bent() -> HexMesh {
    let cells = (0..11).flat_map(|x| (0..5).flat_map(move |y| (0..9).map(move |z| [x, y, z])));
    let cells = cells.filter(|c| c[0] < 3 || c[2] < 3).collect();
    HexMesh::from_cells(cells, Vector3::new(0.1, 0.2, -0.3), 0.2, Quadrature::Eight).unwrap()
}

/// An even strain, with a rotation and a shift.
fn strained(x: &Vector3<f64>) -> Vector3<f64> {
    let f = Matrix3::new(1.2, 0.1, 0.0, 0.05, 0.8, -0.1, 0.0, 0.2, 1.1);
    f * x + Vector3::new(0.3, -0.2, 0.1)
}

fn right(mesh: &HexMesh) -> NodeRegion {
    let last = mesh.nodes().iter().map(|x| x.x).fold(0.0, f64::max);
    NodeRegion::HalfSpace {
        normal: [1.0, 0.0, 0.0],
        offset: last - 0.1,
    }
}

/// Effects that have a coarse twin, each alone beside elasticity.
fn carried_down(mesh: &HexMesh) -> Vec<(&'static str, Vec<EffectSpec>)> {
    let count = mesh.elements().len();
    let points: Vec<_> = { mesh.sample_positions().into_iter().step_by(29) }.collect();
    let factors = (0..points.len()).map(|i| 0.2 * i as f64).collect();
    let stiffness = EffectSpec::Stiffness {
        elements: ElementSet::Painted((0..count).map(|e| (e % 4) as f64 / 3.0).collect()),
        factor: 7.0,
    };
    let springs = |points| EffectSpec::Springs {
        points,
        stiffness: 3.0,
    };
    vec![
        ("elasticity", vec![]),
        ("stiffness", vec![stiffness]),
        ("volume", vec![EffectSpec::Volume { stiffness: 5.0 }]),
        (
            "springs between nodes",
            vec![springs(SpringPoints::Embedded {
                points: embed(mesh, &points).unwrap().vertices().to_vec(),
                factors,
            })],
        ),
        (
            "springs at nodes",
            vec![springs(SpringPoints::Nodes(NodeSet::Region(right(mesh))))],
        ),
        (
            "gravity",
            vec![EffectSpec::Gravity {
                acceleration: [0.3, -0.4, 2.0],
                density: 1.7,
            }],
        ),
        (
            "force",
            vec![EffectSpec::Force {
                region: Some(right(mesh)),
                force: [0.5, 1.5, -0.7],
            }],
        ),
        (
            "pressure",
            vec![EffectSpec::Pressure {
                region: None,
                capped: false,
                pressure: 0.9,
            }],
        ),
    ]
}

fn problem(mesh: &HexMesh, extra: Vec<EffectSpec>) -> Problem {
    let lowest = mesh.nodes().iter().map(|x| x.x).fold(f64::MAX, f64::min);
    let wall = 0..mesh.nodes().len() as u32;
    let wall = wall.filter(|&n| mesh.nodes()[n as usize].x == lowest);
    let mut specs = vec![
        EffectSpec::Elasticity { stiffness: 2.0 },
        EffectSpec::Prescribed {
            nodes: NodeSet::Indices(wall.collect()),
        },
    ];
    specs.extend(extra);
    Problem::new(mesh, Some(&EmbeddedSurface::boundary(mesh)), &specs).unwrap()
}

/// The ways that know of rest, or linearise as well, lead to the same energy and gradient, at rest and away from it.
#[test]
fn every_way_to_a_gradient_is_the_same() {
    let mesh = bent();
    for (name, extra) in carried_down(&mesh) {
        let mut problem = problem(&mesh, extra);
        let mut parameters = problem.rest_parameters.clone();
        // Springs pull at rest too.
        parameters
            .spring_targets
            .iter_mut()
            .for_each(|x| x.y += 0.1);
        problem.set_parameters(&parameters);
        let rest = problem.rest.clone();
        for u in [rest.clone(), rest.iter().map(strained).collect()] {
            let [mut plain, mut at_rest, mut along] = [(); 3].map(|()| zeros(u.len()));
            let energy = problem.evaluate(&u, &mut plain);
            assert_eq!(problem.evaluate_at_rest(&u, &mut at_rest), energy, "{name}");
            problem.linearise_with_gradient(&u, &mut along);
            assert_eq!(at_rest, plain, "{name}");
            assert_eq!(along, plain, "{name}");
        }
    }
}

/// The energy of an even strain.
fn energy(problem: &mut Problem) -> f64 {
    let u: NodalVector = problem.rest.iter().map(strained).collect();
    let mut gradient = zeros(u.len());
    problem.evaluate(&u, &mut gradient)
}

/// Interpolation is exact for an even strain, and what is filled in part has the volume that it has.
#[test]
fn an_even_strain_has_the_same_energy_on_every_grid() {
    for mesh in [body(), bent()] {
        for (name, extra) in carried_down(&mesh) {
            let mut fine = problem(&mesh, extra);
            let hierarchy =
                Hierarchy::new(&mesh, &fine.prescribed, fine.stiffness.as_deref()).unwrap();
            let expected = energy(&mut fine);
            assert!(expected.abs() > 0.1, "{name}");
            for level in 0..hierarchy.transfers.len() {
                fine = fine.coarsen(&hierarchy, level).expect(name);
                let coarse = energy(&mut fine);
                let error = (coarse / expected - 1.0).abs();
                // Weights of transfers are in single precision.
                assert!(error < 1e-6, "{name} {level}: {coarse} {expected}");
            }
        }
    }
}

/// Springs and inertia, one size of boxes, one weight: what touches an inner node is in the middle of a row of the matrix.
fn of_one_weight(mesh: &HexMesh) -> Vec<EffectSpec> {
    vec![
        EffectSpec::Elasticity { stiffness: 2.0 },
        EffectSpec::Volume { stiffness: 5.0 },
        EffectSpec::Springs {
            points: SpringPoints::Nodes(NodeSet::Region(right(mesh))),
            stiffness: 3.0,
        },
        EffectSpec::Inertia {
            density: 1.7,
            time_step: 0.4,
            scheme: TimeScheme::BackwardEuler,
        },
    ]
}

fn largest_of(effect: &dyn Effect, nodes: usize) -> f64 {
    let mut matrix = ConstantMatrix::new((0..nodes as u32).map(Some).collect());
    effect.add_constant(&mut matrix);
    let lower = matrix.compress();
    let diagonal = (0..lower.size()).filter_map(|j| lower.column(j).next());
    diagonal.map(|(_, value)| value).fold(0.0, f64::max)
}

/// What makes roundoff comparable is no less than the largest diagonal entry, and not much more; nothing where there is no entry.
#[test]
fn the_largest_diagonal_is_about_that_of_the_constant_matrix() {
    let mesh = body();
    let mut specs = of_one_weight(&mesh);
    specs.push(EffectSpec::Gravity {
        acceleration: [0.3, -0.4, 2.0],
        density: 1.7,
    });
    let batches = build(&mesh, None, &specs).unwrap();
    for (effect, spec) in batches.effects.iter().zip(&specs) {
        let told = effect.largest_diagonal();
        let actual = largest_of(&**effect, mesh.nodes().len());
        match spec {
            EffectSpec::Gravity { .. } => assert_eq!([told, actual], [0.0; 2]),
            _ => assert!((0.999..1.2).contains(&(told / actual)), "{told} {actual}"),
        }
    }
}

/// Friction has no constant matrix; at rest its Hessian takes up what strains.
#[test]
fn the_largest_diagonal_of_friction_is_about_that_of_its_hessian() {
    let mesh = body();
    let mut specs = of_one_weight(&mesh);
    specs.push(EffectSpec::Damping { viscosity: 0.6 });
    let mut batches = build(&mesh, None, &specs).unwrap();
    let friction = batches.effects.last_mut().unwrap();
    friction.linearise(mesh.nodes());
    let mut largest = 0.0_f64;
    for node in 0..mesh.nodes().len() {
        let (mut x, mut out) = (zeros(mesh.nodes().len()), zeros(mesh.nodes().len()));
        x[node].x = 1.0;
        friction.hessian_product(&x, &mut out);
        largest = largest.max(out[node].x);
    }
    let ratio = friction.largest_diagonal() / largest;
    assert!((1.0..1.6).contains(&ratio), "{ratio}");
}

/// What preconditioners take friction for is what it is where the body is strained and not turned: against an even rate of strain `S` its Hessian
/// is `viscous |S|^2` per volume.
#[test]
fn friction_is_as_stiff_as_preconditioners_take_it_for() {
    let mesh = body();
    for scheme in [TimeScheme::BackwardEuler, TimeScheme::Midpoint] {
        let specs = [
            EffectSpec::Elasticity { stiffness: 2.0 },
            EffectSpec::Inertia {
                density: 1.7,
                time_step: 0.4,
                scheme,
            },
            EffectSpec::Damping { viscosity: 0.6 },
        ];
        let mut batches = build(&mesh, None, &specs).unwrap();
        let strain = Matrix3::new(0.3, 0.1, -0.2, 0.1, 0.5, 0.4, -0.2, 0.4, -0.7);
        let x: NodalVector = mesh.nodes().iter().map(|x| strain * x).collect();
        let mut out = zeros(x.len());
        let friction = batches.effects.last_mut().unwrap();
        friction.linearise(mesh.nodes());
        friction.hessian_product(&x, &mut out);
        let volume = mesh.element_volume() * mesh.elements().len() as f64;
        let expected = dot(&x, &out) / (volume * strain.norm_squared());
        assert!(
            (batches.viscous / expected - 1.0).abs() < 1e-12,
            "{expected}"
        );
    }
}

/// One projection for every sample of elasticity, and one for every element that keeps its volume.
#[test]
fn projections_are_counted_by_samples() {
    let mesh = body();
    let mut problem = problem(&mesh, vec![EffectSpec::Volume { stiffness: 5.0 }]);
    energy(&mut problem);
    let elements = mesh.elements().len() as u64;
    assert_eq!(problem.work.local_projections, 9 * elements);
}

/// Volume and samples see the same singular values where the strain is even: the smallest pair sum is that of the strain.
#[test]
fn the_smallest_pair_sum_of_an_even_strain_is_that_of_the_strain() {
    let mesh = body();
    let specs = of_one_weight(&mesh);
    let mut batches = build(&mesh, None, &specs).unwrap();
    for (sigma, smallest) in [
        ([1.5, 0.7, 1.0], 1.7),
        ([0.4, 1.2, 0.9], 1.3),
        ([1.2, -0.4, 1.1], 0.7),
    ] {
        let u: NodalVector = { mesh.nodes().iter() }
            .map(|x| x.component_mul(&Vector3::from(sigma)))
            .collect();
        for (effect, expected) in batches.effects.iter_mut().zip([true, true, false, false]) {
            effect.linearise(&u);
            let found = effect.smallest_pair_sum();
            assert_eq!(found.is_some(), expected);
            assert!(
                found.is_none_or(|found| (found - smallest).abs() < 1e-10),
                "{found:?}"
            );
        }
    }
    // One element that is turned inside out is enough.
    let mut u = mesh.nodes().to_vec();
    let nodes = mesh.elements()[77].map(|n| n as usize);
    let middle = nodes.iter().map(|&n| mesh.nodes()[n].x).sum::<f64>() / 8.0;
    nodes.iter().for_each(|&n| u[n].x = 2.0 * middle - u[n].x);
    for effect in &mut batches.effects[..2] {
        effect.linearise(&u);
        assert!(effect.smallest_pair_sum().unwrap() < 0.5);
    }
}

/// A body folded over a plane of nodes is inside out beyond it, in all samples.
#[test]
fn samples_beyond_a_fold_are_inverted() {
    for quadrature in [Quadrature::One, Quadrature::Eight, Quadrature::TwentySeven] {
        let mesh = HexMesh::solid_box([5, 2, 3], 0.2, quadrature).unwrap();
        let specs = [EffectSpec::Elasticity { stiffness: 2.0 }];
        let batches = build(&mesh, None, &specs).unwrap();
        for beyond in 0..=5 {
            let fold = 1.0 - 0.2 * f64::from(beyond);
            let u: NodalVector = { mesh.nodes().iter() }
                .map(|x| Vector3::new(fold - (x.x - fold).abs(), x.y, x.z))
                .collect();
            let expected = beyond as usize * 6 * quadrature.count();
            assert_eq!(batches.effects[0].inverted_samples(&u), expected);
        }
        // Flat is not inside out.
        let flat: NodalVector = { mesh.nodes().iter() }
            .map(|x| Vector3::new(0.0, x.y, x.z))
            .collect();
        assert_eq!(batches.effects[0].inverted_samples(&flat), 0);
    }
}

/// Bodies are cut into slabs that add to their nodes side by side: forces are slopes of the energy in all of them.
#[test]
fn forces_of_a_body_of_several_slabs_are_slopes() {
    let mesh = body();
    let mut batches = build(&mesh, None, &of_one_weight(&mesh)).unwrap();
    let mut random = Random::new(9);
    let mut vectors = |size: f64| -> NodalVector {
        let nodes = mesh.nodes().iter();
        nodes.map(|_| random.matrix().column(0) * size).collect()
    };
    let (noise, direction) = (vectors(0.03), vectors(1.0));
    for effect in &mut batches.effects {
        let mut at = |t: f64| {
            let nodes = mesh.nodes().iter().zip(&noise).zip(&direction);
            let u: NodalVector = nodes.map(|((x, n), d)| x + n + d * t).collect();
            let mut gradient = zeros(u.len());
            let energy = effect.energy_gradient(&u, &mut gradient);
            (energy, gradient)
        };
        let h = 1e-4;
        let slope = (8.0 * (at(h).0 - at(-h).0) - (at(2.0 * h).0 - at(-2.0 * h).0)) / (12.0 * h);
        let exact = dot(&at(0.0).1, &direction);
        assert!((slope / exact - 1.0).abs() < 1e-7, "{slope} {exact}");
    }
}

/// Blown up evenly, every length by a share `e`, material that keeps its volume has the energy `3/2 k e^2 V`; nothing else resists a change of
/// volume as such.
#[test]
fn the_stiffness_against_changes_of_volume_is_that_of_the_energy() {
    let mesh = body();
    let mut batches = build(&mesh, None, &of_one_weight(&mesh)).unwrap();
    let volume = mesh.element_volume() * mesh.elements().len() as f64;
    let share = 0.02;
    let u: NodalVector = mesh.nodes().iter().map(|x| x * (1.0 + share)).collect();
    let energy = batches.effects[1].energy_gradient(&u, &mut zeros(u.len()));
    let told: Vec<f64> = batches
        .effects
        .iter()
        .map(|e| e.volume_stiffness())
        .collect();
    let by_energy = energy / (1.5 * share * share * volume);
    assert!(
        (told[1] / by_energy - 1.0).abs() < 1e-9,
        "{told:?} {by_energy}"
    );
    assert!([0, 2, 3].iter().all(|&k| told[k] == 0.0), "{told:?}");
}

/// What preconditioners are told of springs and masses is all of their Hessian; elasticity and volume they know by themselves.
#[test]
fn forms_are_the_hessian_of_what_is_not_elastic() {
    let mesh = body();
    let mut specs = of_one_weight(&mesh);
    specs.extend(carried_down(&mesh).swap_remove(3).1);
    let mut batches = build(&mesh, None, &specs).unwrap();
    let mut random = Random::new(5);
    let nodes = mesh.nodes().iter();
    let x: NodalVector = nodes.map(|_| random.matrix().column(0).into()).collect();
    for (k, effect) in batches.effects.iter_mut().enumerate() {
        let mut told = 0.0;
        effect.for_each_form(&mut |nodes, weights, stiffness| {
            let terms = nodes.iter().zip(weights);
            let form: Vector3<f64> = terms.map(|(&n, w)| x[n as usize] * *w).sum();
            told += stiffness * form.norm_squared();
        });
        let mut out = zeros(x.len());
        effect.linearise(mesh.nodes());
        effect.hessian_product(&x, &mut out);
        let hessian = dot(&x, &out);
        match k {
            0 | 1 => assert_eq!(told, 0.0),
            _ => assert!((told / hessian - 1.0).abs() < 1e-12, "{told} {hessian}"),
        }
    }
}
