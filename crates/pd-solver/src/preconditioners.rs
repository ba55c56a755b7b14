//! The two preconditioners of the body itself: the factored constant matrix, and the multigrid cycle.

use crate::constant::ConstantSystem;
use crate::methods::Preconditioner;
use crate::multigrid::{Form, Multigrid};
use crate::problem::Problem;
use crate::vector::{NodalVector, all_pairs};
use nalgebra::Vector3;

/// How far a node may be from where it was when the cycle was built, in edges of an element, for the cycle to be used as it is.
const NEAR: f64 = 0.5;

/// Share of elements without a neighbour on either side along some axis above which a body counts as thin.
const THIN: f64 = 0.1;

impl Preconditioner for ConstantSystem {
    fn apply(&mut self, r: &[Vector3<f64>], z: &mut NodalVector) {
        self.solve(r, z);
    }
}

/// The multigrid of a body, and where its finest level was built.
pub(crate) struct Cycle {
    pub(crate) multigrid: Multigrid,
    built_at: NodalVector,
    element_size: f64,
    /// Much of the body is one element thick. It bends by modes that the cycle sees only as constant stiffness, several times too
    /// stiff.
    thin: bool,
    /// Whether anything touched where it was built.
    touched: bool,
    /// The multigrid does not have the last actuation yet: a solve that gets by without building it does not ask for its means.
    outdated: bool,
}

impl Cycle {
    pub(crate) fn new(multigrid: Multigrid, element_size: f64) -> Self {
        Self {
            thin: multigrid.hierarchy().grids[0].thin_share() > THIN,
            multigrid,
            built_at: Vec::new(),
            element_size,
            touched: false,
            outdated: true,
        }
    }

    /// Says that the coarse levels were built for something else since. The true Hessian is to be tried again.
    pub(crate) fn forget(&mut self) {
        self.built_at.clear();
        self.multigrid.trust(0);
    }

    /// Says that the problem has another actuation.
    pub(crate) fn actuate(&mut self) {
        self.outdated = true;
    }

    /// Gives the multigrid the actuation that the problem has.
    pub(crate) fn refresh(&mut self, problem: &Problem) {
        if std::mem::take(&mut self.outdated) {
            self.multigrid
                .set_actuation(|out| problem.mean_actuation(out));
        }
    }

    fn build(&mut self, problem: &Problem, u: &[Vector3<f64>]) {
        self.refresh(problem);
        self.multigrid.rebuild(0, u);
        self.built_at.clear();
        self.built_at.extend_from_slice(u);
    }

    /// What touches at `u`, if that is anything, or was where this was last built. Barriers bend so much that no two states are alike.
    fn touches(&mut self, problem: &mut Problem, u: &[Vector3<f64>]) -> Option<Vec<Form>> {
        let touches = problem.touches(u);
        let before = std::mem::replace(&mut self.touched, !touches.is_empty());
        (before || self.touched).then_some(touches)
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

    fn prepare(&mut self, problem: &mut Problem, u: &[Vector3<f64>]) -> bool {
        let limit = NEAR * self.element_size;
        let near = |a: &Vector3<f64>, b: &Vector3<f64>| (a - b).norm_squared() <= limit * limit;
        let far = !all_pairs(&self.built_at, u, near);
        match self.touches(problem, u) {
            Some(touches) if !far => {
                self.refresh(problem);
                self.multigrid.touch(touches, u);
            }
            Some(touches) => {
                self.multigrid.set_touches(touches);
                self.build(problem, u);
            }
            None if far => self.build(problem, u),
            None => {}
        }
        far
    }

    fn rebuild(&mut self, problem: &mut Problem, u: &[Vector3<f64>]) {
        if let Some(touches) = self.touches(problem, u) {
            self.multigrid.set_touches(touches);
        }
        self.build(problem, u);
    }

    fn project(&mut self, problem: &Problem, u: &[Vector3<f64>]) -> bool {
        self.refresh(problem);
        self.multigrid.project(0, u)
    }

    fn strengthen(&mut self, problem: &Problem, u: &[Vector3<f64>]) -> bool {
        self.refresh(problem);
        self.multigrid.strengthen(0, u);
        true
    }
}

#[cfg(test)]
mod tests;
