//! What is called next to singular, and linear solves that get lost.

use super::{SOFT, UNIQUE, adjoint, is_well_conditioned};
use crate::methods::{Preconditioner, Workspace};
use crate::problem::Problem;
use crate::solution::{Adjoint, AdjointOptions, AdjointStatus};
use crate::spec::{EffectSpec, NodeSet};
use crate::vector::NodalVector;
use hex_mesh::{HexMesh, Quadrature};
use nalgebra::Vector3;

/// A soft direction or a rotation that is not unique is enough; what was not met says nothing.
#[test]
fn either_kind_of_singular_state_is_ill_conditioned() {
    let (fine, soft, torn) = (Some(0.3), Some(0.5 * SOFT), Some(0.5 * UNIQUE));
    for firm in [None, fine, Some(2.0 * SOFT)] {
        for unique in [None, fine, Some(2.0 * UNIQUE)] {
            assert!(is_well_conditioned(firm, unique));
        }
    }
    for firm in [None, fine] {
        assert!(!is_well_conditioned(firm, torn));
        assert!(!is_well_conditioned(soft, firm));
    }
    assert!(!is_well_conditioned(soft, torn));
    assert!(!is_well_conditioned(Some(0.0), fine));
    assert!(!is_well_conditioned(fine, Some(0.0)));
    assert!(!is_well_conditioned(Some(f64::NAN), fine));
}

/// A preconditioner that is a factor.
struct Factor(f64);

impl Preconditioner for Factor {
    fn apply(&mut self, r: &[Vector3<f64>], z: &mut NodalVector) {
        z.iter_mut().zip(r).for_each(|(z, r)| *z = r * self.0);
    }
}

/// A cube of so many elements along its edge, held at one side.
fn held_cube(cells: usize) -> (HexMesh, Problem) {
    let mesh = HexMesh::solid_box([cells; 3], 0.5, Quadrature::Eight).unwrap();
    let side = (cells as u32 + 1).pow(2);
    let effects = [
        EffectSpec::Elasticity { stiffness: 1.0 },
        EffectSpec::Prescribed {
            nodes: NodeSet::Indices((0..side).collect()),
        },
    ];
    let problem = Problem::new(&mesh, None, &effects).unwrap();
    (mesh, problem)
}

/// Of a linear solve that broke down nothing is told but that it did: no gradient, not that of an earlier call either.
#[test]
fn a_linear_solve_that_breaks_down_gives_no_gradient() {
    let (mesh, mut problem) = held_cube(2);
    problem.linearise(mesh.nodes());
    let cotangent = vec![Vector3::new(1.0, 2.0, 3.0); problem.len()];
    let mut out = Adjoint {
        gradient: Some(problem.rest_parameters.clone()),
        ..Adjoint::default()
    };
    adjoint(
        &mut problem,
        &mut Factor(f64::NAN),
        &mut Workspace::default(),
        mesh.nodes(),
        &cotangent,
        &AdjointOptions::default(),
        &mut out,
    );
    assert_eq!(out.status, AdjointStatus::NotFinite);
    assert_eq!(out.gradient, None);
}

/// What comes along with the products of a solve is what a product with its solution gives: from zero, from the multiplier of an earlier call,
/// from one that is of no use, and after negative curvature.
#[test]
fn the_gradient_by_prescribed_positions_is_that_of_the_multiplier() {
    let (mesh, mut problem) = held_cube(3);
    let options = AdjointOptions {
        warm_start: true,
        max_iterations: 400,
        ..AdjointOptions::default()
    };
    let wave = |i: usize| Vector3::new((i as f64).sin(), (0.7 * i as f64).cos(), 0.3);
    let cotangent: NodalVector = (0..problem.len()).map(wave).collect();
    // An even compression, which has negative curvature, and a state near rest.
    for (scale, indefinite) in [(1.02, false), (0.5, true)] {
        let u: NodalVector = mesh.nodes().iter().map(|x| x * scale).collect();
        problem.linearise(&u);
        let mut space = Workspace::default();
        let mut out = Adjoint::default();
        for start in ["zero", "the last multiplier", "nonsense"] {
            if start == "nonsense" {
                out.multiplier.fill(Vector3::repeat(1e6));
            }
            adjoint(
                &mut problem,
                &mut Factor(1.0),
                &mut space,
                &u,
                &cotangent,
                &options,
                &mut out,
            );
            // From where the end is nothing is left to do, and nothing met.
            let wanted = match indefinite && start != "the last multiplier" {
                true => AdjointStatus::ConvergedIndefinite,
                false => AdjointStatus::Converged,
            };
            assert_eq!(out.status, wanted, "{scale} from {start}");
            let mut product = vec![Vector3::zeros(); problem.len()];
            problem.full_hessian_product(&out.multiplier, &mut product);
            let gradient = &out.gradient.as_ref().unwrap().prescribed;
            assert_eq!(gradient.len(), 16);
            for (gradient, &node) in gradient.iter().zip(&problem.prescribed) {
                let expected = cotangent[node as usize] - product[node as usize];
                let error = (gradient - expected).norm();
                assert!(
                    error < 1e-10 * (1.0 + expected.norm()),
                    "{scale} from {start}: {error:e}"
                );
            }
        }
    }
}
