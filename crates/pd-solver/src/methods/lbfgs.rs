//! L-BFGS whose initial Hessian is the constant matrix (Liu, Bouaziz, Kavan 2017).

use super::newton::{REMAINS, newton_direction};
use super::{ENERGY_ROUNDOFF, Outcome, Target};
use crate::krylov::LinearStatus;
use crate::problem::Problem;
use crate::solution::Status;
use crate::vector::{NodalVector, add_scaled, axpy, dot, max_norm, norm, zeros};
use std::collections::VecDeque;

/// Pairs kept; the usual choice for this kind of energy (Liu, Bouaziz, Kavan 2017 use 5).
const HISTORY: usize = 10;
/// Pairs that must be there before the direction says anything of the error: without them it is one local/global step, which
/// underestimates the error by as much as that method is slow.
const TRUSTED_HISTORY: usize = 3;
/// Residual of the Newton step that verifies an error estimate.
const VERIFIED: f64 = 0.2;
/// Sufficient decrease (Armijo).
const ARMIJO: f64 = 1e-4;
/// Halvings of a step before the search gives up.
const MAX_HALVINGS: usize = 25;

struct Pair {
    s: NodalVector,
    y: NodalVector,
    rho: f64,
}

/// The pairs of the last steps, newest last, and their two-loop recursion.
#[derive(Default)]
struct History {
    pairs: VecDeque<Pair>,
}

impl History {
    /// `z = B^-1 g` with the quasi-Newton approximation B; `q` is scratch.
    fn direction(
        &self,
        problem: &mut Problem,
        g: &NodalVector,
        q: &mut NodalVector,
        z: &mut NodalVector,
    ) {
        q.copy_from_slice(g);
        let mut alphas = [0.0; HISTORY];
        for (pair, alpha) in self.pairs.iter().zip(&mut alphas).rev() {
            *alpha = pair.rho * dot(&pair.s, q);
            axpy(-*alpha, &pair.y, q);
        }
        problem.constant_solve(q, z);
        for (pair, alpha) in self.pairs.iter().zip(&alphas) {
            let beta = pair.rho * dot(&pair.y, z);
            axpy(alpha - beta, &pair.s, z);
        }
    }

    /// Keeps a step `s` and its change of gradient `y`, unless their product is not safely positive.
    fn push(&mut self, u: &NodalVector, u_new: &NodalVector, g: &NodalVector, g_new: &NodalVector) {
        // The oldest pair's memory is used again.
        let (mut s, mut y) = if self.pairs.len() == HISTORY {
            let oldest = self.pairs.pop_front().expect("full");
            (oldest.s, oldest.y)
        } else {
            (zeros(u.len()), zeros(u.len()))
        };
        add_scaled(u_new, -1.0, u, &mut s);
        add_scaled(g_new, -1.0, g, &mut y);
        let sy = dot(&s, &y);
        if sy > f64::EPSILON * norm(&s) * norm(&y) {
            let rho = 1.0 / sy;
            self.pairs.push_back(Pair { s, y, rho });
        }
    }
}

pub(crate) fn lbfgs(
    problem: &mut Problem,
    u: &mut NodalVector,
    target: &Target,
    max_iterations: usize,
) -> Outcome {
    let n = problem.len();
    let (mut gradient, mut trial_gradient) = (zeros(n), zeros(n));
    let (mut direction, mut scratch, mut trial) = (zeros(n), zeros(n), zeros(n));
    let mut history = History::default();
    let mut energy = problem.evaluate(u, &mut gradient);
    let mut gradient_norm = norm(&gradient);
    let mut estimate = None;
    let mut iterations = 0;
    let status = loop {
        if !(energy.is_finite() && gradient_norm.is_finite()) {
            break Status::NotFinite;
        }
        if gradient_norm <= target.gradient {
            break Status::Converged;
        }
        if iterations == max_iterations {
            break Status::IterationLimit;
        }
        history.direction(problem, &gradient, &mut scratch, &mut direction);
        // The length of the direction estimates the error for free, but may be several times too small while the history
        // still learns. A loose Newton step tells; it is taken, so nothing of it is lost.
        let mut verified = false;
        if history.pairs.len() >= TRUSTED_HISTORY {
            estimate = Some(max_norm(&direction));
            if target.is_met(gradient_norm, estimate) {
                let newton = newton_direction(problem, u, &gradient, VERIFIED);
                let length = max_norm(&newton.x);
                verified = newton.status == LinearStatus::Converged
                    && target.is_met(gradient_norm, Some(length));
                estimate = Some(length);
                direction = newton.x;
            }
        }
        let slope = dot(&gradient, &direction);
        if slope <= 0.0 {
            break Status::Stalled;
        }
        let accepted = search(
            problem,
            (u, energy, gradient_norm),
            (&direction, slope),
            &mut trial,
            &mut trial_gradient,
        );
        let Some(trial_energy) = accepted else {
            break if verified {
                Status::Converged
            } else {
                Status::Stalled
            };
        };
        history.push(u, &trial, &gradient, &trial_gradient);
        std::mem::swap(u, &mut trial);
        std::mem::swap(&mut gradient, &mut trial_gradient);
        energy = trial_energy;
        gradient_norm = norm(&gradient);
        iterations += 1;
        if verified {
            estimate = estimate.map(|length| length * REMAINS);
            break Status::Converged;
        }
    };
    Outcome {
        status,
        iterations,
        energy,
        gradient_norm,
        estimated_error: estimate,
    }
}

/// Halves the step until the energy falls enough; where the fall drowns in roundoff, a smaller gradient is accepted instead.
/// The accepted point and its gradient are left in `trial` and `trial_gradient`.
pub(super) fn search(
    problem: &mut Problem,
    (u, energy, gradient_norm): (&NodalVector, f64, f64),
    (direction, slope): (&NodalVector, f64),
    trial: &mut NodalVector,
    trial_gradient: &mut NodalVector,
) -> Option<f64> {
    let mut length = 1.0;
    for _ in 0..=MAX_HALVINGS {
        add_scaled(u, -length, direction, trial);
        let trial_energy = problem.evaluate(trial, trial_gradient);
        let decrease = trial_energy <= energy - ARMIJO * length * slope;
        let roundoff = ENERGY_ROUNDOFF * energy.abs();
        let level = trial_energy <= energy + roundoff && slope * length <= 1e3 * roundoff;
        if decrease || (level && norm(trial_gradient) < gradient_norm) {
            return Some(trial_energy);
        }
        length *= 0.5;
    }
    None
}
