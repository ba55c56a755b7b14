//! Actuations given by formulas, to try a solver with.

use nalgebra::Vector3;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore, SeedableRng};
use std::f64::consts::TAU;

/// Waves that a random actuation is made of, per entry.
const WAVES: usize = 4;

/// Uniform in `[0, 1)`.
pub fn uniform(random: &mut ChaCha8Rng) -> f64 {
    (random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
}

/// The actuation b that bends, twists and swells a box, at a point with coordinates `c` in [0, 1]: with `s = 0.3 amplitude (2 c_z - 1)`,
/// A has the entries `xx = 1 + s`, `yy = 1 - 0.15 s`, `zz = 1 - 0.5 s`, `xy = 0.05 amplitude sin(2 pi c_x)`,
/// `yz = 0.05 amplitude cos(2 pi c_y)`, `xz = 0`.
pub fn bending(c: [f64; 3], amplitude: f64) -> [f64; 6] {
    let s = 0.3 * amplitude * (2.0 * c[2] - 1.0);
    let xy = 0.05 * amplitude * (TAU * c[0]).sin();
    let yz = 0.05 * amplitude * (TAU * c[1]).cos();
    [s, xy, 0.0, -0.15 * s, yz, -0.5 * s]
}

/// A smooth random actuation b at points within the box from `low` to `high`: each of the six entries is a sum of a few cosine waves over
/// the box, at most two periods along an axis, whose amplitudes add up to `amplitude`.
pub fn waves(
    points: &[Vector3<f64>],
    (low, high): (Vector3<f64>, Vector3<f64>),
    amplitude: f64,
    seed: u64,
) -> Vec<[f64; 6]> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut unit = || uniform(&mut random);
    let fields: [[(f64, Vector3<f64>, f64); WAVES]; 6] = std::array::from_fn(|_| {
        let mut waves = std::array::from_fn(|_| {
            let weight = 0.1 + unit();
            let periods = Vector3::from_fn(|_, _| 4.0 * unit() - 2.0);
            (weight, TAU * periods, TAU * unit())
        });
        let total: f64 = waves.iter().map(|wave| wave.0).sum();
        for wave in &mut waves {
            wave.0 *= amplitude / total;
        }
        waves
    });
    let extent = high - low;
    let at = |x: &Vector3<f64>| {
        let c = (x - low).component_div(&extent);
        let wave =
            |&(weight, k, phase): &(f64, Vector3<f64>, f64)| weight * (k.dot(&c) + phase).cos();
        fields.each_ref().map(|waves| waves.iter().map(wave).sum())
    };
    points.iter().map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waves_stay_within_their_amplitude_and_depend_on_the_seed() {
        let points: Vec<_> = (0..200)
            .map(|i| Vector3::new(0.01 * f64::from(i), (f64::from(i)).sin(), 0.5))
            .collect();
        let bounds = (Vector3::new(0.0, -1.0, 0.0), Vector3::new(2.0, 1.0, 1.0));
        let field = waves(&points, bounds, 0.3, 7);
        let largest = field.iter().flatten().fold(0.0, |m: f64, x| m.max(x.abs()));
        assert!(largest <= 0.3 && largest > 0.1, "{largest}");
        assert_eq!(field, waves(&points, bounds, 0.3, 7));
        assert_ne!(field, waves(&points, bounds, 0.3, 8));
    }

    #[test]
    fn bending_swells_one_side_and_shrinks_the_other() {
        assert_eq!(bending([0.0, 0.25, 1.0], 1.0)[0], 0.3);
        assert_eq!(bending([0.0, 0.25, 0.0], 2.0)[0], -0.6);
    }
}
