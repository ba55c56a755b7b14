//! L-BFGS whose initial Hessian is a preconditioner: the constant matrix (Liu, Bouaziz, Kavan 2017), or a multigrid cycle on the
//! projected Hessian that is built anew now and then.

use super::descent::Descent;
use super::newton::{CONTRACTS, newton_direction, newton_step};
use super::workspace::{HISTORY, Pair};
use super::{Outcome, Preconditioner, Target, Workspace};
use crate::krylov::LinearStatus;
use crate::problem::Problem;
use crate::solution::{Estimate, Status};
use crate::vector::{NodalVector, axpy_dot, difference, dot, max_norm, norm};
use nalgebra::Vector3;

/// Steps after which a preconditioner that follows the state is built anew.
const REBUILD: usize = 10;
/// What the length of a Newton step is multiplied by where there was cause for doubt: the curvature may change over it.
const SAFETY: f64 = 2.0;
/// Pairs that must be there before the direction says anything of the error. Without any, a direction by the constant matrix is one
/// local/global step, which underestimates the error by as much as that method is slow; one by a cycle does not know yet where the
/// true Hessian is softer than the projected one.
const TRUSTED_HISTORY: usize = 3;
const TRUSTED_HISTORY_OF_CYCLE: usize = 2;
/// Steps after which a method whose preconditioner follows the state gives up: it creeps along a valley that is flat by the true Hessian, where
/// Newton steps are long.
const PATIENCE: usize = 500;
/// Residual of the Newton step that verifies an error estimate; and where the preconditioner is blind to something soft, for which only
/// a small residual speaks.
const VERIFIED: f64 = 0.1;
const VERIFIED_BLINDLY: f64 = 2e-3;
/// How often a preconditioner is made safer before the method gives up.
const STRENGTHENINGS: usize = 3;
/// How many times longer than the direction the error before a step may be.
const SHORT: f64 = 1.7;
/// Gradient, in units of the one asked for, from which a Newton step ends a solve whose error no direction will tell: it arrives in the time
/// of the steps that are left, and the estimate comes with it.
const ENDGAME: f64 = 10.0;
/// Residual that such a step leaves of the gradient, in units of the one asked for.
const ENDGAME_RESIDUAL: f64 = 0.5;
/// Share of the error that is reported to be left after it; 0.05 to 0.34 were measured.
const ENDGAME_REMAINS: f64 = 0.5;
/// What a step may leave of the error whose estimate was its length. Measured on boxes from 8,000 to 250,000 elements at all
/// tolerances, the error before a step is 1.0 to 1.7 times its length, and 0.1 to 0.4 times it after.
const REMAINS: f64 = 0.6;

/// The pairs of the last steps in a ring.
struct History {
    /// Pairs pushed since the last clearing.
    count: usize,
}

impl History {
    fn len(&self) -> usize {
        self.count.min(HISTORY)
    }

    /// Places of the pairs in the ring, oldest first.
    fn places(&self) -> impl DoubleEndedIterator<Item = usize> + use<> {
        (self.count - self.len()..self.count).map(|i| i % HISTORY)
    }

    /// The place of the pair before that at `place`.
    fn before(&self, place: usize) -> Option<usize> {
        self.places().take_while(|&p| p != place).last()
    }

    /// The place of the pair after that at `place`.
    fn after(&self, place: usize) -> Option<usize> {
        self.places().skip_while(|&p| p != place).nth(1)
    }

    /// `direction = B^-1 gradient` with the quasi-Newton approximation B, by the two-loop recursion.
    fn direction(&self, pre: &mut dyn Preconditioner, space: &mut Workspace) {
        let Some(newest) = self.places().next_back() else {
            return pre.apply(&space.gradient, &mut space.direction);
        };
        space.scratch.copy_from_slice(&space.gradient);
        let mut alphas = [0.0; HISTORY];
        let mut product = dot(&space.history[newest].s, &space.scratch);
        for place in self.places().rev() {
            let pair = &space.history[place];
            alphas[place] = pair.rho * product;
            let next = self.before(place).map(|older| &space.history[older].s[..]);
            product = axpy_dot(-alphas[place], &pair.y, &mut space.scratch, next);
        }
        pre.apply(&space.scratch, &mut space.direction);
        let oldest = self.places().next().expect("there is a newest");
        let mut product = dot(&space.history[oldest].y, &space.direction);
        for place in self.places() {
            let pair = &space.history[place];
            let factor = alphas[place] - pair.rho * product;
            let next = self.after(place).map(|newer| &space.history[newer].y[..]);
            product = axpy_dot(factor, &pair.s, &mut space.direction, next);
        }
    }

    /// Keeps the last step to `u`; false where its product with the change of the gradient is not safely positive.
    fn push(&mut self, space: &mut Workspace, u: &[Vector3<f64>]) -> bool {
        let place = self.count % HISTORY;
        if space.history.len() <= place {
            space.history.push(Pair::default());
        }
        let pair = &mut space.history[place];
        pair.reserve(u.len());
        difference(u, &space.last, &mut pair.s);
        difference(&space.gradient, &space.last_gradient, &mut pair.y);
        let sy = dot(&pair.s, &pair.y);
        let positive = sy > f64::EPSILON * norm(&pair.s) * norm(&pair.y);
        // A full ring still counts this place as its oldest pair, so one that is not kept must not act.
        pair.rho = if positive { 1.0 / sy } else { 0.0 };
        self.count += usize::from(positive);
        positive
    }
}

/// Steps that the rate of convergence is measured over.
const RATE_STEPS: usize = 3;
/// Mean factor from one direction's length to the next above which convergence is called slow: some soft direction is not yet
/// known to the preconditioner and the pairs, and may hide most of the error.
const SLOW: f64 = 0.4;
/// Mean factor up to which what all further directions add up to is told by a geometric series, times `SAFETY`.
const STEADY: f64 = 0.7;

/// What is known of the error estimate while iterating.
#[derive(Default)]
struct Doubts {
    /// The last step met negative curvature.
    negative_curvature: bool,
    /// Lengths of the last directions, newest first.
    lengths: [Option<f64>; RATE_STEPS + 1],
    /// Directions so far: where the first preconditioner did not suffice, convergence is slow as well.
    seen: usize,
}

impl Doubts {
    fn see(&mut self, length: f64) {
        self.lengths.rotate_right(1);
        self.lengths[0] = Some(length);
        self.seen += 1;
    }

    /// Mean factor between the lengths of the last directions; absent where there were too few.
    fn rate(&self) -> Option<f64> {
        let (last, first) = (self.lengths[0]?, self.lengths[RATE_STEPS]?);
        Some((last / first).powf(1.0 / RATE_STEPS as f64))
    }

    /// Whether the directions tell the error at all: by the length of the last one, where convergence is not slow.
    fn directions_tell(
        &self,
        problem: &Problem,
        u: &[Vector3<f64>],
        pre: &dyn Preconditioner,
    ) -> bool {
        let [Some(last), before, ..] = self.lengths else {
            return false;
        };
        let growing = before.is_some_and(|before| last > before);
        let tired = self.seen > REBUILD;
        // Measured on boxes that keep their volume, errors are twice what the directions tell, and more.
        let keeps_volume = problem.volume_stiffness() > 0.0;
        let doubtful =
            !pre.tells_errors() || keeps_volume || self.negative_curvature || growing || tired;
        !doubtful && problem.inverted_samples(u) == 0
    }

    fn slow(&self) -> bool {
        self.rate().is_some_and(|rate| rate > SLOW)
    }

    /// The error after the last step, where the directions tell it.
    fn remainder(
        &self,
        problem: &Problem,
        u: &[Vector3<f64>],
        pre: &dyn Preconditioner,
    ) -> Option<(f64, Estimate)> {
        let last = self.lengths[0]?;
        // Directions that were not slow yet, or too few to tell, leave a share of the last one; steadily shorter ones a series.
        let rate = self.rate().filter(|_| self.slow()).unwrap_or(0.0);
        if rate >= STEADY || !self.directions_tell(problem, u, pre) {
            return None;
        }
        let series = SAFETY * rate / (1.0 - rate);
        Some(if series > REMAINS {
            (last * series, Estimate::Extrapolation)
        } else {
            (last * REMAINS, Estimate::Direction)
        })
    }

    /// Whether the length of the last direction may be taken for the error.
    fn none(&self, problem: &Problem, u: &[Vector3<f64>], pre: &dyn Preconditioner) -> bool {
        !self.slow() && self.directions_tell(problem, u, pre)
    }
}

pub(crate) fn lbfgs(
    problem: &mut Problem,
    pre: &mut dyn Preconditioner,
    space: &mut Workspace,
    u: &mut NodalVector,
    target: &Target,
    max_iterations: usize,
) -> Outcome {
    let mut descent = Descent::start(problem, space, u);
    let mut history = History { count: 0 };
    let mut doubts = Doubts::default();
    let mut estimate = None;
    // What a Newton step near the end told: the error that it left, provided that the gradient fell to this.
    let (mut ended, mut told) = (false, None);
    let (mut since_rebuild, mut strengthened) = (0, 0);
    if descent.stop(target, max_iterations).is_none() && !pre.prepare(problem, u) {
        // What was learnt with this preconditioner is still about true.
        history.count = space.pairs;
    }
    let status = loop {
        if let Some(status) = descent.stop(target, max_iterations) {
            break status;
        }
        if pre.follows() && descent.iterations() >= PATIENCE {
            break Status::Stalled;
        }
        if pre.follows() && since_rebuild >= REBUILD {
            pre.rebuild(problem, u);
            history.count = 0;
            since_rebuild = 0;
        }
        let near = descent.gradient_norm <= ENDGAME * target.gradient;
        if near
            && !ended
            && wants_error(target, pre)
            && doubts.seen > 0
            && doubts.remainder(problem, u, pre).is_none()
        {
            ended = true;
            let before = descent.gradient_norm;
            let residual = verified_residual(pre).min(ENDGAME_RESIDUAL * target.gradient / before);
            let step = newton_step(problem, pre, space, u, &mut descent, residual);
            if step.taken {
                let length = step.before.filter(|_| step.tells);
                told = length.map(|length| (ENDGAME_REMAINS * length, CONTRACTS * before));
                doubts.negative_curvature = !history.push(space, u);
                since_rebuild += 1;
                continue;
            }
        }
        history.direction(pre, space);
        let mut length = max_norm(&space.direction);
        doubts.see(length);
        let enough = if pre.follows() {
            TRUSTED_HISTORY_OF_CYCLE
        } else {
            TRUSTED_HISTORY
        };
        let trusted = history.len() >= enough;
        let mut verified = false;
        if trusted {
            estimate = Some((length, Estimate::Direction));
            let met = |length| target.is_met(descent.gradient_norm, Some(length));
            if met(length * REMAINS) {
                verified = doubts.none(problem, u, pre);
                if !verified && met(length * SHORT) {
                    // A loose Newton step tells; it is taken, so nothing of it is lost.
                    let residual = verified_residual(pre);
                    let linear = newton_direction(problem, pre, space, u, residual);
                    length = SAFETY * max_norm(&space.direction);
                    verified = linear.status == LinearStatus::Converged
                        && target.is_met(descent.gradient_norm, Some(length * REMAINS));
                    estimate = Some((length, Estimate::NewtonStep));
                }
            }
        }
        let slope = dot(&space.gradient, &space.direction);
        let stepped = slope > 0.0 && descent.step(problem, space, u, slope);
        if !stepped {
            if verified {
                break Status::Converged;
            }
            // What is remembered misleads, or the preconditioner does: once more without, then with a safer one.
            if history.count > 0 || since_rebuild > 0 {
                history.count = 0;
                since_rebuild = 0;
                pre.rebuild(problem, u);
            } else if strengthened < STRENGTHENINGS && pre.strengthen(problem, u) {
                strengthened += 1;
            } else {
                break Status::Stalled;
            }
            continue;
        }
        doubts.negative_curvature = !history.push(space, u);
        if verified && descent.is_full {
            estimate = estimate.map(|(length, kind)| (length * REMAINS, kind));
            break Status::Converged;
        }
        since_rebuild += 1;
    };
    if status == Status::Converged && wants_error(target, pre) {
        estimate = match told {
            // Where much of the gradient is left, more of the error is.
            Some((length, gradient)) => {
                let more = (descent.gradient_norm / gradient).max(1.0);
                Some((length * more, Estimate::NewtonStep))
            }
            None => estimate.map(|_| final_estimate(problem, pre, space, u, &doubts)),
        };
    }
    space.pairs = history.count;
    descent.outcome(status, estimate)
}

/// Whether the error is to be told at the end of a solve that a gradient ends.
fn wants_error(target: &Target, pre: &dyn Preconditioner) -> bool {
    target.tell_error && target.accuracy.is_none() && pre.follows()
}

fn verified_residual(pre: &dyn Preconditioner) -> f64 {
    if pre.follows() && !pre.tells_errors() {
        VERIFIED_BLINDLY
    } else {
        VERIFIED
    }
}

/// The error after the last step.
fn final_estimate(
    problem: &mut Problem,
    pre: &mut dyn Preconditioner,
    space: &mut Workspace,
    u: &[Vector3<f64>],
    doubts: &Doubts,
) -> (f64, Estimate) {
    if let Some(remainder) = doubts.remainder(problem, u, pre) {
        return remainder;
    }
    let residual = verified_residual(pre);
    newton_direction(problem, pre, space, u, residual);
    (max_norm(&space.direction) * SAFETY, Estimate::NewtonStep)
}
