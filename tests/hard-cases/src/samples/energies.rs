//! The energy of one sample and its derivatives.

use super::derivatives::slope;
use super::draws::Draw;
use super::tally::Tally;
use super::{finite, invalid};
use nalgebra::Matrix3;
use polar_grad::{
    HessianCore, PAIR_SUM_MIN, actuation_vjp, polar_rotation, shape_targeting_actuation_gradient,
    shape_targeting_energy, shape_targeting_gradient, symmetric_cotangent, symmetric_entries,
};

/// Gaps for which finite differences find a slope.
const SMOOTH: f64 = 1e-3;

/// What rounding of an energy, squared entries of two sizes, may add to a slope, in entries over the step.
const ROUNDING: f64 = 5e-15;

/// Sum of products of six entries.
fn dot(a: &[f64; 6], b: &[f64; 6]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

pub fn check(tally: &mut Tally, number: u64, draw: &Draw, dear: bool) {
    let (f, a) = (&draw.f, &draw.a);
    let product = f * a;
    if !finite(&product) {
        invalid::stays_a_number_or_none(tally, number, f, a);
        return;
    }
    let energy = shape_targeting_energy(f, a);
    let gradient = shape_targeting_gradient(f, a);
    let by_a = shape_targeting_actuation_gradient(f, a);
    let size = f.amax().max(a.amax());
    tally.require(number, "gradient of the energy finite", finite(&gradient));
    tally.require(
        number,
        "gradient by the actuation finite",
        // A difference of two of the largest numbers has no number.
        by_a.iter().all(|x| x.is_finite()) || size > 1e307,
    );
    // Squares of entries beyond 1e154 are no numbers any more.
    let fits = size < 1e150;
    tally.require(
        number,
        "energy finite, not negative",
        energy >= 0.0 && (energy.is_finite() || !fits),
    );
    let r = polar_rotation(&product);
    let expected = f - r * a;
    let error =
        (gradient / size.max(f64::MIN_POSITIVE) - expected / size.max(f64::MIN_POSITIVE)).amax();
    tally.check(number, "gradient is F - R A", error, 4e-15);
    if !(1e-100..1e100).contains(&size) {
        return;
    }
    // No other rotation may give less: not the identity, not turned ones.
    let least = 0.5 * (f - a).norm_squared();
    let error = (energy - least).max(0.0) / (size * size);
    tally.check(number, "energy is the least", error, 1e-14);

    let core = HessianCore::new(f, a);
    let [x, y] = &draw.tangents;
    let vjp = actuation_vjp(&core, f, y);
    tally.require(
        number,
        "vjp by the actuation finite",
        vjp.iter().all(|x| x.is_finite()),
    );
    if !dear {
        return;
    }
    let pair_sum = core.gradient.smallest_pair_sum;
    let gap = pair_sum / product.norm().max(f64::MIN_POSITIVE);
    // Sums that are raised are no slopes any more.
    if gap < SMOOTH || pair_sum < PAIR_SUM_MIN {
        return;
    }
    // Along F: a step that turns little, and what rounding of the energy then costs.
    let along = (x * a).norm().max(f64::MIN_POSITIVE);
    let h = (0.02 * pair_sum / along).min(0.1 * size);
    let rounding = ROUNDING * size / h;
    if rounding < 1e-5 {
        let by_differences = slope(|t| shape_targeting_energy(&(f + x * t), a), h);
        let error = (by_differences - gradient.dot(x)).abs() / size;
        tally.slope(number, "slope of the energy", error, 1e-6 + rounding);
        let by_differences = slope(|t| shape_targeting_gradient(&(f + x * t), a), h);
        let exact = core.apply(x);
        let scale = 1.0 + a.norm_squared() / pair_sum;
        let rounding = rounding * (1.0 + 1.0 / gap) / scale;
        let error = (by_differences - exact).amax() / scale;
        tally.slope(number, "slope of the gradient", error, 1e-6 + rounding);
    }
    // Along the actuation.
    let b = symmetric_entries(x);
    let d_a = (x + x.transpose()) * 0.5;
    let along = (f * d_a).norm().max(f64::MIN_POSITIVE);
    let h = (0.02 * pair_sum / along).min(0.1 * size);
    let rounding = ROUNDING * size / h;
    if rounding < 1e-5 {
        let by_differences = slope(|t| shape_targeting_energy(f, &(a + d_a * t)), h);
        let error = (by_differences - dot(&by_a, &b)).abs() / size;
        tally.slope(number, "slope by the actuation", error, 1e-6 + rounding);
        let by_differences: Matrix3<f64> =
            slope(|t| shape_targeting_gradient(f, &(a + d_a * t)), h);
        let scale = 1.0 + a.norm() * f.norm() / pair_sum;
        let rounding = rounding * (1.0 + 1.0 / gap) / scale;
        let error = (by_differences.dot(y) + dot(&vjp, &b)).abs() / scale;
        tally.slope(number, "vjp by the actuation", error, 1e-6 + rounding);
        // The six entries of a symmetric cotangent pair with the six of a matrix.
        let error = (dot(&symmetric_cotangent(y), &b) - y.dot(&d_a)).abs();
        tally.check(number, "six entries pair like nine", error, 1e-15);
    }
}
