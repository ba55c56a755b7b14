//! Gradients of losses on the positions that a solve found.

use super::Solver;
use crate::adjoint::{adjoint, linearise_at_equilibrium, refuse};
use crate::error::SolverError;
use crate::methods::Preconditioner;
use crate::parameters::{Parameters, check_array};
use crate::solution::{Adjoint, AdjointOptions, AdjointStatus, Solution};
use nalgebra::Vector3;
use std::time::Instant;

impl Solver {
    /// The gradient of a loss by all parameters, given its gradient `cotangent` by the positions of all nodes at an equilibrium.
    ///
    /// Solves `H_ff z = cotangent_f` with the true Hessian; then `dL/dp = -(d grad/d p)^T z`, and for prescribed positions
    /// `cotangent_p - (H z)_p` (maths.md "Implicit adjoint").
    ///
    /// # Errors
    /// When arrays do not fit. A state that is no equilibrium, negative curvature and the like are a status in the result.
    pub fn adjoint(
        &mut self,
        parameters: &Parameters,
        solution: &Solution,
        cotangent: &[Vector3<f64>],
        options: &AdjointOptions,
    ) -> Result<Adjoint, SolverError> {
        let mut out = Adjoint::default();
        self.adjoint_into(parameters, solution, cotangent, options, &mut out)?;
        Ok(out)
    }

    /// [`Solver::adjoint`] into a result whose memory is used again; with [`AdjointOptions::warm_start`], from its multiplier.
    ///
    /// # Errors
    /// Those of [`Solver::adjoint`].
    pub fn adjoint_into(
        &mut self,
        parameters: &Parameters,
        solution: &Solution,
        cotangent: &[Vector3<f64>],
        options: &AdjointOptions,
        out: &mut Adjoint,
    ) -> Result<(), SolverError> {
        self.adjoints_into(
            parameters,
            solution,
            &[cotangent],
            options,
            std::slice::from_mut(out),
        )
    }

    /// Adjoints of several cotangents at the same state: what depends on the state alone is done once.
    ///
    /// # Errors
    /// Those of [`Solver::adjoint`].
    ///
    /// # Panics
    /// When there is not one result for each cotangent.
    pub fn adjoints_into(
        &mut self,
        parameters: &Parameters,
        solution: &Solution,
        cotangents: &[&[Vector3<f64>]],
        options: &AdjointOptions,
        out: &mut [Adjoint],
    ) -> Result<(), SolverError> {
        assert_eq!(cotangents.len(), out.len(), "one result per cotangent");
        let clock = Instant::now();
        parameters.check(&self.problem.rest_parameters)?;
        let n = self.problem.len();
        check_array("positions", &solution.positions, n, |_| true)?;
        for cotangent in cotangents {
            check_array("cotangent", cotangent, n, |_| true)?;
        }
        if self.cycle.is_none() {
            self.factor()?;
        }
        self.set_parameters(parameters)?;
        rayon::scope(|_| {
            let (problem, space) = (&mut self.problem, &mut self.space);
            let u = &solution.positions;
            if options.allow_unconverged {
                problem.linearise(u);
            } else if !linearise_at_equilibrium(problem, space, solution) {
                for out in out {
                    refuse(out, AdjointStatus::ForwardNotConverged, clock);
                }
                return;
            }
            let pre: &mut dyn Preconditioner = match (&mut self.cycle, &mut self.constant) {
                (Some(cycle), _) => cycle,
                (None, Some(constant)) => constant,
                _ => unreachable!("factored above"),
            };
            pre.prepare(problem, u);
            for (cotangent, out) in cotangents.iter().zip(out) {
                adjoint(problem, pre, space, u, cotangent, options, out);
            }
        });
        Ok(())
    }
}
