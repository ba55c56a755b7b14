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

/// Share of a stage over which its learning rate rises: Adam's first steps have the full size of the rate whatever the gradient,
/// and would undo a part of what the weights know already.
const WARM_UP: f64 = 0.05;

/// A learning rate that rises to `first` over the first steps and falls to 0 along half a cosine.
pub fn decayed(first: f64, step: u64, steps: u64) -> f64 {
    let part = step as f64 / steps.max(1) as f64;
    let rise = ((part + 1.0 / steps.max(1) as f64) / WARM_UP).min(1.0);
    first * rise * 0.5 * (1.0 + (std::f64::consts::PI * part).cos())
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
    fn seeds_streams_and_positions_have_their_own_numbers() {
        let first = |seed, stream, position| -> u64 { generator(seed, stream, position).random() };
        let all = [
            first(1, 1, 0),
            first(2, 1, 0),
            first(1, 2, 0),
            first(1, 1, 1),
        ];
        for (i, a) in all.iter().enumerate() {
            assert!(all[..i].iter().all(|b| a != b), "{all:?}");
        }
        // More numbers than a step draws end long before those of the next position.
        let mut long = generator(1, 1, 7);
        let _ = (0..100_000).map(|_| long.random::<u64>()).last();
        assert!(long.get_word_pos() < generator(1, 1, 8).get_word_pos());
        assert_eq!(generator(1, 1, 8).get_word_pos(), 8 << 36);
    }

    #[test]
    fn every_order_is_as_likely() {
        let mut counts = [0; 6];
        for position in 0..6000 {
            let drawn = order(&mut generator(9, 1, position), 3);
            counts[2 * drawn[0] + usize::from(drawn[1] > drawn[2])] += 1;
        }
        // Five standard deviations of a count.
        assert!(
            counts.iter().all(|&n| (n - 1000_i32).abs() < 145),
            "{counts:?}"
        );
    }

    #[test]
    fn indices_stay_below_their_bound() {
        let drawn = indices(&mut generator(1, 2, 0), 5, 1000);
        assert_eq!(drawn.len(), 1000);
        assert!((0..5).all(|i| drawn.contains(&i)));
        assert!(drawn.iter().all(|&i| i < 5));
    }

    #[test]
    fn the_rate_decays_to_zero() {
        assert_eq!(decayed(2.0, 0, 10), 2.0);
        assert!(decayed(2.0, 10, 10).abs() < 1e-15);
        assert!((decayed(2.0, 0, 1000) - 0.04).abs() < 1e-15);
        assert!(decayed(2.0, 100, 1000) > decayed(2.0, 101, 1000));
    }
}
