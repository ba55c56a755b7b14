//! A trust-region search for few variables whose every evaluation is a simulation.
//!
//! The model of the value is quadratic: the Gauss-Newton matrix at first, because the variables' effects differ by orders of magnitude and
//! one linear solve per variable says by how much; then BFGS updates from step to step (Nocedal and Wright 2006, chapters 4 and 6), which
//! foretell better than a fresh Gauss-Newton matrix where codes are strongly curved. A step is the least point of the model within a
//! radius that grows and shrinks with how well the model foretold the value. A line search would find that radius anew in every step: what
//! a network makes of a code is far more curved than what the flesh makes of an actuation.

use crate::error::Result;
use nalgebra::{DMatrix, DVector, SymmetricEigen};

/// Share of the Gauss-Newton matrix's mean diagonal that is added to it: directions without effect stay where they are.
const DAMPING: f64 = 1e-4;
/// The first radius, in the unit of the variables.
const FIRST_RADIUS: f64 = 0.1;
/// A radius below this ends the search.
const LEAST_RADIUS: f64 = 1e-5;
/// A step is taken when the value falls by this share of what the model foretold.
const ENOUGH: f64 = 0.05;
/// The radius shrinks below the first of these shares, and grows above the second.
const FORETOLD: [f64; 2] = [0.25, 0.6];
/// By what the radius shrinks and grows.
const SHRINK: f64 = 0.3;
const GROW: f64 = 3.0;
/// The search ends after three steps in a row that lower the value by less than this share.
const SLIGHT: f64 = 2e-3;

/// What is minimised.
pub trait Objective {
    /// Everything known at a place.
    type Place;

    /// Evaluates `x`, near a place that is known; `None` where it cannot be.
    ///
    /// # Errors
    /// What ends the whole search.
    fn evaluate(&mut self, x: &DVector<f64>, near: &Self::Place) -> Result<Option<Self::Place>>;

    /// The value at a place.
    fn value(&self, place: &Self::Place) -> f64;

    /// How much lower the value is at a place than at the one that it was evaluated near.
    fn lowered(&self, from: &Self::Place, to: &Self::Place) -> f64;

    /// The gradient there; `None` where there is none.
    ///
    /// # Errors
    /// As [`Objective::evaluate`].
    fn gradient(&mut self, place: &mut Self::Place) -> Result<Option<DVector<f64>>>;

    /// A positive semidefinite approximation of the Hessian there; `None` where there is none.
    ///
    /// # Errors
    /// As [`Objective::evaluate`].
    fn curvature(&mut self, place: &Self::Place) -> Result<Option<DMatrix<f64>>>;
}

/// Where a search ended.
pub struct Found<P> {
    /// The variables.
    pub x: DVector<f64>,
    /// What is known there: every step to it lowered the value.
    pub place: P,
    /// Steps that lowered the value.
    pub steps: usize,
}

/// Lowers the value from `x` by at most `trials` steps, those included that turn out to lead nowhere.
///
/// # Errors
/// Those of the objective.
pub fn minimise<O: Objective>(
    objective: &mut O,
    x: DVector<f64>,
    mut place: O::Place,
    trials: usize,
) -> Result<Found<O::Place>> {
    let first = objective.gradient(&mut place)?;
    let mut found = Found { x, place, steps: 0 };
    let Some(mut gradient) = first else {
        return Ok(found);
    };
    let Some(mut model) = objective.curvature(&found.place)?.and_then(damped) else {
        return Ok(found);
    };
    let (mut radius, mut slight) = (FIRST_RADIUS, 0);
    for _ in 0..trials {
        let Some(step) = within(&model, &gradient, radius) else {
            break;
        };
        let foretold = -gradient.dot(&step) - 0.5 * step.dot(&(&model * &step));
        let before = objective.value(&found.place);
        let next = &found.x + &step;
        let mut place = objective.evaluate(&next, &found.place)?;
        let lowered = place
            .as_ref()
            .map_or(f64::NAN, |p| objective.lowered(&found.place, p));
        let share = lowered / foretold;
        if share.is_nan() || share < FORETOLD[0] {
            radius = SHRINK * step.norm();
        } else if share > FORETOLD[1] && step.norm() > 0.9 * radius {
            radius *= GROW;
        }
        let better = place.as_mut().filter(|_| share >= ENOUGH);
        let Some(after) = better.map(|p| objective.gradient(p)).transpose()?.flatten() else {
            radius = radius.min(SHRINK * step.norm());
            if radius < LEAST_RADIUS {
                break;
            }
            continue;
        };
        update(&mut model, &step, &(&after - &gradient));
        slight = if lowered < SLIGHT * before {
            slight + 1
        } else {
            0
        };
        gradient = after;
        if let Some(place) = place {
            found = Found {
                x: next,
                place,
                steps: found.steps + 1,
            };
        }
        if slight == 3 {
            break;
        }
    }
    Ok(found)
}

fn damped(mut matrix: DMatrix<f64>) -> Option<DMatrix<f64>> {
    let mean = matrix.trace() / matrix.nrows() as f64;
    let usable = mean.is_finite() && mean > 0.0;
    for i in 0..matrix.nrows() {
        matrix[(i, i)] += DAMPING * mean;
    }
    usable.then_some(matrix)
}

/// The least point of `g . d + d . B d / 2` with `|d| <= radius`, for a positive definite B: `d = -(B + s I)^-1 g` with the least s >= 0
/// that is short enough. `None` where the numbers do not allow it.
fn within(matrix: &DMatrix<f64>, gradient: &DVector<f64>, radius: f64) -> Option<DVector<f64>> {
    let eigen = SymmetricEigen::new(matrix.clone());
    let along = eigen.eigenvectors.tr_mul(gradient);
    let step = |shift: f64| along.zip_map(&eigen.eigenvalues, |g, e| -g / (e.max(0.0) + shift));
    let least = f64::EPSILON * eigen.eigenvalues.amax();
    let (mut low, mut high) = (least, gradient.norm() / radius);
    if !(least.is_normal() && high.is_normal()) {
        return None;
    }
    if step(low).norm() <= radius {
        high = low;
    }
    // By halves of a logarithmic scale: the shift may be of any size between the two.
    for _ in 0..60 {
        let middle = (low * high).sqrt();
        if step(middle).norm() > radius {
            low = middle;
        } else {
            high = middle;
        }
    }
    Some(&eigen.eigenvectors * step(high))
}

/// The BFGS update with Powell's damping, which keeps the matrix positive definite whatever the step saw.
fn update(b: &mut DMatrix<f64>, step: &DVector<f64>, change: &DVector<f64>) {
    let product = &*b * step;
    let (seen, known) = (step.dot(change), step.dot(&product));
    if known <= 0.0 || !seen.is_finite() {
        return;
    }
    let theta = match seen >= 0.2 * known {
        true => 1.0,
        false => 0.8 * known / (known - seen),
    };
    let change = change * theta + &product * (1.0 - theta);
    let seen = step.dot(&change);
    *b += &change * change.transpose() / seen - &product * product.transpose() / known;
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Squared residuals of a curved map whose variables have effects of very different size; there is nothing beyond a radius, and no
    /// gradient beyond another.
    struct Curved {
        evaluations: usize,
        radius: f64,
        differentiable: f64,
    }

    impl Curved {
        fn residuals(x: &DVector<f64>) -> DVector<f64> {
            let (a, b, c) = (x[0], x[1], x[2]);
            DVector::from_vec(vec![10.0 * (b - a * a), 1.0 - a, 0.01 * (c - 3.0 * a)])
        }

        fn jacobian(x: &DVector<f64>) -> DMatrix<f64> {
            let rows = [-20.0 * x[0], 10.0, 0.0, -1.0, 0.0, 0.0, -0.03, 0.0, 0.01];
            DMatrix::from_row_slice(3, 3, &rows)
        }
    }

    impl Objective for Curved {
        type Place = DVector<f64>;

        fn evaluate(&mut self, x: &DVector<f64>, _: &Self::Place) -> Result<Option<Self::Place>> {
            self.evaluations += 1;
            Ok((x.norm() < self.radius).then(|| x.clone()))
        }

        fn value(&self, x: &Self::Place) -> f64 {
            Self::residuals(x).norm_squared()
        }

        fn lowered(&self, from: &Self::Place, to: &Self::Place) -> f64 {
            self.value(from) - self.value(to)
        }

        fn gradient(&mut self, x: &mut Self::Place) -> Result<Option<DVector<f64>>> {
            let known = x.norm() < self.differentiable;
            Ok(known.then(|| Self::jacobian(x).tr_mul(&Self::residuals(x)) * 2.0))
        }

        fn curvature(&mut self, x: &Self::Place) -> Result<Option<DMatrix<f64>>> {
            let jacobian = Self::jacobian(x);
            Ok(Some(jacobian.tr_mul(&jacobian) * 2.0))
        }
    }

    fn start() -> DVector<f64> {
        DVector::from_vec(vec![-1.2, 1.0, 0.0])
    }

    fn search(radius: f64, differentiable: f64, trials: usize) -> (Found<DVector<f64>>, Curved) {
        let mut objective = Curved {
            evaluations: 0,
            radius,
            differentiable,
        };
        let found = minimise(&mut objective, start(), start(), trials).unwrap();
        (found, objective)
    }

    #[test]
    fn a_curved_valley_is_followed_to_its_end() {
        let (found, objective) = search(10.0, 10.0, 100);
        let value = objective.value(&found.place);
        assert!(value < 1e-3, "{value:e} after {} steps", found.steps);
        assert_eq!(found.x, found.place);
    }

    #[test]
    fn the_number_of_trials_is_a_limit() {
        let (none, objective) = search(10.0, 10.0, 0);
        assert_eq!((none.steps, objective.evaluations), (0, 0));
        let (three, objective) = search(10.0, 10.0, 3);
        assert_eq!(objective.evaluations, 3);
        assert!(objective.value(&three.place) < objective.value(&start()));
    }

    #[test]
    fn where_nothing_can_be_evaluated_or_differentiated_the_start_is_kept() {
        let edge = start().norm() * (1.0 + 1e-12);
        for (radius, differentiable) in [(0.0, 10.0), (10.0, 0.0)] {
            let (found, objective) = search(radius, differentiable, 60);
            assert_eq!((found.steps, found.x), (0, start()));
            assert!(objective.evaluations < 20, "{}", objective.evaluations);
        }
        // No step may leave the ball of the start, and steps inside it still lower the value.
        for (radius, differentiable) in [(edge, 10.0), (10.0, edge)] {
            let (found, objective) = search(radius, differentiable, 60);
            assert!(found.x.norm() <= edge && found.steps > 0);
            assert!(objective.value(&found.x) < objective.value(&start()));
        }
    }

    #[test]
    fn steps_are_the_least_of_the_model_within_the_radius() {
        let matrix = DMatrix::from_row_slice(2, 2, &[4.0, 1.0, 1.0, 2.0]);
        let gradient = DVector::from_vec(vec![1.0, -3.0]);
        let model = |d: &DVector<f64>| gradient.dot(d) + 0.5 * d.dot(&(&matrix * d));
        let full = within(&matrix, &gradient, 10.0).unwrap();
        assert!((&matrix * &full + &gradient).norm() < 1e-12);
        let short = within(&matrix, &gradient, 0.5).unwrap();
        assert!((short.norm() - 0.5).abs() < 1e-9);
        for i in 0..360 {
            let (sin, cos) = f64::from(i).to_radians().sin_cos();
            let other = DVector::from_vec(vec![0.5 * cos, 0.5 * sin]);
            assert!(model(&short) <= model(&other) + 1e-9);
        }
        assert!(within(&matrix, &DVector::zeros(2), 1.0).is_none());
    }
}
