//! The nearest matrix of determinant 1, and its derivative.
//!
//! With the signed singular values s of F, those of the nearest D are roots of `d_i^2 - s_i d_i = m` with one multiplier m for which their product
//! is 1. The larger root is positive whatever the sign of `s_i` (for m > 0), so that what is turned inside out is turned back.

use nalgebra::{Matrix3, Vector3};
use polar_grad::{SignedSvd, signed_svd};

/// Iterations of the search for the multiplier; bisection alone would need as many for a result to the last digit.
const MAX_ITERATIONS: usize = 200;
/// Logarithm of the determinant that is 1 up to roundoff.
const ROUNDOFF: f64 = 4.0 * f64::EPSILON;

/// F by its singular values, and those of the nearest matrix of determinant 1.
#[derive(Clone, Copy)]
pub(super) struct Projection {
    svd: SignedSvd,
    /// Singular values of the nearest matrix.
    d: Vector3<f64>,
    /// `2 d_i - s_i`, the roots of the discriminants with their signs.
    roots: Vector3<f64>,
}

impl Projection {
    pub(super) fn new(f: &Matrix3<f64>) -> Self {
        let svd = signed_svd(f);
        let d = nearest(&svd.sigma);
        Self {
            roots: 2.0 * d - svd.sigma,
            svd,
            d,
        }
    }

    /// The nearest matrix of determinant 1.
    pub(super) fn nearest(&self) -> Matrix3<f64> {
        self.svd.u * Matrix3::from_diagonal(&self.d) * self.svd.v.transpose()
    }

    /// Its change for a change of F.
    pub(super) fn derivative(&self, df: &Matrix3<f64>) -> Matrix3<f64> {
        let (s, d, r) = (&self.svd.sigma, &self.d, &self.roots);
        let x = self.svd.u.tr_mul(df) * self.svd.v;
        let mut y = Matrix3::zeros();
        // d_i = f(s_i, m): f_s = d / r, f_m = 1 / r; the sum of dd_i / d_i is zero.
        let over_root = Vector3::from_fn(|i, _| x[(i, i)] / r[i]);
        let total: f64 = (0..3).map(|i| (d[i] * r[i]).recip()).sum();
        let multiplier = -over_root.sum() / total;
        for i in 0..3 {
            y[(i, i)] = d[i] * over_root[i] + multiplier / r[i];
            for j in 0..i {
                let (symmetric, skew) = (x[(i, j)] + x[(j, i)], x[(i, j)] - x[(j, i)]);
                let together = quotient(s[i] + s[j], r[i] + r[j]);
                let apart = quotient(d[i] + d[j], s[i] + s[j]);
                let (a, b) = (0.25 * (1.0 + together) * symmetric, 0.5 * apart * skew);
                y[(i, j)] = a + b;
                y[(j, i)] = a - b;
            }
        }
        self.svd.u * y * self.svd.v.transpose()
    }

    /// How near the rotation of F is to being not unique.
    pub(super) fn smallest_pair_sum(&self) -> f64 {
        self.svd.sigma.y + self.svd.sigma.z
    }
}

/// A quotient that stays finite: where the divisor is zero the nearest matrix is not unique, and has no derivative.
fn quotient(a: f64, b: f64) -> f64 {
    let least = f64::EPSILON * a.abs().max(f64::MIN_POSITIVE);
    a / if b.abs() < least {
        least.copysign(b)
    } else {
        b
    }
}

/// The positive root of `d^2 - s d = m`, the larger one where there are two; without cancellation.
fn larger(s: f64, m: f64) -> f64 {
    let root = (s * s + 4.0 * m).max(0.0).sqrt();
    if s >= 0.0 {
        0.5 * (s + root)
    } else {
        2.0 * m / (root - s)
    }
}

/// Singular values of the nearest matrix of determinant 1.
fn nearest(s: &Vector3<f64>) -> Vector3<f64> {
    let at = |m: f64| s.map(|s| larger(s, m));
    let smallest = s.z;
    // All roots are real down to here, and positive above it.
    let least = if smallest > 0.0 {
        -0.25 * smallest * smallest
    } else {
        0.0
    };
    let log = |d: &Vector3<f64>| d.iter().map(|d| d.ln()).sum::<f64>();
    if smallest > 0.0 && log(&at(least)) > 0.0 {
        return beyond(s, least);
    }
    // With m = 1 - s_i for the largest s_i no root is above 1, for the smallest none below.
    let (mut low, mut high) = ((1.0 - s.x).max(least), 1.0 - smallest);
    let mut m = if smallest > 0.0 {
        0.0f64.clamp(low, high)
    } else {
        0.5 * (low + high)
    };
    let mut d = at(m);
    for _ in 0..MAX_ITERATIONS {
        let value = log(&d);
        if value.abs() <= ROUNDOFF || high <= low {
            break;
        }
        if value > 0.0 {
            high = m
        } else {
            low = m
        }
        let slope: f64 = (0..3).map(|i| (d[i] * (2.0 * d[i] - s[i])).recip()).sum();
        let newton = m - value / slope;
        m = if newton > low && newton < high {
            newton
        } else {
            0.5 * (low + high)
        };
        if m == low || m == high {
            break;
        }
        d = at(m);
    }
    d
}

/// More than eight times the volume: no positive multiplier is wanted, and the smallest value takes the smaller root.
fn beyond(s: &Vector3<f64>, least: f64) -> Vector3<f64> {
    let at = |m: f64| {
        let root = (s.z * s.z + 4.0 * m).max(0.0).sqrt();
        Vector3::new(larger(s.x, m), larger(s.y, m), -2.0 * m / (s.z + root))
    };
    let (mut low, mut high) = (least, 0.0);
    for _ in 0..MAX_ITERATIONS {
        let m = 0.5 * (low + high);
        if m == low || m == high {
            break;
        }
        if at(m).product() > 1.0 {
            low = m
        } else {
            high = m
        }
    }
    at(0.5 * (low + high))
}

#[cfg(test)]
mod tests {
    use super::*;
    use polar_grad::testing::Random;

    fn distance_to(f: &Matrix3<f64>, d: &Matrix3<f64>) -> f64 {
        (f - d).norm_squared()
    }

    /// Of determinant 1, and no matrix of determinant 1 nearby is nearer.
    #[test]
    fn nearest_has_determinant_one_and_is_nearest() {
        let mut random = Random::new(3);
        for case in 0..2000 {
            let scale = [0.3, 1.0, 3.0, 1e-3, 50.0][case % 5];
            let f = random.matrix() * scale;
            let d = Projection::new(&f).nearest();
            let size = d.norm().powi(3);
            assert!(
                (d.determinant() - 1.0).abs() < 1e-12 * size.max(1.0),
                "{f} {d}"
            );
            let least = distance_to(&f, &d);
            for _ in 0..20 {
                let near = d + random.matrix() * 1e-3 * d.norm();
                let near = near / near.determinant().cbrt();
                assert!(distance_to(&f, &near) >= least * (1.0 - 1e-12), "{f} {d}");
            }
        }
    }

    #[test]
    fn rotations_stay_and_reflections_are_turned_back() {
        let r = polar_grad::testing::rotation(5);
        assert!((Projection::new(&r).nearest() - r).norm() < 1e-14);
        let mirror = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0));
        assert!((Projection::new(&mirror).nearest().determinant() - 1.0).abs() < 1e-13);
        let crushed = Projection::new(&Matrix3::zeros()).nearest();
        assert!((crushed.determinant() - 1.0).abs() < 1e-13);
        for size in [1e-8, 1e8, 20.0, 8.0] {
            let d = Projection::new(&(r * size)).nearest();
            assert!(
                (d.determinant() - 1.0).abs() < 1e-12 * d.norm().powi(3),
                "{size}"
            );
        }
    }

    #[test]
    fn derivative_is_the_slope() {
        let mut random = Random::new(4);
        for case in 0..500 {
            let f = match case % 4 {
                0 => random.rotation(),
                1 => Matrix3::from_diagonal(&Vector3::new(1.3, 1.3, 0.4)),
                _ => random.matrix() + Matrix3::identity() * 0.3,
            };
            let p = Projection::new(&f);
            if p.smallest_pair_sum() < 0.1 || p.roots.min() < 0.1 {
                continue;
            }
            let df = random.matrix();
            let h = 1e-4;
            let at = |t: f64| Projection::new(&(f + df * t)).nearest();
            let slope = (8.0 * (at(h) - at(-h)) - (at(2.0 * h) - at(-2.0 * h))) / (12.0 * h);
            let error = (slope - p.derivative(&df)).norm();
            assert!(error < 1e-7 * df.norm(), "{f} {error}");
        }
    }

    /// Whatever the size of both: the bound on what is divided by is relative.
    #[test]
    fn quotients_are_plain_until_the_divisor_is_lost_in_roundoff() {
        for size in [1e-200, 1e-12, 1.0, 1e12, 1e200] {
            for ratio in [1e-9, -0.7, 3.0, -1e9] {
                let found = quotient(size, size * ratio) * ratio;
                assert!((found - 1.0).abs() < 1e-14, "{size} {ratio}");
            }
            assert!(quotient(size, 0.0).is_finite() && quotient(size, -0.0) < 0.0);
        }
        assert_eq!(quotient(0.0, 0.0), 0.0);
    }
}
