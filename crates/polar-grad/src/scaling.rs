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
        let scaling = Self::by(exponent_of_largest([m])?);
        Some((scaling, m * scaling.down))
    }

    /// Scales two matrices alike so that the largest entry of both is about one, by a power of four, of which square roots are exact
    /// too: the scaling and the scaled matrices, or `None` when an entry is not finite.
    pub(crate) fn to_unit_alike(
        a: &Matrix3<f64>,
        b: &Matrix3<f64>,
    ) -> Option<(Self, [Matrix3<f64>; 2])> {
        let scaling = Self::by(exponent_of_largest([a, b])? & !1);
        Some((scaling, [a * scaling.down, b * scaling.down]))
    }

    fn by(exponent: i64) -> Self {
        Self {
            up: power_of_two(exponent),
            down: power_of_two(-exponent),
        }
    }

    /// `up * x`, at most `f64::MAX` in size.
    pub(crate) fn restore(&self, x: f64) -> f64 {
        (self.up * x).clamp(-f64::MAX, f64::MAX)
    }
}

/// The exponent of the largest entry, such that both `2^e` and `2^-e` are normal numbers; `None` when an entry is not finite.
fn exponent_of_largest<const N: usize>(matrices: [&Matrix3<f64>; N]) -> Option<i64> {
    let mut entries = matrices.iter().flat_map(|m| m.iter());
    let largest = entries.try_fold(0.0_f64, |max, x| x.is_finite().then(|| max.max(x.abs())))?;
    let exponent = (largest.to_bits() >> MANTISSA_BITS) as i64 - BIAS;
    Some(exponent.clamp(-1022, 1022))
}

const MANTISSA_BITS: u32 = 52;
const BIAS: i64 = 1023;

/// `2^exponent` for a normal exponent.
fn power_of_two(exponent: i64) -> f64 {
    f64::from_bits(((exponent + BIAS) as u64) << MANTISSA_BITS)
}
