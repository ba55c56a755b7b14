//! The derivative of the polar rotation.

use super::decompositions::{Known, beyond};
use super::draws::{Draw, scaled, times_power};
use super::finite;
use super::tally::Tally;
use nalgebra::{Matrix3, SVector, Vector3};
use polar_grad::{PAIR_SUM_FLOOR, PAIR_SUM_MIN, RotationGradient, polar_rotation};

/// Gaps below which vectors of the two last singular values are known too badly to compare a derivative.
const COMPARED: f64 = 1e-9;
/// Gaps for which finite differences find a slope.
const SMOOTH: f64 = 1e-4;

/// Row-wise `vec`.
pub fn vec(m: &Matrix3<f64>) -> SVector<f64, 9> {
    SVector::from_fn(|i, _| m[(i / 3, i % 3)])
}

/// `sum_k 2 / (s_i + s_j) Q_k <Q_k, X>` by the singular vectors, with these sums: the derivative as textbooks have it.
fn textbook(known: &Known, sums: &Vector3<f64>, x: &Matrix3<f64>) -> Matrix3<f64> {
    let (u, v) = (&known.svd.u, &known.svd.v);
    let y = u.tr_mul(x) * v;
    let w = Vector3::new(
        (y[(2, 1)] - y[(1, 2)]) / sums.x,
        (y[(0, 2)] - y[(2, 0)]) / sums.y,
        (y[(1, 0)] - y[(0, 1)]) / sums.z,
    );
    u * w.cross_matrix() * v.transpose()
}

/// Fourth-order central differences of a function along a line, of step `h`.
pub fn slope<T>(f: impl Fn(f64) -> T, h: f64) -> T
where
    T: std::ops::Sub<Output = T> + std::ops::Mul<f64, Output = T>,
{
    let near = (f(h) - f(-h)) * (8.0 / (12.0 * h));
    near - (f(2.0 * h) - f(-2.0 * h)) * (1.0 / (12.0 * h))
}

pub fn check(tally: &mut Tally, number: u64, draw: &Draw, known: &Known, dear: bool) {
    let gradient = RotationGradient::at(&draw.m);
    let g = &gradient;
    tally.require(
        number,
        "derivative finite",
        finite(&g.rotation)
            && finite(&g.factor)
            && finite(&g.pair_sums)
            && g.smallest_pair_sum.is_finite()
            && g.smallest_pair_sum >= 0.0,
    );
    tally.require(
        number,
        "derivative has the same R",
        g.rotation == polar_rotation(&draw.m),
    );
    tally.require(
        number,
        "B and T symmetric",
        g.factor == g.factor.transpose() && g.pair_sums == g.pair_sums.transpose(),
    );
    tally.see_pair_sum(g.smallest_pair_sum);
    let e = known.exponent;
    let s = known.svd.sigma;
    if g.smallest_pair_sum < f64::MAX {
        let error = (times_power(g.smallest_pair_sum, -e) - (s.y + s.z)).abs();
        let error = beyond(error, 2.0 * known.rounding);
        tally.check(number, "smallest pair sum", error, 1e-14);
    }
    let floor = (PAIR_SUM_FLOOR * s.x).max(times_power(PAIR_SUM_MIN, -e));
    let raised = Vector3::new(s.y + s.z, s.x + s.z, s.x + s.y).map(|x| x.max(floor));
    // B within what the smallest raised sum allows.
    let largest = times_power(g.factor.amax(), e) * raised.x;
    tally.require(number, "B within its floor", largest < 1.01);

    // Tangents as large as the matrix, where that is a number that can be multiplied.
    let size = e.clamp(-900, 900);
    let [x, y] = draw.tangents.map(|x| scaled(&x, size));
    let (dx, dy) = (g.apply(&x), g.apply(&y));
    tally.require(number, "dR finite", finite(&dx) && finite(&dy));
    let unit = 1.0 / raised.x * times_power(1.0, size - e);
    let (a, b) = (
        dx.dot(&scaled(&y, -size)) / unit,
        dy.dot(&scaled(&x, -size)) / unit,
    );
    tally.check(number, "H_R symmetric", (a - b).abs(), 2e-14);
    let along = g.apply(&scaled(&known.unit, size)).amax() / unit;
    tally.check(number, "stretching does not turn", along, 4e-14);
    let gap = raised.x / s.x.max(f64::MIN_POSITIVE);
    if known.gap > COMPARED {
        let expected = textbook(known, &raised, &draw.tangents[0]) * times_power(1.0, size - e);
        // A sum that was raised does not make the vectors better known.
        let error = (dx - expected).amax() / unit / (1.0 + 1.0 / known.gap);
        tally.check(number, "H_R as in textbooks", error, 4e-14);
        if known.gap > 1e-3 && g.pair_sums.amax() < f64::MAX && e.abs() < 500 {
            let error = (g.factor * g.pair_sums - Matrix3::identity()).amax() * gap;
            tally.check(number, "B T = I", error, 1e-13);
        }
    }
    if !dear {
        return;
    }
    let dense = g.to_matrix() * vec(&x);
    let error = (dense - vec(&dx)).amax() / unit;
    tally.check(number, "H_R dense and applied", error, 2e-14);
    // Sums that are raised are no slopes any more.
    if known.gap > SMOOTH && e < 900 && g.smallest_pair_sum > PAIR_SUM_MIN {
        let h = 0.02 * known.gap;
        let by_differences = slope(|t| polar_rotation(&(draw.m + x * t)), h);
        let error = (by_differences - dx).amax() * known.gap;
        tally.slope(number, "slope of R", error, 5e-6);
    }
}
