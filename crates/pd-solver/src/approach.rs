//! The walk of prescribed nodes and obstacles to where a solve wants them, where contact forbids to put them there at once.
//!
//! They go straight, all by the same share of the way that is left: as far as nothing is passed through, with a part kept in hand. The free nodes
//! go on as they went before where that gives a larger share, and then give way by a few steps of Newton's method, which makes room for the next.

use crate::Solver;
use crate::error::SolverError;
use crate::floating::FloatingPart;
use crate::methods::{Outcome, Target};
use crate::parameters::Parameters;
use crate::problem::Problem;
use crate::solution::{Estimate, Method, SolveOptions, Status};
use crate::spec::EffectSpec;
use crate::vector::{NodalVector, norm};
use hex_mesh::HexMesh;
use nalgebra::Vector3;

/// Share of what may be gone that is gone.
const RESERVE: f64 = 0.8;
/// Newton steps between two shares of the way, at most.
const RELAX: usize = 10;
/// Free nodes that are nearer than this to their equilibrium, in edges of an element, have given way.
const RELAXED: f64 = 0.01;
/// An advance goes at most this many times as far as the one before.
const GROWTH: f64 = 3.0;
/// Shares of the way at most.
const MAX_SHARES: usize = 2000;
/// A share of what is left that gets nowhere, and how many of those in a row end the walk.
const NOWHERE: f64 = 1e-4;
const MAX_NOWHERE: usize = 10;

/// How a walk ended.
pub(crate) struct Walk {
    pub(crate) arrived: bool,
    iterations: usize,
}

/// Refuses parts that float where contact would see them moved to the place that convention gives them.
pub(crate) fn check_floating(
    mesh: &HexMesh,
    floating: &[FloatingPart],
    specs: &[EffectSpec],
) -> Result<(), SolverError> {
    let Some(part) = floating.first() else {
        return Ok(());
    };
    let alone = part.nodes.len() == mesh.nodes().len();
    let refused = specs.iter().position(|spec| match spec {
        EffectSpec::Contact { obstacles, .. } => !alone || !obstacles.is_empty(),
        _ => false,
    });
    let why = "a part that nothing holds has no place of its own to touch another from: hold it by springs or prescribed nodes";
    match refused {
        Some(index) => Err(SolverError::Excluded {
            index,
            kind: "contact",
            why,
        }),
        None => Ok(()),
    }
}

/// Moves obstacles in all effects.
fn set_obstacles(problem: &mut Problem, obstacles: &[Vector3<f64>]) {
    problem.contacts().for_each(|c| c.set_obstacles(obstacles));
}

fn intersection(problem: &mut Problem, u: &[Vector3<f64>]) -> Option<SolverError> {
    problem.contacts().find_map(|c| c.intersection(u))
}

impl Solver {
    /// Brings prescribed nodes and obstacles to where `parameters` have them, from where they are in `start` and where the last solve left them;
    /// from rest where there is no start. Writes the positions reached into `u`.
    pub(crate) fn approach(
        &mut self,
        parameters: &Parameters,
        start: Option<&[Vector3<f64>]>,
        options: &SolveOptions,
        u: &mut NodalVector,
    ) -> Result<Walk, SolverError> {
        let mut obstacles = self.begin(parameters, start, u)?;
        let problem = &self.problem;
        let mut ends = parameters.prescribed.iter().zip(&problem.prescribed);
        let there = ends.all(|(x, &node)| u[node as usize] == *x);
        let mut walk = Walk {
            arrived: there && obstacles == parameters.obstacles,
            iterations: 0,
        };
        let mut nowhere = 0;
        let mut before: Option<(NodalVector, f64)> = None;
        for _ in 0..MAX_SHARES {
            if walk.arrived || nowhere == MAX_NOWHERE || walk.iterations >= options.max_iterations {
                break;
            }
            let last = before.as_ref().map(|(u, share)| (&u[..], *share));
            let here = u.clone();
            let share = self.advance(parameters, u, &mut obstacles, last);
            before = Some((here, share));
            walk.arrived = share == 1.0;
            nowhere = if share < NOWHERE { nowhere + 1 } else { 0 };
            if !walk.arrived {
                walk.iterations += self.relax(u);
            }
        }
        if walk.arrived {
            self.problem.impose(parameters, u);
            obstacles.copy_from_slice(&parameters.obstacles);
            set_obstacles(&mut self.problem, &obstacles);
        }
        self.left_obstacles = obstacles;
        Ok(walk)
    }

    /// Writes the start into `u`, and returns where obstacles are then: where the last solve left them, or else where they are to go, or at rest.
    fn begin(
        &mut self,
        parameters: &Parameters,
        start: Option<&[Vector3<f64>]>,
        u: &mut NodalVector,
    ) -> Result<NodalVector, SolverError> {
        let problem = &mut self.problem;
        let rest = &problem.rest_parameters.obstacles;
        let mut places = vec![rest.clone()];
        match start {
            Some(start) => {
                u.copy_from_slice(start);
                problem.align_floating(u);
                places.insert(0, parameters.obstacles.clone());
                if self.left_obstacles.len() == rest.len() {
                    places.insert(0, self.left_obstacles.clone());
                }
            }
            None => u.copy_from_slice(&problem.rest),
        }
        let mut first = None;
        for obstacles in places {
            set_obstacles(problem, &obstacles);
            match intersection(problem, u) {
                Some(error) => {
                    first.get_or_insert(error);
                }
                None => return Ok(obstacles),
            }
        }
        Err(first.expect("there is a place to begin at"))
    }

    /// Goes as large a share of what is left of the way as is free, and returns it. `before` is where the free nodes were before the last
    /// advance, and the share that it took.
    fn advance(
        &mut self,
        parameters: &Parameters,
        u: &mut NodalVector,
        obstacles: &mut NodalVector,
        before: Option<(&[Vector3<f64>], f64)>,
    ) -> f64 {
        let problem = &mut self.problem;
        let wanted = &parameters.obstacles;
        let limit_to = |problem: &mut Problem, ends: &[Vector3<f64>]| {
            let limits = problem.contacts().map(|c| c.motion_limit(u, ends, wanted));
            limits.fold(1.0, f64::min)
        };
        let mut ends = u.clone();
        problem.impose(parameters, &mut ends);
        let mut limit = limit_to(problem, &ends);
        let mut longest = 1.0;
        if let Some((before, share)) = before.filter(|_| limit < 1.0) {
            // The way that is left, in lengths of the last advance.
            let left = (1.0 - share) / share;
            longest = (GROWTH / left).min(1.0);
            let mut further = u.clone();
            let ways = u.iter().zip(before).map(|(u, before)| (u - before) * left);
            further.iter_mut().zip(ways).for_each(|(x, way)| *x += way);
            problem.impose(parameters, &mut further);
            let of_further = limit_to(problem, &further);
            if of_further > limit {
                (limit, ends) = (of_further, further);
            }
        }
        let share = match limit < 1.0 || longest < 1.0 {
            true => longest.min(RESERVE * limit),
            false => 1.0,
        };
        for (x, end) in u.iter_mut().zip(&ends) {
            *x += (end - *x) * share;
        }
        for (x, end) in obstacles.iter_mut().zip(wanted) {
            *x += (end - *x) * share;
        }
        set_obstacles(problem, obstacles);
        share
    }

    /// Lets the free nodes give way a little; returns the steps taken.
    fn relax(&mut self, u: &mut NodalVector) -> usize {
        let target = Target {
            tell_error: false,
            accuracy: Some(RELAXED * self.problem.element_size),
            gradient: self.problem.gradient_floor(u),
            step: f64::INFINITY,
        };
        self.run_method(Method::Newton, u, &target, RELAX)
            .iterations
    }

    /// Solves after a walk; where that did not arrive, the outcome is where it ended.
    pub(crate) fn run_after(
        &mut self,
        walk: &Walk,
        method: &mut Method,
        u: &mut NodalVector,
        target: &Target,
        limit: usize,
    ) -> Outcome {
        let limit = limit.saturating_sub(walk.iterations);
        if walk.arrived {
            let mut outcome = self.run_with_fallback(method, u, target, limit);
            outcome.iterations += walk.iterations;
            return outcome;
        }
        let (problem, _, space) = self.parts(*method);
        space.reserve(u.len());
        let energy = problem.evaluate(u, &mut space.gradient);
        Outcome {
            status: Status::Stalled,
            iterations: walk.iterations,
            energy,
            gradient_norm: norm(&space.gradient),
            estimated_error: None,
            estimate: Estimate::None,
        }
    }
}
