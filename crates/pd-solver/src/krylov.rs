//! Krylov methods on nodal vectors: conjugate gradients that notice negative curvature, and MINRES for indefinite systems.

use crate::methods::{KrylovSpace, Preconditioner};
use crate::problem::Problem;
use crate::vector::{NodalVector, axpy, axpy_norm, difference, dot, norm, scale_add, zeros};
use nalgebra::Vector3;

/// How an iterative linear solve ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum LinearStatus {
    /// The residual fell below the tolerance.
    Converged,
    /// A direction of negative or zero curvature was met.
    NegativeCurvature,
    /// The limit of iterations was reached.
    IterationLimit,
    /// A value overflowed or lost all its digits.
    Breakdown,
}

/// Result of an iterative linear solve; the solution is in the space it was given.
pub(crate) struct LinearSolution {
    pub(crate) status: LinearStatus,
    pub(crate) iterations: usize,
    /// |b - H x| / |b|, as the recurrence has it.
    pub(crate) relative_residual: f64,
}

/// A symmetric operator and a symmetric positive definite preconditioner, both given as products.
pub(crate) trait LinearOperator {
    /// `out = H x`, zero where a node is prescribed.
    fn apply(&mut self, x: &[Vector3<f64>], out: &mut NodalVector);
    /// `out = M^-1 r`.
    fn precondition(&mut self, r: &[Vector3<f64>], out: &mut NodalVector);
    /// Takes note that the solution is zero.
    fn begin(&mut self) {}
    /// Takes note that the solution moves by `step` times what was last applied to.
    fn advance(&mut self, _step: f64) {}
}

/// The Hessian of a problem at its last linearisation, and a preconditioner.
pub(crate) struct System<'a> {
    pub(crate) problem: &'a mut Problem,
    pub(crate) pre: &'a mut dyn Preconditioner,
    pub(crate) reactions: &'a mut Reactions,
}

/// `H x` at prescribed nodes, where the system has no rows. They come along with the products that a solve makes.
#[derive(Default)]
pub(crate) struct Reactions {
    /// To the solution.
    pub(crate) sum: NodalVector,
    /// To what was last applied to.
    last: NodalVector,
}

impl LinearOperator for System<'_> {
    fn apply(&mut self, x: &[Vector3<f64>], out: &mut NodalVector) {
        self.problem.full_hessian_product(x, out);
        let at_prescribed = self.problem.prescribed.iter().map(|&n| out[n as usize]);
        self.reactions.last.clear();
        self.reactions.last.extend(at_prescribed);
        self.problem.add_rigid(x, out);
        self.problem.clear_prescribed(out);
    }

    fn precondition(&mut self, r: &[Vector3<f64>], out: &mut NodalVector) {
        self.pre.apply(r, out);
    }

    fn begin(&mut self) {
        let Reactions { sum, .. } = self.reactions;
        sum.clear();
        sum.resize(self.problem.prescribed.len(), Vector3::zeros());
    }

    fn advance(&mut self, step: f64) {
        let Reactions { sum, last } = self.reactions;
        sum.iter_mut()
            .zip(last)
            .for_each(|(sum, last)| *sum += *last * step);
    }
}

/// Bisections for the smallest Ritz value: it is told to the last digit down to 1e-15 of the largest.
const BISECTIONS: usize = 100;
/// How often a preconditioner is made safer before conjugate gradients give up.
const STRENGTHENINGS: usize = 3;

/// [`conjugate_gradients`] on the Hessian at `u`. A preconditioner that is not positive definite shows as a breakdown: it is made safer and the
/// solve begun anew.
pub(crate) fn solve_at(
    system: &mut System,
    u: &[Vector3<f64>],
    b: &[Vector3<f64>],
    space: &mut KrylovSpace,
    warm: bool,
    tolerance: f64,
    max_iterations: usize,
) -> LinearSolution {
    let mut linear = conjugate_gradients(system, b, space, warm, tolerance, max_iterations);
    for _ in 0..STRENGTHENINGS {
        if linear.status != LinearStatus::Breakdown || !system.pre.strengthen(system.problem, u) {
            break;
        }
        linear = conjugate_gradients(system, b, space, false, tolerance, max_iterations);
    }
    linear
}

/// Preconditioned conjugate gradients for `H x = b`, from zero or, if `warm`, from the `x` in the space.
///
/// Stops at the first direction `d` with `d . H d <= 0` and leaves what it has by then (the first search direction when it
/// happens at once), which is a descent direction for the quadratic model either way (Steihaug 1983).
pub(crate) fn conjugate_gradients(
    operator: &mut impl LinearOperator,
    b: &[Vector3<f64>],
    space: &mut KrylovSpace,
    warm: bool,
    tolerance: f64,
    max_iterations: usize,
) -> LinearSolution {
    let b_norm = norm(b);
    let KrylovSpace {
        x,
        r,
        z,
        d,
        q,
        lanczos,
    } = space;
    lanczos.clear();
    operator.begin();
    if b_norm == 0.0 {
        x.fill(Vector3::zeros());
        return finished(LinearStatus::Converged, 0, 0.0);
    }
    let mut relative = 1.0;
    r.copy_from_slice(b);
    if warm {
        operator.apply(x, q);
        operator.advance(1.0);
        difference(b, q, r);
        relative = norm(r) / b_norm;
    }
    // A start that is farther off than zero is none.
    if !warm || relative > 1.0 || !relative.is_finite() {
        x.fill(Vector3::zeros());
        operator.begin();
        r.copy_from_slice(b);
        relative = 1.0;
    }
    if relative <= tolerance {
        return finished(LinearStatus::Converged, 0, relative);
    }
    operator.precondition(r, z);
    d.copy_from_slice(z);
    let mut rz = dot(r, z);
    for iteration in 0..max_iterations {
        operator.apply(d, q);
        let curvature = dot(d, q);
        if !(rz.is_finite() && curvature.is_finite()) || rz <= 0.0 {
            return finished(LinearStatus::Breakdown, iteration, relative);
        }
        if curvature <= 0.0 {
            if iteration == 0 {
                x.copy_from_slice(d);
                operator.begin();
                operator.advance(1.0);
            }
            return finished(LinearStatus::NegativeCurvature, iteration + 1, relative);
        }
        let step = rz / curvature;
        axpy(step, d, x);
        operator.advance(step);
        relative = axpy_norm(-step, q, r) / b_norm;
        if relative <= tolerance {
            lanczos.push((step, 0.0));
            return finished(LinearStatus::Converged, iteration + 1, relative);
        }
        operator.precondition(r, z);
        let next = dot(r, z);
        lanczos.push((step, next / rz));
        scale_add(d, next / rz, z);
        rz = next;
    }
    finished(LinearStatus::IterationLimit, max_iterations, relative)
}

/// The smallest Ritz value of the last solve by [`conjugate_gradients`]: how soft the softest direction that it saw is, against the preconditioner.
/// `lanczos` holds its steps and the factors that its directions were mixed by, from which the tridiagonal matrix of Lanczos follows (Golub and
/// Van Loan, 11.3); the value is found by bisection on its pivots.
pub(crate) fn smallest_ritz_value(lanczos: &[(f64, f64)]) -> Option<f64> {
    // Entry j: the diagonal, and the square of what is beside it.
    let entry = |j: usize| {
        let (step, mixed) = lanczos[j];
        let before = j
            .checked_sub(1)
            .map_or(0.0, |i| lanczos[i].1 / lanczos[i].0);
        (step.recip() + before, mixed / (step * step))
    };
    let first = (!lanczos.is_empty()).then(|| entry(0).0)?;
    let all_above = |value: f64| {
        let mut pivot = 1.0;
        let mut beside = 0.0;
        (0..lanczos.len()).all(|j| {
            let (diagonal, next) = entry(j);
            pivot = diagonal - value - beside / pivot;
            beside = next;
            pivot > 0.0
        })
    };
    let (mut low, mut high) = (0.0, first);
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (low + high);
        if all_above(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    Some(high)
}

/// Preconditioned MINRES from zero for symmetric, possibly indefinite `H x = b` (Paige and Saunders 1975, in the form of
/// Elman, Silvester and Wathen, Algorithm 4.1). The residual is measured in the norm of the preconditioner while iterating.
pub(crate) fn minres(
    operator: &mut impl LinearOperator,
    b: &[Vector3<f64>],
    x: &mut NodalVector,
    tolerance: f64,
    max_iterations: usize,
) -> LinearSolution {
    let n = b.len();
    x.fill(Vector3::zeros());
    operator.begin();
    let b_norm = norm(b);
    if b_norm == 0.0 {
        return finished(LinearStatus::Converged, 0, 0.0);
    }
    let (mut v_old, mut v) = (zeros(n), b.to_vec());
    let (mut z, mut z_next, mut v_next) = (zeros(n), zeros(n), zeros(n));
    operator.precondition(&v, &mut z);
    let mut gamma = dot(&z, &v).max(0.0).sqrt();
    let mut gamma_old = 1.0;
    let mut eta = gamma;
    let eta_start = eta;
    let (mut s_old, mut s, mut c_old, mut c) = (0.0, 0.0, 1.0, 1.0);
    let (mut w_old, mut w) = (zeros(n), zeros(n));
    for iteration in 0..max_iterations {
        z.iter_mut().for_each(|z| *z /= gamma);
        operator.apply(&z, &mut v_next);
        let delta = dot(&v_next, &z);
        axpy(-delta / gamma, &v, &mut v_next);
        axpy(-gamma / gamma_old, &v_old, &mut v_next);
        operator.precondition(&v_next, &mut z_next);
        let gamma_next = dot(&z_next, &v_next).max(0.0).sqrt();
        let a0 = c * delta - c_old * s * gamma;
        let a1 = a0.hypot(gamma_next);
        let a2 = s * delta + c_old * c * gamma;
        let a3 = s_old * gamma;
        if !a1.is_finite() || a1 == 0.0 {
            return true_residual(operator, b, x, LinearStatus::Breakdown, iteration);
        }
        (c_old, s_old) = (c, s);
        (c, s) = (a0 / a1, gamma_next / a1);
        for i in 0..n {
            let w_new = (z[i] - w_old[i] * a3 - w[i] * a2) / a1;
            x[i] += w_new * (c * eta);
            w_old[i] = w[i];
            w[i] = w_new;
        }
        eta *= -s;
        if eta.abs() <= tolerance * eta_start || gamma_next == 0.0 {
            return true_residual(operator, b, x, LinearStatus::Converged, iteration + 1);
        }
        (gamma_old, gamma) = (gamma, gamma_next);
        std::mem::swap(&mut v_old, &mut v);
        std::mem::swap(&mut v, &mut v_next);
        std::mem::swap(&mut z, &mut z_next);
    }
    true_residual(operator, b, x, LinearStatus::IterationLimit, max_iterations)
}

fn true_residual(
    operator: &mut impl LinearOperator,
    b: &[Vector3<f64>],
    x: &[Vector3<f64>],
    status: LinearStatus,
    iterations: usize,
) -> LinearSolution {
    let mut r = zeros(b.len());
    operator.apply(x, &mut r);
    operator.begin();
    operator.advance(1.0);
    r.iter_mut().zip(b).for_each(|(r, b)| *r = b - *r);
    let relative = norm(&r) / norm(b);
    finished(status, iterations, relative)
}

fn finished(status: LinearStatus, iterations: usize, relative_residual: f64) -> LinearSolution {
    LinearSolution {
        status,
        iterations,
        relative_residual,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Diagonal operator with a diagonal preconditioner.
    struct Diagonal(Vec<f64>, Vec<f64>);

    impl LinearOperator for Diagonal {
        fn apply(&mut self, x: &[Vector3<f64>], out: &mut NodalVector) {
            out.iter_mut()
                .zip(x.iter().zip(&self.0))
                .for_each(|(o, (x, d))| *o = x * *d);
        }
        fn precondition(&mut self, r: &[Vector3<f64>], out: &mut NodalVector) {
            out.iter_mut()
                .zip(r.iter().zip(&self.1))
                .for_each(|(o, (r, d))| *o = r / *d);
        }
    }

    fn right_hand_side() -> NodalVector {
        (0..40)
            .map(|i| {
                let t = i as f64;
                Vector3::new((t * 0.7).sin(), 1.0, (t * 1.3).cos())
            })
            .collect()
    }

    fn error(operator: &Diagonal, x: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
        let pairs = x.iter().zip(b).zip(&operator.0);
        pairs
            .map(|((x, b), d)| (x - b / *d).norm())
            .fold(0.0, f64::max)
    }

    #[test]
    fn conjugate_gradients_solve_a_definite_system() {
        let d: Vec<f64> = (0..40).map(|i| 1.0 + i as f64).collect();
        let mut operator = Diagonal(d, vec![3.0; 40]);
        let b = right_hand_side();
        let mut space = KrylovSpace::default();
        space.reserve(b.len());
        let cold = conjugate_gradients(&mut operator, &b, &mut space, false, 1e-13, 200);
        assert_eq!(cold.status, LinearStatus::Converged);
        assert!(error(&operator, &space.x, &b) < 1e-12);
        space.x.iter_mut().for_each(|x| *x *= 1.0 + 1e-6);
        let warm = conjugate_gradients(&mut operator, &b, &mut space, true, 1e-7, 200);
        assert!(warm.iterations < cold.iterations && warm.status == LinearStatus::Converged);
        assert!(error(&operator, &space.x, &b) < 1e-5);
    }

    #[test]
    fn the_softest_direction_shows_in_the_steps() {
        let mut d: Vec<f64> = (0..40).map(|i| 1.0 + i as f64).collect();
        d[3] = 1e-5;
        let mut operator = Diagonal(d, vec![1.0; 40]);
        let b = right_hand_side();
        let mut space = KrylovSpace::default();
        space.reserve(b.len());
        let solved = conjugate_gradients(&mut operator, &b, &mut space, false, 1e-12, 400);
        assert_eq!(solved.status, LinearStatus::Converged);
        let softest = smallest_ritz_value(&space.lanczos).unwrap();
        assert!((softest - 1e-5).abs() < 1e-8, "{softest}");
        assert_eq!(smallest_ritz_value(&[]), None);
        assert_eq!(smallest_ritz_value(&[(0.5, 0.0)]), Some(2.0));
    }

    #[test]
    fn indefinite_systems_are_noticed_and_solved_by_minres() {
        let d: Vec<f64> = (0..40).map(|i| i as f64 - 7.5).collect();
        let m: Vec<f64> = (0..40).map(|i| 2.0 + (i % 5) as f64).collect();
        let mut operator = Diagonal(d, m);
        let b = right_hand_side();
        let mut space = KrylovSpace::default();
        space.reserve(b.len());
        let noticed = conjugate_gradients(&mut operator, &b, &mut space, false, 1e-13, 200);
        assert_eq!(noticed.status, LinearStatus::NegativeCurvature);
        let result = minres(&mut operator, &b, &mut space.x, 1e-13, 400);
        assert_eq!(result.status, LinearStatus::Converged);
        assert!(
            result.relative_residual < 1e-11,
            "{}",
            result.relative_residual
        );
        assert!(error(&operator, &space.x, &b) < 1e-10);
    }
}
