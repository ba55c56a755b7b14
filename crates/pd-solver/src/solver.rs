//! The solver that callers hold: built once for a body and its effects, used for many solves.

use crate::adjoint::adjoint;
use crate::constant::FactorSeconds;
use crate::error::SolverError;
use crate::methods::{self, Target};
use crate::problem::Problem;
use crate::solution::{
    Adjoint, AdjointOptions, Method, Solution, SolveOptions, SolveStats, Status, Stop, Work,
};
use crate::spec::{EffectSpec, Parameters, check_array};
use crate::vector::NodalVector;
use hex_mesh::HexMesh;
use nalgebra::Vector3;
use std::time::Instant;

/// Finds quasi-static equilibria of one body under one list of effects, and their derivatives.
///
/// Building it assembles and factors the constant matrix, once. All solves are deterministic: the same input gives the same
/// bits, whatever the number of threads.
pub struct Solver {
    problem: Problem,
    setup_seconds: f64,
}

impl Solver {
    /// Builds the solver.
    ///
    /// # Errors
    /// When an effect is not valid on this mesh, a part of the body is held by nothing, or the factorisation fails.
    pub fn new(mesh: &HexMesh, effects: &[EffectSpec]) -> Result<Self, SolverError> {
        let start = Instant::now();
        let problem = Problem::new(mesh, effects)?;
        let setup_seconds = start.elapsed().as_secs_f64();
        Ok(Self {
            problem,
            setup_seconds,
        })
    }

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

    /// The free nodes, by rising index.
    pub fn free(&self) -> &[u32] {
        self.problem.system.free()
    }

    /// Seconds that building took.
    pub fn setup_seconds(&self) -> f64 {
        self.setup_seconds
    }

    /// Seconds that the parts of building the factor of the constant matrix took; `None` before it was needed.
    pub fn factor_seconds(&self) -> Option<FactorSeconds> {
        self.problem.system.factor_seconds()
    }

    /// One solve with the constant matrix: `out = K^-1 r` on the free nodes, zero on the prescribed ones.
    ///
    /// # Errors
    /// When the arrays do not fit or `r` is not finite.
    pub fn constant_solve(
        &mut self,
        r: &[Vector3<f64>],
        out: &mut NodalVector,
    ) -> Result<(), SolverError> {
        check_positions("right-hand side", r, self.problem.len())?;
        check_positions("out", out, self.problem.len())?;
        self.problem.constant_solve(r, out);
        Ok(())
    }

    /// Work done since the solver was built.
    pub fn work(&self) -> Work {
        self.problem.work
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
        self.problem.set_parameters(parameters);
        Ok(())
    }

    /// Finds the equilibrium reached from `start` (the rest shape where not given; prescribed nodes are moved into place).
    ///
    /// # Errors
    /// When the parameters or the start do not fit or are not finite, or the stopping rule is not a positive number. A solve
    /// that does not converge is no error: see [`Solution::status`].
    pub fn solve(
        &mut self,
        parameters: &Parameters,
        start: Option<&[Vector3<f64>]>,
        options: &SolveOptions,
    ) -> Result<Solution, SolverError> {
        let clock = Instant::now();
        let (Stop::Accuracy(value) | Stop::RelativeGradient(value)) = options.stop;
        if !(value.is_finite() && value > 0.0) {
            return Err(SolverError::BadStop { value });
        }
        let start = start.unwrap_or(&self.problem.rest).to_vec();
        self.take(parameters, &start)?;
        let problem = &mut self.problem;
        let gradient_norm_rest = match options.stop {
            Stop::RelativeGradient(_) => Some(problem.gradient_norm_at_rest(parameters)),
            Stop::Accuracy(_) => None,
        };
        let target = Target {
            accuracy: match options.stop {
                Stop::Accuracy(length) => Some(length),
                Stop::RelativeGradient(_) => None,
            },
            gradient: match (options.stop, gradient_norm_rest) {
                (Stop::RelativeGradient(t), Some(rest)) => t * rest,
                _ => 0.0,
            }
            .max(problem.gradient_floor()),
        };
        let mut u = start;
        problem.impose(parameters, &mut u);
        // Inside the thread pool from here on: every parallel loop would otherwise wake it from outside.
        let mut outcome = rayon::scope(|_| run(problem, options.method, &mut u, &target, options));
        let mut method = options.method;
        let fell_back = outcome.status == Status::Stalled && method == Method::Lbfgs;
        if fell_back {
            method = Method::Newton;
            let done = outcome.iterations;
            let rest = SolveOptions {
                max_iterations: options.max_iterations.saturating_sub(done),
                ..*options
            };
            outcome = rayon::scope(|_| run(problem, method, &mut u, &target, &rest));
            outcome.iterations += done;
        }
        Ok(Solution {
            positions: u,
            status: outcome.status,
            stats: SolveStats {
                iterations: outcome.iterations,
                energy: outcome.energy,
                gradient_norm: outcome.gradient_norm,
                gradient_norm_rest,
                estimated_error: outcome.estimated_error,
                method,
                fell_back,
                work: problem.work,
                seconds: clock.elapsed().as_secs_f64(),
            },
        })
    }

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
        adjoint(&mut self.problem, parameters, solution, cotangent, options)
    }
}

fn check_positions(
    what: &'static str,
    x: &[Vector3<f64>],
    expected: usize,
) -> Result<(), SolverError> {
    check_array(what, x, expected, |v| v.iter().all(|x| x.is_finite()))
}

fn run(
    problem: &mut Problem,
    method: Method,
    u: &mut NodalVector,
    target: &Target,
    options: &SolveOptions,
) -> methods::Outcome {
    match method {
        Method::LocalGlobal => methods::local_global(problem, u, target, options.max_iterations),
        Method::Anderson => methods::anderson(problem, u, target, options.max_iterations),
        Method::Lbfgs => methods::lbfgs(problem, u, target, options.max_iterations),
        Method::Newton => methods::newton(problem, u, target, options.max_iterations),
    }
}
