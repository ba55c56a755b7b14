//! Exact scaling by powers of two, so that squares and quartics neither overflow nor underflow.

use nalgebra::Matrix3;

/// A power of two and its reciprocal, both exact.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scaling {
    /// What the scaled matrix must be multiplied by to get the original.
    pub(crate) up: f64,
    /// What the original was multiplied by.
    pub(crate) down: f64,
}

impl Scaling {
    /// Scales the largest entry of `m` to about one (a denormal one to at least `2^-52`): the
    /// scaling and the scaled matrix, or `None` when an entry is not finite.
    pub(crate) fn to_unit(m: &Matrix3<f64>) -> Option<(Self, Matrix3<f64>)> {
        if !m.iter().all(|x| x.is_finite()) {
            return None;
        }
        let largest = m.iter().fold(0.0_f64, |max, x| max.max(x.abs()));
        let exponent = (largest.to_bits() >> MANTISSA_BITS) as i64 - BIAS;
        // Both 2^e and 2^-e must be normal numbers.
        let exponent = exponent.clamp(-1022, 1022);
        let scaling = Self {
            up: power_of_two(exponent),
            down: power_of_two(-exponent),
        };
        Some((scaling, m * scaling.down))
    }

    /// `up * x`, at most `f64::MAX` in size.
    pub(crate) fn restore(&self, x: f64) -> f64 {
        (self.up * x).clamp(-f64::MAX, f64::MAX)
    }
}

const MANTISSA_BITS: u32 = 52;
const BIAS: i64 = 1023;

/// `2^exponent` for a normal exponent.
fn power_of_two(exponent: i64) -> f64 {
    f64::from_bits(((exponent + BIAS) as u64) << MANTISSA_BITS)
}
