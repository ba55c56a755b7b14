//! L-BFGS whose initial Hessian is a preconditioner: the constant matrix (Liu, Bouaziz, Kavan 2017), or a multigrid cycle on the
//! projected Hessian that is built anew now and then.

use super::descent::Descent;
use super::history::History;
use super::newton::{CONTRACTS, newton_direction, newton_step};
use super::predict::predict;
use super::{Outcome, Preconditioner, Target, Workspace};
use crate::krylov::LinearStatus;
use crate::problem::Problem;
use crate::solution::{Estimate, Status};
use crate::vector::{NodalVector, dot, max_norm};
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
/// Share of the gradient that may be left after a predicted step whose length tells the error. On boxes, a head and a starfish it is a tenth to a
/// quarter; where the actuation changes so much inside elements that their middles say little of it, it is more.
const PREDICTED_LEAVES: f64 = 0.5;

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
        descent: &Descent,
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
        !doubtful && descent.inverted == 0
    }

    fn slow(&self) -> bool {
        self.rate().is_some_and(|rate| rate > SLOW)
    }

    /// The error after the last step, where the directions tell it.
    fn remainder(
        &self,
        problem: &Problem,
        descent: &Descent,
        pre: &dyn Preconditioner,
    ) -> Option<(f64, Estimate)> {
        let last = self.lengths[0]?;
        // Directions that were not slow yet, or too few to tell, leave a share of the last one; steadily shorter ones a series.
        let rate = self.rate().filter(|_| self.slow()).unwrap_or(0.0);
        if rate >= STEADY || !self.directions_tell(problem, descent, pre) {
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
    fn none(&self, problem: &Problem, descent: &Descent, pre: &dyn Preconditioner) -> bool {
        !self.slow() && self.directions_tell(problem, descent, pre)
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
    let mut history = std::mem::take(&mut space.history);
    let mut doubts = Doubts::default();
    let may_predict = std::mem::take(&mut space.predict) && max_iterations > 0;
    let predicted = match may_predict {
        true => predict(problem, pre, space, u, &mut history),
        false => None,
    };
    // Whether that was enough.
    let mut arrived = false;
    let mut descent = Descent::start(problem, space, u);
    let mut estimate = None;
    // What a Newton step near the end told: the error that it left, provided that the gradient fell to this.
    let (mut ended, mut told) = (false, None);
    let (mut since_rebuild, mut strengthened) = (0, 0);
    if let Some(before) = predicted {
        descent.count(space, before);
        let length = descent.step;
        doubts.see(length);
        let trusted = trusts(pre, &history);
        doubts.negative_curvature = !descent.remember(&mut history, space, u);
        estimate = trusted.then_some((length * REMAINS, Estimate::Direction));
        let near = target.accuracy.is_some_and(|a| length * REMAINS <= a);
        let fell = descent.gradient_norm <= PREDICTED_LEAVES * before;
        arrived = trusted && near && fell && doubts.none(problem, &descent, pre);
    } else if descent.stop(target, max_iterations).is_none() && pre.prepare(problem, u) {
        // What was learnt with another preconditioner is not true of this one.
        history.clear();
    }
    let status = loop {
        if arrived {
            break Status::Converged;
        }
        if let Some(status) = descent.stop(target, max_iterations) {
            break status;
        }
        if pre.follows() && descent.iterations() >= PATIENCE {
            break Status::Stalled;
        }
        if pre.follows() && since_rebuild >= REBUILD {
            pre.rebuild(problem, u);
            history.clear();
            since_rebuild = 0;
        }
        let near = descent.gradient_norm <= ENDGAME * target.gradient;
        if near
            && !ended
            && wants_error(target, pre)
            && doubts.seen > 0
            && doubts.remainder(problem, &descent, pre).is_none()
        {
            ended = true;
            let before = descent.gradient_norm;
            let residual = verified_residual(pre).min(ENDGAME_RESIDUAL * target.gradient / before);
            let step = newton_step(problem, pre, space, u, &mut descent, residual);
            if step.taken {
                let length = step.before.filter(|_| step.tells);
                told = length.map(|length| (ENDGAME_REMAINS * length, CONTRACTS * before));
                doubts.negative_curvature = !descent.remember(&mut history, space, u);
                since_rebuild += 1;
                continue;
            }
        }
        history.direction(pre, &space.gradient, &mut space.direction);
        let mut length = max_norm(&space.direction);
        doubts.see(length);
        let mut verified = false;
        if trusts(pre, &history) {
            estimate = Some((length, Estimate::Direction));
            let met = |length| target.is_met(descent.gradient_norm, Some(length));
            if met(length * REMAINS) {
                verified = doubts.none(problem, &descent, pre);
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
            if !history.is_empty() || since_rebuild > 0 {
                history.clear();
                since_rebuild = 0;
                pre.rebuild(problem, u);
            } else if strengthened < STRENGTHENINGS && pre.strengthen(problem, u) {
                strengthened += 1;
            } else {
                break Status::Stalled;
            }
            continue;
        }
        doubts.negative_curvature = !descent.remember(&mut history, space, u);
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
            None => estimate.map(|_| {
                let told = doubts.remainder(problem, &descent, pre);
                told.unwrap_or_else(|| error_by_newton(problem, pre, space, u))
            }),
        };
    }
    space.history = history;
    descent.outcome(status, estimate)
}

/// Whether there are pairs enough for the length of a direction to tell the error.
fn trusts(pre: &dyn Preconditioner, history: &History) -> bool {
    let enough = if pre.follows() {
        TRUSTED_HISTORY_OF_CYCLE
    } else {
        TRUSTED_HISTORY
    };
    history.len() >= enough
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

/// The error at `u`, by the length of a Newton step that is not taken.
fn error_by_newton(
    problem: &mut Problem,
    pre: &mut dyn Preconditioner,
    space: &mut Workspace,
    u: &[Vector3<f64>],
) -> (f64, Estimate) {
    let residual = verified_residual(pre);
    newton_direction(problem, pre, space, u, residual);
    (max_norm(&space.direction) * SAFETY, Estimate::NewtonStep)
}
