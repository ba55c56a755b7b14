//! When the cycle has the actuation that the problem has.

use super::Cycle;
use crate::methods::Preconditioner;
use crate::methods::coarse_to_fine::carry_down;
use crate::multigrid::Hierarchy;
use crate::parameters::Parameters;
use crate::problem::Problem;
use crate::spec::{EffectSpec, NodeSet};
use hex_mesh::{HexMesh, Quadrature};
use nalgebra::Vector3;

/// A body whose last block of elements is not full, and its cycle.
fn body(quadrature: Quadrature) -> (HexMesh, Problem, Cycle) {
    let mesh = HexMesh::solid_box([5, 3, 3], 0.5, quadrature).unwrap();
    let effects = [
        EffectSpec::Elasticity { stiffness: 1.0 },
        EffectSpec::Prescribed {
            nodes: NodeSet::Indices((0..16).collect()),
        },
    ];
    let problem = Problem::new(&mesh, None, &effects).unwrap();
    let hierarchy = Hierarchy::new(&mesh, &problem.prescribed, None).unwrap();
    let (multigrid, _) = carry_down(&problem, hierarchy);
    let cycle = Cycle::new(multigrid, problem.element_size);
    (mesh, problem, cycle)
}

/// Another actuation for every seed.
fn actuated(problem: &Problem, seed: f64) -> Parameters {
    let mut parameters = problem.rest_parameters.clone();
    let entries = parameters.actuation.iter_mut().flatten().enumerate();
    entries.for_each(|(i, b)| *b = 0.2 * (seed * i as f64).sin());
    parameters
}

/// Whether the finest level of the cycle has the means of `A = I + b`.
fn has(cycle: &Cycle, parameters: &Parameters) -> bool {
    let means = cycle.multigrid.actuation(0);
    let samples = parameters.actuation.len() / means.len();
    let mut near = true;
    for (mean, of_element) in means.iter().zip(parameters.actuation.chunks(samples)) {
        for (k, mean) in mean.iter().enumerate() {
            let sum: f64 = of_element.iter().map(|b| b[k]).sum();
            let unit = if [0, 3, 5].contains(&k) { 1.0 } else { 0.0 };
            near &= (mean - unit - sum / samples as f64).abs() < 1e-14;
        }
    }
    near
}

/// Whatever builds the cycle builds it for the last actuation; what leaves it as it is does not ask for one.
#[test]
fn the_cycle_is_built_for_the_last_actuation() {
    for quadrature in [Quadrature::One, Quadrature::Eight, Quadrature::TwentySeven] {
        let (mesh, mut problem, mut cycle) = body(quadrature);
        let u = mesh.nodes();
        let far: Vec<_> = u.iter().map(|x| x + Vector3::new(0.0, 0.0, 1.0)).collect();
        let actuate = |problem: &mut Problem, cycle: &mut Cycle, seed| {
            let next = actuated(problem, seed);
            problem.set_parameters(&next);
            cycle.actuate();
            next
        };
        let first = actuate(&mut problem, &mut cycle, 0.3);
        assert!(cycle.prepare(&mut problem, u), "built where it was not yet");
        assert!(has(&cycle, &first));

        let second = actuate(&mut problem, &mut cycle, 0.7);
        assert!(!cycle.prepare(&mut problem, u), "built here already");
        assert!(has(&cycle, &first) && !has(&cycle, &second));
        assert!(cycle.prepare(&mut problem, &far), "far from where it was");
        assert!(has(&cycle, &second));

        let third = actuate(&mut problem, &mut cycle, 1.1);
        cycle.rebuild(&mut problem, u);
        assert!(has(&cycle, &third));

        let fourth = actuate(&mut problem, &mut cycle, 1.3);
        assert!(cycle.project(&problem, u));
        assert!(has(&cycle, &fourth));

        let fifth = actuate(&mut problem, &mut cycle, 1.7);
        cycle.forget();
        assert!(cycle.strengthen(&problem, u));
        assert!(has(&cycle, &fifth));
    }
}
