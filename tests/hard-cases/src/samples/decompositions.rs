//! The signed singular value decomposition and the polar rotation.

use super::draws::{Draw, Planted, exponent, scaled, times_power};
use super::finite;
use super::tally::Tally;
use nalgebra::Matrix3;
use polar_grad::{polar, polar_rotation, signed_svd};

/// What is known of a matrix once its decompositions were checked, in units in which its largest entry is about one.
pub struct Known {
    /// `2^-exponent M`.
    pub unit: Matrix3<f64>,
    pub exponent: i32,
    /// Its decomposition: the planted one, or that of [`signed_svd`].
    pub svd: Planted,
    /// `(s_y + s_z) / s_x`; zero for the zero matrix.
    pub gap: f64,
    /// Half a unit in the last place of the original's smallest numbers, in the new unit.
    pub rounding: f64,
}

/// `max |R^T R - I|`, or infinity when `R` is no rotation.
pub fn distance_from_rotation(r: &Matrix3<f64>) -> f64 {
    if finite(r) && r.determinant() > 0.0 {
        (r.tr_mul(r) - Matrix3::identity()).amax()
    } else {
        f64::INFINITY
    }
}

/// What is left of an error beyond what is allowed anyway; NaN stays.
pub fn beyond(error: f64, allowed: f64) -> f64 {
    if error <= allowed {
        0.0
    } else {
        error - allowed
    }
}

pub fn check(tally: &mut Tally, number: u64, draw: &Draw) -> Known {
    let m = &draw.m;
    let e = exponent(m);
    let unit = scaled(m, -e);
    let rounding = times_power(1.0, -1074 - e).min(1.0);

    let svd = signed_svd(m);
    tally.check(number, "U in SO(3)", distance_from_rotation(&svd.u), 5e-15);
    tally.check(number, "V in SO(3)", distance_from_rotation(&svd.v), 5e-15);
    let s = svd.sigma;
    tally.require(
        number,
        "s_x >= s_y >= |s_z|, finite",
        s.x.is_finite() && s.x >= s.y && s.y >= s.z.abs(),
    );
    // A value beyond the largest number is given as that; the scaled matrix has them all.
    let saturated = s.x == f64::MAX;
    let sigma = if saturated {
        signed_svd(&unit).sigma
    } else {
        s.map(|x| times_power(x, -e))
    };
    let back = svd.u * Matrix3::from_diagonal(&sigma) * svd.v.transpose();
    let error = beyond((back - unit).amax(), 2.0 * rounding);
    tally.check(number, "U diag(s) V^T = M", error, 8e-15);
    let found = Planted {
        u: svd.u,
        sigma,
        v: svd.v,
    };
    let known = draw.planted.map_or(found, |planted| Planted {
        sigma: planted.sigma.map(|x| times_power(x, -e)),
        ..planted
    });
    let largest = known.sigma.x;
    if draw.planted.is_some() {
        let error = (sigma - known.sigma).amax() / largest;
        tally.check(number, "planted singular values", error, 8e-15);
        if known.sigma.z.abs() > 1e-14 * largest {
            let same = (s.z < 0.0) == (known.sigma.z < 0.0);
            tally.require(number, "sign of the determinant", same);
        }
    }
    let gap = if largest == 0.0 {
        0.0
    } else {
        ((known.sigma.y + known.sigma.z) / largest).max(0.0)
    };
    let known = Known {
        unit,
        exponent: e,
        svd: known,
        gap,
        rounding,
    };
    rotation(tally, number, m, &known);
    known
}

fn rotation(tally: &mut Tally, number: u64, m: &Matrix3<f64>, known: &Known) {
    let r = polar_rotation(m);
    let unit = &known.unit;
    tally.check(number, "R in SO(3)", distance_from_rotation(&r), 5e-15);
    let s = r.tr_mul(unit);
    let asymmetry = (s - s.transpose()).amax();
    tally.check(number, "R^T M symmetric", asymmetry, 1e-14);
    // |M - R|^2 = |M|^2 + 3 - 2 tr(R^T M), but without cancellation.
    let planted = known.svd.rotation();
    let lost = planted.dot(unit) - s.trace();
    tally.check(number, "no rotation is nearer", lost.max(0.0), 2e-14);
    if known.gap > 1e-12 {
        let error = (r - planted).amax() / (1.0 + 1.0 / known.gap);
        tally.check(number, "R = U V^T where unique", error, 1e-14);
    }

    let polar = polar(m);
    tally.require(number, "polar has the same R", polar.rotation == r);
    let stretch = polar.stretch;
    tally.require(
        number,
        "S symmetric, finite",
        stretch == stretch.transpose() && finite(&stretch),
    );
    if stretch.amax() < f64::MAX {
        let s = scaled(&stretch, -known.exponent);
        let error = beyond((r * s - unit).amax(), 4.0 * known.rounding);
        tally.check(number, "R S = M", error, 2e-14);
        let planted =
            known.svd.v * Matrix3::from_diagonal(&known.svd.sigma) * known.svd.v.transpose();
        if known.gap > 1e-12 {
            let error = beyond((s - planted).amax(), 4.0 * known.rounding);
            let error = error / (1.0 + 1.0 / known.gap);
            tally.check(number, "S = V diag(s) V^T", error, 2e-14);
        }
    }
}
