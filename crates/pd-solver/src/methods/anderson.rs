//! Anderson acceleration of local/global iteration (Peng et al. 2018, "Anderson acceleration for geometry optimization and
//! physics simulation"; Anderson 1965).

use super::newton::newton_direction;
use super::{Outcome, Preconditioner, Target, Workspace};
use crate::krylov::LinearStatus;
use crate::problem::Problem;
use crate::solution::{Estimate, Status};
use crate::vector::{NodalVector, axpy, difference, dot, max_norm, norm, zeros};
use nalgebra::{DMatrix, DVector};
use std::collections::VecDeque;

/// Differences kept. Peng et al. use five; with eight the box of the benchmarks takes 58 iterations instead of 102 to a gradient of
/// 1e-8 of that at rest.
const WINDOW: usize = 8;
/// Steps that the rate of convergence is measured over: single steps of an accelerated iteration are no measure of it.
const RATE_STEPS: usize = 5;
/// Share of the diagonal that is added to the equations of the weights, whose columns may be parallel to roundoff.
const REGULARISATION: f64 = 1e-12;
/// Residual of the Newton step that verifies an error estimate.
const VERIFIED: f64 = 0.2;
/// Relative size of what roundoff does to an energy that is a sum over many samples.
const ENERGY_ROUNDOFF: f64 = 1e-14;

/// How one plain iteration differs from the one before.
struct Difference {
    /// Of the gradients.
    gradient: NodalVector,
    /// Of the steps `z = K^-1 g`.
    step: NodalVector,
    /// Of the results `u - z`.
    result: NodalVector,
}

/// The differences of the last iterations, newest last, and the products of their steps and gradients.
#[derive(Default)]
struct History {
    differences: VecDeque<Difference>,
    products: VecDeque<[f64; WINDOW]>,
}

impl History {
    /// Keeps the difference of an iteration from the one before; the oldest one's memory is used again.
    fn push(&mut self, n: usize, fill: impl FnOnce(&mut Difference)) {
        let mut difference = if self.differences.len() == WINDOW {
            self.products.pop_front();
            for row in &mut self.products {
                row.rotate_left(1);
            }
            self.differences.pop_front().expect("full")
        } else {
            Difference {
                gradient: zeros(n),
                step: zeros(n),
                result: zeros(n),
            }
        };
        fill(&mut difference);
        self.differences.push_back(difference);
        let newest = &self.differences[self.differences.len() - 1];
        let mut row = [0.0; WINDOW];
        for (value, other) in row.iter_mut().zip(&self.differences) {
            *value = dot(&newest.step, &other.gradient);
        }
        self.products.push_back(row);
    }

    /// Weights of the differences that leave the least step, in the norm of the constant matrix: `|z|_K^2 = z . g`, so that no
    /// product with the matrix is needed. `None` where they are not determined.
    fn weights(&self, gradient: &NodalVector) -> Option<DVector<f64>> {
        let count = self.differences.len();
        let scale: Vec<f64> = (0..count).map(|i| self.products[i][i].sqrt()).collect();
        if count == 0 || !scale.iter().all(|s| *s > 0.0 && s.is_finite()) {
            return None;
        }
        let matrix = DMatrix::from_fn(count, count, |i, j| {
            let (newer, older) = (i.max(j), i.min(j));
            let unit = if i == j { REGULARISATION } else { 0.0 };
            self.products[newer][older] / (scale[i] * scale[j]) + unit
        });
        let right = DVector::from_fn(count, |i, _| {
            dot(&self.differences[i].step, gradient) / scale[i]
        });
        let weights = matrix.cholesky()?.solve(&right);
        Some(DVector::from_fn(count, |i, _| weights[i] / scale[i]))
    }
}

/// Estimates the error from the lengths of the last accepted steps.
struct Estimator {
    /// Oldest first.
    lengths: VecDeque<f64>,
    /// How much longer a Newton step was than the estimate, when last compared.
    calibration: f64,
}

impl Estimator {
    fn push(&mut self, length: f64) {
        if self.lengths.len() > RATE_STEPS {
            self.lengths.pop_front();
        }
        self.lengths.push_back(length);
    }

    /// What is left to go, were convergence linear at the mean rate of the last steps.
    fn estimate(&self) -> Option<f64> {
        if self.lengths.len() <= RATE_STEPS {
            return None;
        }
        let (first, last) = (self.lengths[0], self.lengths[RATE_STEPS]);
        let rate = (last / first).powf(1.0 / RATE_STEPS as f64).min(0.999);
        // One step may be short by chance.
        let length = last.max(self.lengths[RATE_STEPS - 1] * rate);
        Some(length * (rate / (1.0 - rate)).max(1.0) * self.calibration)
    }

    /// Replaces an estimate by the length of a loose Newton step, which knows all directions, and learns from it.
    fn verify(
        &mut self,
        problem: &mut Problem,
        constant: &mut dyn Preconditioner,
        space: &mut Workspace,
        u: &NodalVector,
        estimate: f64,
    ) -> f64 {
        let newton = newton_direction(problem, constant, space, u, VERIFIED);
        let step = max_norm(&space.direction);
        let length = match newton.status {
            LinearStatus::Converged => step,
            // Not near a minimum yet.
            _ => 2.0 * estimate.max(step),
        };
        // A step of no length at all cannot be compared with.
        if estimate > 0.0 {
            self.calibration = (self.calibration * length / estimate).max(1.0);
        }
        length
    }
}

/// Local/global iteration whose next point is taken from the last few: the combination of their results for which the same
/// combination of their steps is least.
///
/// The energy guards it: a point whose energy is not lower than the last one's is dropped for the plain local/global step from
/// there, which always lowers it. The energy therefore never increases (but for roundoff). The error estimate extrapolates like
/// that of local/global, with the mean rate of several steps, because single ones are irregular. It can still be several times
/// too small, because the last few differences do not span all slow directions: before it ends a solve, a loose Newton step
/// confirms it or says how much too small it is.
pub(crate) fn anderson(
    problem: &mut Problem,
    constant: &mut dyn Preconditioner,
    space: &mut Workspace,
    u: &mut NodalVector,
    target: &Target,
    max_iterations: usize,
) -> Outcome {
    let n = problem.len();
    // The last accepted point, its gradient and step, and the plain local/global result from it.
    let (mut last, mut last_gradient, mut last_step) = (u.clone(), zeros(n), zeros(n));
    let mut plain = zeros(n);
    let (mut step, mut next) = (zeros(n), zeros(n));
    space.reserve(n);
    let mut history = History::default();
    let mut estimator = Estimator {
        lengths: VecDeque::new(),
        calibration: 1.0,
    };
    let mut accepted: Option<(f64, f64)> = None;
    let mut iterations = 0;
    loop {
        let mut energy = problem.evaluate(u, &mut space.gradient);
        let mut gradient_norm = norm(&space.gradient);
        if let Some((last_energy, last_norm)) = accepted {
            let level = energy <= last_energy + ENERGY_ROUNDOFF * last_energy.abs();
            if !(energy < last_energy || (level && gradient_norm < last_norm)) {
                u.copy_from_slice(&plain);
                energy = problem.evaluate(u, &mut space.gradient);
                gradient_norm = norm(&space.gradient);
            }
            difference(u, &last, &mut next);
            estimator.push(max_norm(&next));
            iterations += 1;
        }
        let mut estimate = estimator.estimate();
        if gradient_norm > target.gradient
            && target.is_met(gradient_norm, estimate)
            && let Some(length) = &mut estimate
        {
            *length = estimator.verify(problem, constant, space, u, *length);
        }
        let outcome = |status| Outcome {
            status,
            iterations,
            energy,
            gradient_norm,
            estimated_error: estimate,
            estimate: estimate.map_or(Estimate::None, |_| Estimate::Extrapolation),
        };
        if !(energy.is_finite() && gradient_norm.is_finite()) {
            return outcome(Status::NotFinite);
        }
        if target.is_met(gradient_norm, estimate) {
            return outcome(Status::Converged);
        }
        if iterations == max_iterations {
            return outcome(Status::IterationLimit);
        }
        constant.apply(&space.gradient, &mut step);
        difference(u, &step, &mut next);
        if accepted.is_some() {
            history.push(n, |d| {
                difference(&space.gradient, &last_gradient, &mut d.gradient);
                difference(&step, &last_step, &mut d.step);
                difference(&next, &plain, &mut d.result);
            });
        }
        accepted = Some((energy, gradient_norm));
        plain.copy_from_slice(&next);
        if let Some(weights) = history.weights(&space.gradient) {
            for (difference, weight) in history.differences.iter().zip(&weights) {
                axpy(-weight, &difference.result, &mut next);
            }
        } else {
            history = History::default();
        }
        std::mem::swap(&mut last_gradient, &mut space.gradient);
        std::mem::swap(&mut last_step, &mut step);
        std::mem::swap(&mut last, u);
        std::mem::swap(u, &mut next);
    }
}
