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

/// A preconditioner that has lost all digits.
struct Lost;

impl Preconditioner for Lost {
    fn apply(&mut self, _r: &[Vector3<f64>], z: &mut NodalVector) {
        z.fill(Vector3::repeat(f64::NAN));
    }

    fn follows(&self) -> bool {
        false
    }

    fn tells_errors(&self) -> bool {
        false
    }

    fn prepare(&mut self, _problem: &mut Problem, _u: &[Vector3<f64>]) -> bool {
        false
    }

    fn rebuild(&mut self, _problem: &mut Problem, _u: &[Vector3<f64>]) {}

    fn project(&mut self, _u: &[Vector3<f64>]) -> bool {
        false
    }

    fn strengthen(&mut self, _u: &[Vector3<f64>]) -> bool {
        false
    }
}

/// Of a linear solve that broke down nothing is told but that it did: no gradient, not that of an earlier call either.
#[test]
fn a_linear_solve_that_breaks_down_gives_no_gradient() {
    let mesh = HexMesh::solid_box([2, 2, 2], 0.5, Quadrature::Eight).unwrap();
    let effects = [
        EffectSpec::Elasticity { stiffness: 1.0 },
        EffectSpec::Prescribed {
            nodes: NodeSet::Indices((0..9).collect()),
        },
    ];
    let mut problem = Problem::new(&mesh, None, &effects).unwrap();
    problem.linearise(mesh.nodes());
    let cotangent = vec![Vector3::new(1.0, 2.0, 3.0); problem.len()];
    let mut out = Adjoint {
        gradient: Some(problem.rest_parameters.clone()),
        ..Adjoint::default()
    };
    adjoint(
        &mut problem,
        &mut Lost,
        &mut Workspace::default(),
        mesh.nodes(),
        &cotangent,
        &AdjointOptions::default(),
        &mut out,
    );
    assert_eq!(out.status, AdjointStatus::NotFinite);
    assert_eq!(out.gradient, None);
}
