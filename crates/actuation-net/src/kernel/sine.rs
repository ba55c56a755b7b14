//! Sine and cosine of one f32 by argument reduction and polynomials, free of branches so that loops over them vectorise.
//!
//! `x = k pi + r` with `|r| <= pi/2`; then `sin x = (-1)^k sin r` and `cos x = (-1)^k cos r`, both by minimax polynomials.

use std::f32::consts::{FRAC_1_PI, FRAC_PI_2};

/// `1.5 * 2^23`: adding it rounds to a whole number, which then sits in the lowest bits.
const ROUND: f32 = 12_582_912.0;
/// pi in three parts; the first two are short, so that their products with `k` are exact while `|k| < 2^14`.
const PI_PARTS: [f32; 3] = [3.140_625, 9.670_257_6e-4, 6.277_114e-7];

/// `a * b + c`, rounded once if `FMA`.
#[inline(always)]
pub(super) fn fma<const FMA: bool>(a: f32, b: f32, c: f32) -> f32 {
    if FMA { a.mul_add(b, c) } else { a * b + c }
}

/// The remainder `r` and the sign bit of `(-1)^k`.
///
/// Beyond the range where the parts of pi are enough (about 1e5) `r` would leave the polynomials' interval; cutting it keeps
/// the result bounded. NaN and infinity come out as NaN.
#[inline(always)]
fn reduce<const FMA: bool>(x: f32) -> (f32, u32) {
    let rounded = fma::<FMA>(x, FRAC_1_PI, ROUND);
    let k = rounded - ROUND;
    let r = fma::<FMA>(k, -PI_PARTS[0], x);
    let r = fma::<FMA>(k, -PI_PARTS[1], r);
    let r = fma::<FMA>(k, -PI_PARTS[2], r);
    (r.clamp(-LIMIT, LIMIT), rounded.to_bits() << 31)
}

/// A little above pi/2, for the rounding of `k`.
const LIMIT: f32 = FRAC_PI_2 + 1e-3;

/// `sin r` for `|r| <= pi/2`, `r2 = r^2`; the polynomial, fitted with f32 coefficients, is off by 8e-9,
/// the rest is rounding.
#[inline(always)]
fn sine_polynomial<const FMA: bool>(r: f32, r2: f32) -> f32 {
    let p = fma::<FMA>(r2, 2.605_166_2e-6, -1.980_904_6e-4);
    let p = fma::<FMA>(r2, p, 8.333_051e-3);
    let p = fma::<FMA>(r2, p, -1.666_665_8e-1);
    fma::<FMA>(r * r2, p, r)
}

/// `cos r` for `|r| <= pi/2`, `r2 = r^2`; the polynomial (Remez exchange) is off by 4e-10, the rest is rounding.
#[inline(always)]
fn cosine_polynomial<const FMA: bool>(r2: f32) -> f32 {
    let p = fma::<FMA>(r2, -2.619_328_3e-7, 2.476_927_9e-5);
    let p = fma::<FMA>(r2, p, -1.388_856_9e-3);
    let p = fma::<FMA>(r2, p, 4.166_665_6e-2);
    let p = fma::<FMA>(r2, p, -0.5);
    fma::<FMA>(r2, p, 1.0)
}

#[inline(always)]
pub(super) fn sine<const FMA: bool>(x: f32) -> f32 {
    let (r, sign) = reduce::<FMA>(x);
    f32::from_bits(sine_polynomial::<FMA>(r, r * r).to_bits() ^ sign)
}

#[inline(always)]
pub(super) fn sine_cosine<const FMA: bool>(x: f32) -> (f32, f32) {
    let (r, sign) = reduce::<FMA>(x);
    let r2 = r * r;
    (
        f32::from_bits(sine_polynomial::<FMA>(r, r2).to_bits() ^ sign),
        f32::from_bits(cosine_polynomial::<FMA>(r2).to_bits() ^ sign),
    )
}
