//! The smallest sum of two singular values over many samples: how near one of them is to where its rotation is not unique.
//!
//! It is the smallest eigenvalue of all `T = B^-1`, and known here to about 1e-12 of itself. Lanes give bounds; the exact scalar
//! function is asked only for samples that may be the smallest when all are seen.

use nalgebra::Matrix3;
use polar_grad::RotationGradient;
use polar_grad::lanes::{LaneMatrix, SymmetricLanes, symmetric_adjugate};
use pulp::Simd;

/// Sums below this fraction of the norm were perhaps raised in B: what B says of them is not believed.
const RAISED: f64 = 1e-9;
/// The same for all sums whose square is below this.
const RAISED2_MIN: f64 = 1e-280;
/// Relative error of a pair sum by the rounding of B.
const ROUNDOFF: f64 = 1e-12;
/// Bound on the rounding of `d + 2` in [`sharp_bound`].
const CUBIC_ROUNDOFF: f64 = 1e-14;
/// A sharp bound is at most this far below what it bounds, relative to it.
const GAP: f64 = 1e-6;
/// Newton steps from an error of at most 16 %: 1.1 %, 7e-5, 3e-9.
const ROOT_STEPS: usize = 3;

/// What is known of the samples seen so far.
pub(super) struct LeastPairSum {
    /// The smallest of the values asked for.
    exact: f64,
    /// A lower bound below that, and the matrix it is of.
    candidate: Option<(f64, Matrix3<f64>)>,
    /// Only lower bounds below this matter.
    level: f64,
}

impl LeastPairSum {
    /// Nothing seen.
    pub(super) fn new() -> Self {
        Self {
            exact: f64::INFINITY,
            candidate: None,
            level: f64::INFINITY,
        }
    }

    /// Takes note of the matrices `m` whose derivatives have the factor `b`.
    #[inline(always)]
    pub(super) fn see<S: Simd>(&mut self, simd: S, m: &LaneMatrix<S>, b: &SymmetricLanes<S>) {
        let spectrum = Spectrum::of(simd, b);
        let crude = crude_bound(simd, &spectrum);
        let level = simd.splat_f64s(self.level);
        let raised = perhaps_raised(simd, m, crude);
        let look = simd.or_m64s(simd.less_than_f64s(crude, level), raised);
        if simd.first_true_m64s(look) == S::F64_LANES {
            return;
        }
        let sharp = sharp_bound(simd, b, &spectrum);
        // Zero for lanes that must be asked for.
        let bound = simd.select_f64s(raised, simd.splat_f64s(0.0), sharp);
        let below = simd.less_than_f64s(bound, level);
        if simd.first_true_m64s(below) != S::F64_LANES {
            self.consider::<S>(m, bound);
        }
    }

    /// The smallest pair sum of all matrices seen; infinite when there was none (or none without NaN).
    pub(super) fn finish(self) -> f64 {
        let last = self.candidate.map(|(_, m)| pair_sum(&m));
        last.map_or(self.exact, |last| last.min(self.exact))
    }

    #[cold]
    #[inline(never)]
    fn consider<S: Simd>(&mut self, m: &LaneMatrix<S>, bound: S::f64s) {
        let lane = |v: &S::f64s, i: usize| {
            pulp::bytemuck::cast_slice::<S::f64s, f64>(std::slice::from_ref(v))[i]
        };
        for i in 0..S::F64_LANES {
            let bound = lane(&bound, i);
            if bound < self.level {
                let m = Matrix3::from_fn(|row, column| lane(&m[3 * row + column], i));
                self.consider_one(bound, m);
            }
        }
    }

    /// A matrix that may have the smallest sum so far; at least `bound`.
    fn consider_one(&mut self, bound: f64, m: Matrix3<f64>) {
        if bound == 0.0 {
            self.exact = self.exact.min(pair_sum(&m));
        } else {
            let at_most = bound * (1.0 + GAP);
            if let Some((other, rival)) = self.candidate.replace((bound, m))
                && other <= at_most
            {
                self.exact = self.exact.min(pair_sum(&rival));
            }
        }
        let at_most = self
            .candidate
            .map_or(f64::INFINITY, |(b, _)| b * (1.0 + GAP));
        self.level = self.exact.min(at_most) * (1.0 - 2.0 * ROUNDOFF);
    }
}

fn pair_sum(m: &Matrix3<f64>) -> f64 {
    RotationGradient::at(m).smallest_pair_sum
}

/// What makes the eigenvalues of B: `mean + deviation * z` with the three roots of `z^3 - 3 z = d`, where d is the determinant of
/// the deviator over `deviation^3`.
struct Spectrum<S: Simd> {
    /// `tr(B) / 3`.
    mean: S::f64s,
    /// `|B - mean I| / sqrt(6)`.
    deviation: S::f64s,
}

impl<S: Simd> Spectrum<S> {
    #[inline(always)]
    fn of(simd: S, b: &SymmetricLanes<S>) -> Self {
        let trace = simd.add_f64s(simd.add_f64s(b[0], b[3]), b[5]);
        let mean = simd.mul_f64s(trace, simd.splat_f64s(1.0 / 3.0));
        let mut square = simd.mul_f64s(b[1], b[1]);
        square = simd.mul_add_e_f64s(b[2], b[2], square);
        square = simd.mul_add_e_f64s(b[4], b[4], square);
        square = simd.add_f64s(square, square);
        for k in [0, 3, 5] {
            let off = simd.sub_f64s(b[k], mean);
            square = simd.mul_add_e_f64s(off, off, square);
        }
        let deviation = simd.sqrt_f64s(simd.mul_f64s(square, simd.splat_f64s(1.0 / 6.0)));
        Self { mean, deviation }
    }
}

/// A lower bound of the smallest eigenvalue of `B^-1`, at least three quarters of it: z is at most 2.
#[inline(always)]
fn crude_bound<S: Simd>(simd: S, spectrum: &Spectrum<S>) -> S::f64s {
    let two = simd.splat_f64s(2.0);
    let largest = simd.mul_add_e_f64s(two, spectrum.deviation, spectrum.mean);
    simd.div_f64s(simd.splat_f64s(1.0 - ROUNDOFF), largest)
}

/// A lower bound of the smallest eigenvalue of `B^-1`, at most a fraction [`GAP`] below it.
///
/// The largest root is `z = 1 + y` with `y^2 (y + 3) = d + 2`. Newton from `sqrt((d + 2) / 3)`, which is above it, stays above,
/// and so does the root of a right-hand side that is too large by more than its rounding.
#[inline(always)]
fn sharp_bound<S: Simd>(simd: S, b: &SymmetricLanes<S>, spectrum: &Spectrum<S>) -> S::f64s {
    let splat = |x: f64| simd.splat_f64s(x);
    // Where all eigenvalues are equal, d is any number, and does not matter.
    let tiny = simd.mul_f64s(spectrum.mean, splat(1e-30));
    let inverse = simd.div_f64s(splat(1.0), simd.add_f64s(spectrum.deviation, tiny));
    let mut deviator = *b;
    for k in [0, 3, 5] {
        deviator[k] = simd.sub_f64s(b[k], spectrum.mean);
    }
    for entry in &mut deviator {
        *entry = simd.mul_f64s(*entry, inverse);
    }
    let (_, d) = symmetric_adjugate(simd, &deviator);
    let right = simd.add_f64s(d, splat(2.0 + CUBIC_ROUNDOFF));
    let right = simd.max_f64s(right, splat(CUBIC_ROUNDOFF));
    let mut y = simd.sqrt_f64s(simd.mul_f64s(right, splat(1.0 / 3.0)));
    for _ in 0..ROOT_STEPS {
        // y - f/f' = (2 y^3 + 3 y^2 + right) / (3 y^2 + 6 y)
        let y2 = simd.mul_f64s(y, y);
        let y3 = simd.mul_add_e_f64s(splat(2.0), y, splat(3.0));
        let above = simd.mul_add_e_f64s(y2, y3, right);
        let below = simd.mul_f64s(splat(3.0), simd.mul_add_e_f64s(splat(2.0), y, y2));
        y = simd.div_f64s(above, below);
    }
    let root = simd.add_f64s(splat(1.0), y);
    let largest = simd.mul_add_e_f64s(root, spectrum.deviation, spectrum.mean);
    simd.div_f64s(splat(1.0 - ROUNDOFF), largest)
}

/// Where a bound is so small that it may come from a B whose eigenvalues were raised.
#[inline(always)]
fn perhaps_raised<S: Simd>(simd: S, m: &LaneMatrix<S>, bound: S::f64s) -> S::m64s {
    let mut norm2 = simd.mul_f64s(m[0], m[0]);
    for x in &m[1..] {
        norm2 = simd.mul_add_e_f64s(*x, *x, norm2);
    }
    let fraction = simd.splat_f64s(RAISED * RAISED);
    let level = simd.mul_add_e_f64s(norm2, fraction, simd.splat_f64s(RAISED2_MIN));
    simd.less_than_f64s(simd.mul_f64s(bound, bound), level)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Rotation3, Vector3};
    use polar_grad::lanes::{polar_rotation_lanes, rotation_factor_lanes};
    use pulp::Scalar;

    /// Sums that are simple, double, triple, tiny and zero, among others a little above or below them, in both orders.
    #[test]
    fn the_smallest_is_found_in_any_order() {
        let classes = [
            [1.0, 1.0, 1.0],
            [1.0, 1.0, 0.5],
            [2.0, 0.7, 0.7],
            [1.3, 0.9, -0.4],
            [2.0, 1.0, -1.0 + 1e-7],
            [1.0, 1.0, -1.0 + 1e-12],
            [1.0, 0.5, -0.5],
            [1e-170, 1e-170, 0.0],
        ];
        for sigma in classes {
            for nearby in [1e-3, 1e-7, 1e-10] {
                let mut matrices = Vec::new();
                for i in 0..40 {
                    let size = 1.0 + nearby * f64::from(i % 7);
                    let diagonal = Vector3::from(sigma).map(|s| s * size);
                    let turn = Rotation3::from_euler_angles(f64::from(i), 0.3, 1.7).into_inner();
                    let other = Rotation3::from_euler_angles(1.1, f64::from(i), 0.2).into_inner();
                    matrices.push(turn * Matrix3::from_diagonal(&diagonal) * other);
                }
                let exact = matrices.iter().map(pair_sum).fold(f64::INFINITY, f64::min);
                for _ in 0..2 {
                    matrices.reverse();
                    let mut smallest = LeastPairSum::new();
                    for m in &matrices {
                        let m: [f64; 9] = std::array::from_fn(|k| m[(k / 3, k % 3)]);
                        let rotation = polar_rotation_lanes(Scalar, &m);
                        let b = rotation_factor_lanes(Scalar, &rotation, &m).factor;
                        smallest.see(Scalar, &m, &b);
                    }
                    let found = smallest.finish();
                    let error = (found - exact).abs();
                    assert!(
                        error <= 4e-12 * exact,
                        "{sigma:?} {nearby} {found:e} {exact:e}"
                    );
                }
            }
        }
    }
}
