//! What callers ask of a solver beside equilibria: its body, its energy, the work done.

use super::{Solver, check_positions};
use crate::constant::{ConstantSystem, FactorSeconds};
use crate::effects::ContactReport;
use crate::error::SolverError;
use crate::parameters::Parameters;
use crate::problem::Problem;
use crate::solution::Work;
use crate::vector::NodalVector;
use nalgebra::Vector3;

impl Solver {
    /// Parameters that leave the body at rest (but for gravity): no actuation, prescribed nodes and springs at rest.
    pub fn rest_parameters(&self) -> Parameters {
        self.problem.rest_parameters.clone()
    }

    /// Rest positions of all nodes.
    pub fn rest(&self) -> &[Vector3<f64>] {
        &self.problem.rest
    }

    /// The prescribed nodes, in the order of [`Parameters::prescribed`].
    pub fn prescribed(&self) -> &[u32] {
        &self.problem.prescribed
    }

    pub(crate) fn problem(&self) -> &Problem {
        &self.problem
    }

    pub(crate) fn problem_mut(&mut self) -> &mut Problem {
        &mut self.problem
    }

    /// The free nodes, by rising index.
    pub fn free(&self) -> &[u32] {
        &self.free
    }

    /// Seconds that building took.
    pub fn setup_seconds(&self) -> f64 {
        self.setup_seconds
    }

    /// Elements of the body and of each coarser one that the solver works on.
    pub fn levels(&self) -> Vec<usize> {
        let grids = self
            .cycle
            .iter()
            .flat_map(|c| &c.multigrid.hierarchy().grids);
        let mut counts: Vec<usize> = grids.map(|g| g.elements.len()).collect();
        if counts.is_empty() {
            counts.push(self.problem.elements);
        }
        counts
    }

    /// Seconds that the parts of building the factor of the constant matrix took; `None` before a method needed it.
    pub fn factor_seconds(&self) -> Option<FactorSeconds> {
        self.constant.as_ref().map(ConstantSystem::seconds)
    }

    /// One solve with the constant matrix, which is factored if it was not yet: `out = K^-1 r` on the free nodes, zero on the
    /// prescribed ones.
    ///
    /// # Errors
    /// When the arrays do not fit, `r` is not finite, or the factorisation fails.
    pub fn constant_solve(
        &mut self,
        r: &[Vector3<f64>],
        out: &mut NodalVector,
    ) -> Result<(), SolverError> {
        check_positions("right-hand side", r, self.problem.len())?;
        check_positions("out", out, self.problem.len())?;
        self.factor()?;
        if let Some(constant) = &mut self.constant {
            constant.solve(r, out);
        }
        Ok(())
    }

    /// Work done since the solver was built.
    pub fn work(&self) -> Work {
        let mut work = self.problem.work;
        work.contact_queries = self.problem.queries();
        if let Some(constant) = &self.constant {
            work.factorisations = 1;
            work.matrix_nonzeros = constant.nonzeros();
            work.factor_entries = constant.factor_entries();
            work.constant_solves = constant.solves();
        }
        if let Some(cycle) = &self.cycle {
            work.multigrid_builds = cycle.multigrid.builds;
            work.multigrid_cycles = cycle.multigrid.cycles;
        }
        work
    }

    /// What each contact effect sees at the positions `u` `[nodes]`, with obstacles where the last call put them.
    ///
    /// # Errors
    /// When the positions do not fit or are not finite.
    pub fn contact_reports(
        &mut self,
        u: &[Vector3<f64>],
    ) -> Result<Vec<ContactReport>, SolverError> {
        check_positions("positions", u, self.problem.len())?;
        let contacts = self.problem.contacts();
        Ok(contacts.filter_map(|c| c.contact_report(u)).collect())
    }

    /// Energy and its gradient at `u` `[nodes]`; the gradient is zero at prescribed nodes, whose positions are taken from `u`.
    ///
    /// # Errors
    /// When the parameters or positions do not fit or are not finite.
    pub fn energy_gradient(
        &mut self,
        parameters: &Parameters,
        u: &[Vector3<f64>],
    ) -> Result<(f64, NodalVector), SolverError> {
        self.take(parameters, u)?;
        let mut gradient = vec![Vector3::zeros(); u.len()];
        let energy = self.problem.evaluate(u, &mut gradient);
        Ok((energy, gradient))
    }

    /// The product `H x` of the true Hessian at `u` with `x` `[nodes]`, all rows included.
    ///
    /// # Errors
    /// When the parameters or positions do not fit or are not finite.
    pub fn hessian_product(
        &mut self,
        parameters: &Parameters,
        u: &[Vector3<f64>],
        x: &[Vector3<f64>],
    ) -> Result<NodalVector, SolverError> {
        self.take(parameters, u)?;
        check_positions("direction", x, self.problem.len())?;
        self.problem.linearise(u);
        let mut out = vec![Vector3::zeros(); u.len()];
        self.problem.full_hessian_product(x, &mut out);
        Ok(out)
    }

    fn take(&mut self, parameters: &Parameters, u: &[Vector3<f64>]) -> Result<(), SolverError> {
        parameters.check(&self.problem.rest_parameters)?;
        check_positions("positions", u, self.problem.len())?;
        self.set_parameters(parameters)
    }
}
