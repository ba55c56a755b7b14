//! L-BFGS whose initial Hessian is the constant matrix (Liu, Bouaziz, Kavan 2017).

use super::descent::Descent;
use super::newton::{REMAINS, newton_direction};
use super::{Outcome, Target};
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
    let mut descent = Descent::start(problem, u);
    let (mut direction, mut scratch) = (zeros(n), zeros(n));
    let mut history = History::default();
    let mut estimate = None;
    let status = loop {
        if let Some(status) = descent.stop(target, max_iterations) {
            break status;
        }
        history.direction(problem, &descent.gradient, &mut scratch, &mut direction);
        // The length of the direction estimates the error for free, but may be several times too small while the history
        // still learns. A loose Newton step tells; it is taken, so nothing of it is lost.
        let mut verified = false;
        if history.pairs.len() >= TRUSTED_HISTORY {
            estimate = Some(max_norm(&direction));
            if target.is_met(descent.gradient_norm, estimate) {
                let newton = newton_direction(problem, u, &descent.gradient, VERIFIED);
                let length = max_norm(&newton.x);
                verified = newton.status == LinearStatus::Converged
                    && target.is_met(descent.gradient_norm, Some(length));
                estimate = Some(length);
                direction = newton.x;
            }
        }
        let slope = dot(&descent.gradient, &direction);
        if slope <= 0.0 {
            break Status::Stalled;
        }
        if !descent.step(problem, u, &direction, slope) {
            break if verified {
                Status::Converged
            } else {
                Status::Stalled
            };
        }
        history.push(&descent.last, u, &descent.last_gradient, &descent.gradient);
        if verified {
            estimate = estimate.map(|length| length * REMAINS);
            break Status::Converged;
        }
    };
    descent.outcome(status, estimate)
}
