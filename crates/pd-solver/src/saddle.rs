//! Saddles: a state without forces may still have a direction along which the energy falls. A solve that begins at something symmetric, or
//! inside out, can end there.

use crate::Solver;
use crate::krylov::{LinearStatus, System, solve_at};
use crate::methods::{Outcome, Target};
use crate::solution::{Estimate, Method, Status};
use crate::vector::{NodalVector, add_scaled, max_norm};
use nalgebra::Vector3;

/// Steps after which a solve came from far, or through something difficult: an easy one takes half as many.
const MANY: usize = 10;
/// Relative residual down to which a linear solve looks for negative curvature.
const LOOKED: f64 = 1e-2;
/// Its iterations at most.
const MAX_LOOKS: usize = 500;
/// How many saddles a solve leaves.
const SADDLES: usize = 20;
/// Halvings of the step off a saddle, which begins at an edge of an element, and doublings while the energy falls.
const MAX_HALVINGS: usize = 25;
const MAX_DOUBLINGS: usize = 12;
/// Steps of L-BFGS after leaving a saddle where the method is local/global: on a ridge that would take as many steps as it is flat, tens of
/// thousands.
const SLIDE: usize = 200;
/// Relative fall of the energy that is none.
const ENERGY_ROUNDOFF: f64 = 1e-13;

impl Solver {
    /// Whether the end of a solve may be a saddle for all that is known: it took so many steps that looking costs little beside them, or
    /// samples are inverted.
    pub(crate) fn may_be_saddle(
        &mut self,
        method: Method,
        u: &[Vector3<f64>],
        outcome: &Outcome,
    ) -> bool {
        if outcome.iterations > MANY {
            return true;
        }
        // These take directions for the error only where no sample is inverted.
        let looks = matches!(method, Method::Lbfgs | Method::Multigrid);
        let told = matches!(
            outcome.estimate,
            Estimate::Direction | Estimate::Extrapolation
        );
        !(looks && told) && self.parts(method).0.inverted_samples(u) > 0
    }

    /// Looks for a direction of negative curvature at the end of a solve, and goes on along it where there is one. Returns whether one is
    /// left; nothing where the linear solve that looks could not tell.
    pub(crate) fn leave_saddles(
        &mut self,
        method: &mut Method,
        u: &mut NodalVector,
        target: &Target,
        limit: usize,
        outcome: &mut Outcome,
    ) -> Option<bool> {
        for attempt in 0..=SADDLES {
            if !matches!(outcome.status, Status::Converged | Status::Stalled) {
                return None;
            }
            match self.look(*method, u, attempt as u64) {
                LinearStatus::Converged => return Some(false),
                LinearStatus::NegativeCurvature => {}
                _ => return None,
            }
            if attempt == SADDLES || !self.step_off(*method, u, outcome.energy) {
                return Some(true);
            }
            let mut done = outcome.iterations;
            if matches!(method, Method::LocalGlobal | Method::Anderson) {
                let few = SLIDE.min(limit.saturating_sub(done));
                done += self.run_method(Method::Lbfgs, u, target, few).iterations;
            }
            *outcome = self.run_with_fallback(method, u, target, limit.saturating_sub(done));
            outcome.iterations += done;
        }
        Some(true)
    }

    /// Solves with the Hessian at `u` for a right-hand side without symmetry; conjugate gradients stop at negative curvature, and leave the
    /// direction in the space.
    fn look(&mut self, method: Method, u: &[Vector3<f64>], seed: u64) -> LinearStatus {
        let (problem, pre, space) = self.parts(method);
        space.reserve(u.len());
        space.krylov.reserve(u.len());
        problem.linearise(u);
        pre.prepare(problem, u);
        let mut state = seed;
        for v in &mut space.scratch {
            *v = Vector3::from_fn(|_, _| number(&mut state));
        }
        problem.clear_prescribed(&mut space.scratch);
        problem.make_consistent(u, &mut space.scratch);
        let mut system = System {
            problem,
            pre,
            reactions: &mut space.reactions,
        };
        let (b, krylov) = (&space.scratch, &mut space.krylov);
        solve_at(&mut system, u, b, krylov, false, LOOKED, MAX_LOOKS).status
    }

    /// Moves `u` along the direction found, to whichever side the energy falls; false where it does not.
    fn step_off(&mut self, method: Method, u: &mut NodalVector, energy: f64) -> bool {
        let (problem, _, space) = self.parts(method);
        let direction = &space.krylov.d;
        let longest = max_norm(direction);
        if !(longest.is_finite() && longest > 0.0) {
            return false;
        }
        let mut length = problem.element_size / longest;
        // On either side no further than nothing is passed through: the look for the least energy leaves room for doubling.
        let mut reach = [f64::INFINITY; 2];
        if problem.limits_steps() {
            length *= f64::from(1 << MAX_DOUBLINGS);
            for (reach, signed) in reach.iter_mut().zip([length, -length]) {
                add_scaled(u, signed, direction, &mut space.last);
                *reach = length * problem.step_limit(u, &space.last);
            }
            length /= f64::from(1 << MAX_DOUBLINGS);
        }
        let allows = |signed: f64| signed.abs() <= reach[usize::from(signed < 0.0)];
        let low = energy - ENERGY_ROUNDOFF * energy.abs();
        let mut best: Option<(f64, f64)> = None;
        for _ in 0..=MAX_HALVINGS {
            for signed in [length, -length] {
                if !allows(signed) {
                    continue;
                }
                add_scaled(u, signed, direction, &mut space.last);
                let energy = problem.evaluate(&space.last, &mut space.last_gradient);
                if energy < best.map_or(low, |(_, least)| least) {
                    best = Some((signed, energy));
                }
            }
            if best.is_some() {
                break;
            }
            length *= 0.5;
        }
        let Some((mut step, mut least)) = best else {
            return false;
        };
        for _ in 0..MAX_DOUBLINGS {
            if !allows(2.0 * step) {
                break;
            }
            add_scaled(u, 2.0 * step, direction, &mut space.last);
            let energy = problem.evaluate(&space.last, &mut space.last_gradient);
            if energy.is_nan() || energy >= least {
                break;
            }
            (step, least) = (2.0 * step, energy);
        }
        add_scaled(u, step, direction, &mut space.last);
        std::mem::swap(u, &mut space.last);
        true
    }
}

/// Reproducible numbers in [-1, 1) (SplitMix64), so that a solve has the same bits each time.
fn number(state: &mut u64) -> f64 {
    *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

#[cfg(test)]
mod tests;
