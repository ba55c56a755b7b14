//! Random choices that depend on nothing but the seed and the place in training, so that a resumed run makes the same ones.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A generator for one place: a stream (what it is for) and a position in it.
pub fn generator(seed: u64, stream: u64, position: u64) -> ChaCha8Rng {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    generator.set_stream(stream);
    // A position owns 2^36 words, more than any step draws.
    generator.set_word_pos(u128::from(position) << 36);
    generator
}

/// A random order of `0..n` (Fisher and Yates).
pub fn order(generator: &mut impl Rng, n: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..n).collect();
    for i in (1..n).rev() {
        order.swap(i, generator.random_range(0..=i));
    }
    order
}

/// `count` indices below `n`, with repetition.
pub fn indices(generator: &mut impl Rng, n: usize, count: usize) -> Vec<usize> {
    (0..count).map(|_| generator.random_range(0..n)).collect()
}

/// A learning rate that falls from `first` to 0 along half a cosine.
pub fn decayed(first: f64, step: u64, steps: u64) -> f64 {
    let part = step as f64 / steps.max(1) as f64;
    first * 0.5 * (1.0 + (std::f64::consts::PI * part).cos())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn choices_depend_on_the_place_alone() {
        let draw = |position| order(&mut generator(3, 1, position), 20);
        assert_eq!(draw(5), draw(5));
        assert_ne!(draw(5), draw(6));
        let mut sorted = draw(7);
        sorted.sort_unstable();
        assert_eq!(sorted, (0..20).collect::<Vec<_>>());
    }

    #[test]
    fn the_rate_decays_to_zero() {
        assert_eq!(decayed(2.0, 0, 10), 2.0);
        assert!(decayed(2.0, 10, 10).abs() < 1e-15);
    }
}
