//! The two preconditioners of the body itself: the factored constant matrix, and the multigrid cycle.

use crate::constant::ConstantSystem;
use crate::methods::Preconditioner;
use crate::multigrid::{Curvature, Multigrid};
use crate::vector::NodalVector;
use nalgebra::Vector3;

/// How far a node may be from where it was when the cycle was built, in edges of an element, for the cycle to be used as it is.
const NEAR: f64 = 0.5;

/// Share of elements without a neighbour on either side along some axis above which a body counts as thin.
const THIN: f64 = 0.1;

impl Preconditioner for ConstantSystem {
    fn apply(&mut self, r: &[Vector3<f64>], z: &mut NodalVector) {
        self.solve(r, z);
    }

    fn follows(&self) -> bool {
        false
    }

    fn tells_errors(&self) -> bool {
        false
    }

    fn prepare(&mut self, _u: &[Vector3<f64>]) -> bool {
        true
    }

    fn rebuild(&mut self, _u: &[Vector3<f64>]) {}

    fn project(&mut self, _u: &[Vector3<f64>]) -> bool {
        false
    }

    fn strengthen(&mut self, _u: &[Vector3<f64>]) -> bool {
        false
    }
}

/// The multigrid of a body, and where its finest level was built.
pub(crate) struct Cycle {
    pub(crate) multigrid: Multigrid,
    built_at: NodalVector,
    curvature: Curvature,
    element_size: f64,
    /// Much of the body is one element thick. It bends by modes that the cycle sees only as constant stiffness, several times too
    /// stiff.
    thin: bool,
}

impl Cycle {
    pub(crate) fn new(multigrid: Multigrid, element_size: f64) -> Self {
        Self {
            thin: multigrid.hierarchy().grids[0].thin_share() > THIN,
            multigrid,
            built_at: Vec::new(),
            curvature: Curvature::True,
            element_size,
        }
    }

    /// Says that the coarse levels were built for something else since. The true Hessian is to be tried again.
    pub(crate) fn forget(&mut self) {
        self.built_at.clear();
        self.curvature = Curvature::True;
    }
}

impl Preconditioner for Cycle {
    fn apply(&mut self, r: &[Vector3<f64>], z: &mut NodalVector) {
        self.multigrid.apply(0, r, z);
    }

    fn follows(&self) -> bool {
        true
    }

    fn tells_errors(&self) -> bool {
        !self.thin
    }

    fn prepare(&mut self, u: &[Vector3<f64>]) -> bool {
        let limit = NEAR * self.element_size;
        let near = |(a, b): (&Vector3<f64>, &Vector3<f64>)| (a - b).norm_squared() <= limit * limit;
        let far = self.built_at.len() != u.len() || !self.built_at.iter().zip(u).all(near);
        if far {
            self.rebuild(u);
        }
        far
    }

    fn rebuild(&mut self, u: &[Vector3<f64>]) {
        if !self.multigrid.build(0, u, self.curvature) {
            self.project(u);
        }
        self.built_at.clear();
        self.built_at.extend_from_slice(u);
    }

    fn project(&mut self, u: &[Vector3<f64>]) -> bool {
        let was_true = self.curvature == Curvature::True;
        if was_true {
            self.curvature = Curvature::Projected;
            self.rebuild(u);
        }
        was_true
    }

    fn strengthen(&mut self, u: &[Vector3<f64>]) -> bool {
        if !self.project(u) {
            self.multigrid.strengthen(0);
        }
        true
    }
}
