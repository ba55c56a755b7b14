//! The solver that callers hold: built once for a body and its effects, used for many solves.

mod adjoints;
mod ended;
mod queries;

use crate::constant::ConstantSystem;
use crate::error::SolverError;
use crate::methods::coarse_to_fine::{self, CoarseBody, carry_down};
use crate::methods::{
    Outcome, Preconditioner, Target, Workspace, anderson, lbfgs, local_global, newton,
};
use crate::multigrid::Hierarchy;
use crate::parameters::{Parameters, check_array};
use crate::preconditioners::Cycle;
use crate::problem::Problem;
use crate::solution::{Method, Solution, SolveOptions, SolveStats, Status, Stop, Work};
use crate::spec::EffectSpec;
use crate::surface::EmbeddedSurface;
use crate::vector::{NodalVector, norm};
use ended::Ended;
use hex_mesh::HexMesh;
use nalgebra::Vector3;
use std::time::Instant;

/// Bodies of fewer elements are solved with the constant matrix unless multigrid is asked for: factoring it costs nothing then.
const SMALL: usize = 400;

/// Finds quasi-static equilibria of one body under one list of effects, and their derivatives.
///
/// Building it prepares the multigrid hierarchy of the body, or, for bodies too small for one, factors the constant matrix. All
/// solves are deterministic: the same calls give the same bits, whatever the number of threads. After the first solve and the
/// first adjoint, [`Solver::solve_into`] and [`Solver::adjoint_into`] allocate nothing that grows with the body.
pub struct Solver {
    pub(crate) problem: Problem,
    /// Grids that no multigrid was made of yet.
    hierarchy: Option<Hierarchy>,
    cycle: Option<Cycle>,
    coarse: Vec<CoarseBody>,
    /// Factored when a method first needs it.
    constant: Option<ConstantSystem>,
    space: Workspace,
    free: Vec<u32>,
    setup_seconds: f64,
    ended: Ended,
    /// Where the last solve left the vertices of obstacles.
    pub(crate) left_obstacles: NodalVector,
}

impl Solver {
    /// Builds the solver.
    ///
    /// # Errors
    /// When an effect is not valid on this mesh, a part of the body is held by nothing and may not float, or a factorisation fails.
    pub fn new(mesh: &HexMesh, effects: &[EffectSpec]) -> Result<Self, SolverError> {
        Self::build(mesh, None, effects)
    }

    /// Builds the solver of a body with a surface that hangs on it, for effects that act there.
    ///
    /// # Errors
    /// As [`Solver::new`], and when the surface does not fit the mesh.
    pub fn on_surface(
        mesh: &HexMesh,
        surface: &EmbeddedSurface,
        effects: &[EffectSpec],
    ) -> Result<Self, SolverError> {
        Self::build(mesh, Some(surface), effects)
    }

    fn build(
        mesh: &HexMesh,
        surface: Option<&EmbeddedSurface>,
        effects: &[EffectSpec],
    ) -> Result<Self, SolverError> {
        let start = Instant::now();
        let problem = Problem::new(mesh, surface, effects)?;
        let mut solver = Self {
            free: problem.free(),
            problem,
            hierarchy: None,
            cycle: None,
            coarse: Vec::new(),
            constant: None,
            space: Workspace::default(),
            setup_seconds: 0.0,
            ended: Ended::default(),
            left_obstacles: NodalVector::new(),
        };
        solver.hierarchy = Hierarchy::new(
            mesh,
            &solver.problem.prescribed,
            solver.problem.stiffness.as_deref(),
        );
        if mesh.elements().len() < SMALL || !solver.add_cycle() {
            solver.factor()?;
        }
        solver.setup_seconds = start.elapsed().as_secs_f64();
        Ok(solver)
    }

    /// The nodes that effects prescribe on a mesh, in the order of [`Parameters::prescribed`], without building a solver.
    ///
    /// # Errors
    /// When a set of nodes is not valid on this mesh.
    pub fn prescribed_by(mesh: &HexMesh, effects: &[EffectSpec]) -> Result<Vec<u32>, SolverError> {
        let mut nodes = Vec::new();
        for (index, effect) in effects.iter().enumerate() {
            if let EffectSpec::Prescribed { nodes: set } = effect {
                nodes.extend(set.resolve(mesh, index)?);
            }
        }
        Ok(nodes)
    }

    /// Sets up the multigrid unless that was done before; false where the body has no hierarchy.
    fn add_cycle(&mut self) -> bool {
        if let Some(hierarchy) = self.hierarchy.take() {
            let (multigrid, coarse) = carry_down(&self.problem, hierarchy);
            self.cycle = Some(Cycle::new(multigrid, self.problem.element_size));
            self.coarse = coarse;
        }
        self.cycle.is_some()
    }

    /// Factors the constant matrix unless that was done before.
    fn factor(&mut self) -> Result<(), SolverError> {
        if self.constant.is_none() {
            self.constant = Some(self.problem.constant_system()?);
        }
        Ok(())
    }

    /// Takes over parameters that were checked but for the entries of their actuation.
    fn set_parameters(&mut self, parameters: &Parameters) -> Result<(), SolverError> {
        let given = parameters;
        let mut activation = self.problem.activation.take();
        let parameters = match &mut activation {
            Some(activation) => activation.apply(parameters),
            None => parameters,
        };
        self.problem.set_parameters(parameters);
        if let Some(cycle) = &mut self.cycle {
            cycle.actuate();
        }
        self.problem.activation = activation;
        match self.problem.actuation_is_finite() {
            true => Ok(()),
            false => given.check_actuation(),
        }
    }

    /// Finds the equilibrium reached from `start` (the rest shape where not given; prescribed nodes are moved into place).
    ///
    /// # Errors
    /// When the parameters or the start do not fit or are not finite, the stopping rule is not a positive number, or, with contact, the start
    /// passes through itself or an obstacle ([`SolverError::Intersects`]). With contact, prescribed nodes and obstacles are brought to their
    /// places along straight lines, from where the start and the last solve have them; where something that does not give way stands between,
    /// the solve ends as [`Status::Stalled`] before it, and nothing passes through anything. A solve
    /// that does not converge is no error: see [`Solution::status`].
    pub fn solve(
        &mut self,
        parameters: &Parameters,
        start: Option<&[Vector3<f64>]>,
        options: &SolveOptions,
    ) -> Result<Solution, SolverError> {
        let mut solution = Solution::default();
        self.solve_into(parameters, start, options, &mut solution)?;
        Ok(solution)
    }

    /// [`Solver::solve`] into a solution whose memory is used again. Without a start, what it holds does not matter.
    ///
    /// # Errors
    /// Those of [`Solver::solve`]; `solution` is then unchanged, but for its positions where the start passes through something.
    pub fn solve_into(
        &mut self,
        parameters: &Parameters,
        start: Option<&[Vector3<f64>]>,
        options: &SolveOptions,
        solution: &mut Solution,
    ) -> Result<(), SolverError> {
        let clock = Instant::now();
        let local = self.problem.local_time;
        let (Stop::Accuracy(value) | Stop::RelativeGradient(value)) = options.stop;
        if !(value.is_finite() && value > 0.0) {
            return Err(SolverError::BadStop { value });
        }
        parameters.check(&self.problem.rest_parameters)?;
        if let Some(start) = start {
            check_positions("positions", start, self.problem.len())?;
        }
        let method = self.choose(options.method)?;
        self.set_parameters(parameters)?;
        let u = &mut solution.positions;
        u.resize(self.problem.len(), Vector3::zeros());
        // Inside the thread pool from here on: every parallel loop would otherwise wake it from outside.
        let stats = rayon::scope(|_| self.run(parameters, start, options, method, u));
        let (status, stats) = stats?;
        solution.status = status;
        solution.stats = SolveStats {
            work: self.work(),
            seconds: clock.elapsed().as_secs_f64(),
            local_seconds: (self.problem.local_time - local).as_secs_f64(),
            ..stats
        };
        Ok(())
    }

    /// The method that is run for the one asked for, with what it needs in place.
    fn choose(&mut self, asked: Method) -> Result<Method, SolverError> {
        let asked = match asked {
            Method::Automatic if self.problem.limits_steps() => Method::Newton,
            Method::LocalGlobal | Method::Anderson if !self.problem.is_bounded() => Method::Lbfgs,
            other => other,
        };
        let multigrid = match asked {
            Method::Automatic => self.cycle.is_some(),
            Method::Multigrid => self.add_cycle(),
            _ => false,
        };
        let method = match asked {
            _ if multigrid => Method::Multigrid,
            Method::Automatic | Method::Multigrid => Method::Lbfgs,
            other => other,
        };
        let constant = match method {
            Method::LocalGlobal | Method::Anderson | Method::Lbfgs => true,
            Method::Newton => self.cycle.is_none(),
            _ => false,
        };
        if constant {
            self.factor()?;
        }
        Ok(method)
    }

    fn run(
        &mut self,
        parameters: &Parameters,
        start: Option<&[Vector3<f64>]>,
        options: &SolveOptions,
        mut method: Method,
        u: &mut NodalVector,
    ) -> Result<(Status, SolveStats), SolverError> {
        self.space.energy_at_start = None;
        let goes_on = (self.ended).leave(start, parameters, &mut self.space.last_gradient);
        self.space.predict = goes_on && options.reuse && method == Method::Multigrid;
        if let Some(cycle) = &mut self.cycle
            && !(options.reuse && start.is_some())
        {
            cycle.forget();
        }
        let (rest_energy, rest_gradient) = match (options.stop, start, method) {
            (Stop::Accuracy(_), Some(_), _) => (f64::INFINITY, None),
            (Stop::Accuracy(_), None, m) if m != Method::Multigrid || self.coarse.is_empty() => {
                (f64::INFINITY, None)
            }
            _ => {
                u.copy_from_slice(&self.problem.rest);
                self.problem.impose(parameters, u);
                self.space.reserve(u.len());
                if self.problem.limits_steps() {
                    let gradient = &mut self.space.gradient;
                    let norm = self.problem.gradient_norm_apart(u, gradient);
                    (f64::INFINITY, Some(norm))
                } else {
                    let energy = self.problem.evaluate_at_rest(u, &mut self.space.gradient);
                    (energy, Some(norm(&self.space.gradient)))
                }
            }
        };
        let mut coarse_iterations = 0;
        match (start, method, &mut self.cycle) {
            (Some(start), ..) => {
                u.copy_from_slice(start);
                self.problem.align_floating(u);
                self.problem.impose(parameters, u);
            }
            (None, Method::Multigrid, Some(cycle)) if !self.coarse.is_empty() => {
                cycle.refresh(&self.problem);
                let (coarse, rest) = (&mut self.coarse, &self.problem.rest);
                coarse_iterations =
                    coarse_to_fine::start(coarse, &mut cycle.multigrid, parameters, rest, u);
                cycle.forget();
                self.problem.impose(parameters, u);
                // A coarse body can fold where the fine one does not; such a start is worse than none.
                let energy = self.problem.evaluate(u, &mut self.space.gradient);
                if energy < rest_energy {
                    self.space.energy_at_start = Some(energy);
                } else {
                    u.copy_from_slice(&self.problem.rest);
                    self.problem.impose(parameters, u);
                }
            }
            _ => {
                u.copy_from_slice(&self.problem.rest);
                self.problem.impose(parameters, u);
            }
        }
        let approached = match self.problem.limits_steps() {
            true => Some(self.approach(parameters, start, options, u)?),
            false => None,
        };
        let floor = self.problem.gradient_floor(u);
        let target = match options.stop {
            Stop::Accuracy(length) => Target {
                tell_error: true,
                accuracy: Some(length),
                gradient: floor,
                step: f64::INFINITY,
            },
            Stop::RelativeGradient(t) => Target {
                tell_error: true,
                accuracy: None,
                gradient: (t * rest_gradient.unwrap_or(0.0)).max(floor),
                step: f64::INFINITY,
            },
        };
        let limit = options.max_iterations;
        let asked = method;
        let mut outcome = match &approached {
            Some(walk) => self.run_after(walk, &mut method, u, &target, limit),
            None => self.run_with_fallback(&mut method, u, &target, limit),
        };
        let mut negative_curvature = None;
        let arrived = approached.is_none_or(|walk| walk.arrived);
        if arrived && (options.leave_saddles || self.may_be_saddle(method, u, &outcome)) {
            negative_curvature = self.leave_saddles(&mut method, u, &target, limit, &mut outcome);
        }
        if arrived && options.measure_error {
            self.measure(method, u, target, limit, &mut outcome);
        }
        self.problem.align_floating(u);
        let overflowed = !(outcome.energy.is_finite() && outcome.gradient_norm.is_finite());
        if overflowed || (outcome.status == Status::Stalled && self.problem.ran_away(u)) {
            outcome.status = Status::NotFinite;
        }
        let gradient = &mut self.space.gradient;
        // Not every way to an end leaves the gradient there.
        let left = self.cycle.is_some() && norm(gradient) == outcome.gradient_norm;
        if left && outcome.status == Status::Converged {
            self.ended.keep(u, gradient, parameters);
            self.problem.remember_parameters();
        }
        let stats = SolveStats {
            iterations: outcome.iterations,
            coarse_iterations,
            energy: outcome.energy,
            gradient_norm: outcome.gradient_norm,
            gradient_norm_rest: match options.stop {
                Stop::RelativeGradient(_) => rest_gradient,
                Stop::Accuracy(_) => None,
            },
            estimated_error: outcome.estimated_error,
            estimate: outcome.estimate,
            method,
            fell_back: method != asked,
            negative_curvature,
            work: Work::default(),
            seconds: 0.0,
            local_seconds: 0.0,
        };
        Ok((outcome.status, stats))
    }

    /// Runs a method, and Newton where it stalls; `method` is then that.
    pub(crate) fn run_with_fallback(
        &mut self,
        method: &mut Method,
        u: &mut NodalVector,
        target: &Target,
        limit: usize,
    ) -> Outcome {
        let mut outcome = self.run_method(*method, u, target, limit);
        if outcome.status == Status::Stalled && matches!(method, Method::Lbfgs | Method::Multigrid)
        {
            *method = Method::Newton;
            let done = outcome.iterations;
            outcome = self.run_method(*method, u, target, limit.saturating_sub(done));
            outcome.iterations += done;
        }
        outcome
    }

    pub(crate) fn run_method(
        &mut self,
        method: Method,
        u: &mut NodalVector,
        target: &Target,
        limit: usize,
    ) -> Outcome {
        let run = match method {
            Method::LocalGlobal => local_global,
            Method::Anderson => anderson,
            Method::Newton => newton,
            _ => lbfgs,
        };
        let (problem, pre, space) = self.parts(method);
        run(problem, pre, space, u, target, limit)
    }

    /// What a method works with; its preconditioner was built when it was chosen.
    pub(crate) fn parts(
        &mut self,
        method: Method,
    ) -> (&mut Problem, &mut dyn Preconditioner, &mut Workspace) {
        let by_cycle = matches!(method, Method::Multigrid | Method::Newton);
        let pre: &mut dyn Preconditioner = match (&mut self.cycle, &mut self.constant) {
            (Some(cycle), _) if by_cycle => cycle,
            (_, Some(constant)) => constant,
            _ => unreachable!("a method is chosen before it is run"),
        };
        (&mut self.problem, pre, &mut self.space)
    }
}

pub(crate) fn check_positions(
    what: &'static str,
    x: &[Vector3<f64>],
    expected: usize,
) -> Result<(), SolverError> {
    check_array(what, x, expected, |v| v.iter().all(|x| x.is_finite()))
}
