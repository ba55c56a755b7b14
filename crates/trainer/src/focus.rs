//! Where stage 1 looks, and how much each shape counts there.
//!
//! A closing lid or the corner of a mouth is one sample in a thousand: with points drawn evenly, the network leaves it out.

use crate::balance::Balance;
use crate::draw;
use crate::stage1::Pulled;
use rand::Rng;
use rand::distr::Distribution;
use rand::distr::weighted::WeightedIndex;

/// Draws sample points and weighs shapes.
pub struct Focus {
    shapes: Balance,
    /// Number of sample points.
    points: usize,
    /// Absent where every point is as likely.
    likely: Option<WeightedIndex<f64>>,
}

impl Focus {
    /// Draws the part `share` of the points in proportion to how much the training shapes stretch the body there, each against its own
    /// mean, and the rest evenly. Shapes count by their mean squared stretch and `balance`.
    pub fn new(targets: &[Pulled], share: f64, balance: f64) -> Self {
        let points = targets.first().map_or(0, |t| t.actuation.len() / 6);
        let squares: Vec<Vec<f64>> = targets.iter().map(squared_stretch).collect();
        let means = { squares.iter() }.map(|s| s.iter().sum::<f64>() / points.max(1) as f64);
        let shapes = Balance::new(&means.collect::<Vec<f64>>(), balance);
        let stretch = |point: usize| {
            let of = squares.iter().zip(shapes.shares());
            of.map(|(s, r)| s[point] / r).sum::<f64>().sqrt()
        };
        let likely = match share > 0.0 {
            true => likely(&(0..points).map(stretch).collect::<Vec<f64>>(), share),
            false => None,
        };
        Self {
            shapes,
            points,
            likely,
        }
    }

    /// What each shape counts.
    pub fn balance(&self) -> &Balance {
        &self.shapes
    }

    /// `count` sample points, with repetition.
    pub fn draw(&self, generator: &mut impl Rng, count: usize) -> Vec<usize> {
        match &self.likely {
            None => draw::indices(generator, self.points, count),
            Some(likely) => (0..count).map(|_| likely.sample(generator)).collect(),
        }
    }
}

/// Draws the part `share` in proportion to `stretch`, the rest evenly; nothing where nothing is stretched.
fn likely(stretch: &[f64], share: f64) -> Option<WeightedIndex<f64>> {
    let total: f64 = stretch.iter().sum();
    let chance = |s: &f64| (1.0 - share) / stretch.len() as f64 + share * s / total;
    match total > 0.0 {
        true => WeightedIndex::new(stretch.iter().map(chance)).ok(),
        false => None,
    }
}

/// `|S - 1|^2` at every sample.
fn squared_stretch(pulled: &Pulled) -> Vec<f64> {
    let of = |b: &[f32]| {
        let entries = b.iter().zip(TIMES);
        entries
            .map(|(&x, times)| times * f64::from(x).powi(2))
            .sum()
    };
    pulled.actuation.chunks_exact(6).map(of).collect()
}

/// How often the entries of a symmetric matrix stand in it.
pub(crate) const TIMES: [f64; 6] = [1.0, 2.0, 2.0, 1.0, 2.0, 1.0];

#[cfg(test)]
mod tests {
    use super::*;

    fn pulled(stretch: &[f32]) -> Pulled {
        let entries = stretch.iter().flat_map(|&s| [s, 0.0, 0.0, 0.0, 0.0, 0.0]);
        Pulled {
            nodes: Vec::new(),
            actuation: entries.collect(),
            joint: None,
        }
    }

    fn counts(focus: &Focus) -> Vec<usize> {
        let mut counts = vec![0; focus.points];
        for point in focus.draw(&mut draw::generator(1, 2, 3), 40_000) {
            counts[point] += 1;
        }
        counts
    }

    #[test]
    fn without_a_share_all_points_and_shapes_are_alike() {
        let focus = Focus::new(
            &[pulled(&[0.0, 0.0, 0.0, 3.0]), pulled(&[0.1; 4])],
            0.0,
            0.0,
        );
        let same = draw::indices(&mut draw::generator(1, 2, 3), 4, 100);
        assert_eq!(focus.draw(&mut draw::generator(1, 2, 3), 100), same);
        let counts = [0, 1].map(|shape| focus.balance().weight(shape));
        assert_eq!(counts, [1.0, 1.0]);
    }

    /// Point 3 has all the stretch: half of the points by its share, and an eighth of those drawn evenly.
    #[test]
    fn points_that_stretch_are_drawn_more_often() {
        let focus = Focus::new(&[pulled(&[0.0, 0.0, 0.0, 0.7])], 0.5, 0.0);
        let counts = counts(&focus);
        assert!(
            (f64::from(counts[3] as u32) / 40_000.0 - 0.625).abs() < 0.01,
            "{counts:?}"
        );
        assert!(
            (f64::from(counts[0] as u32) / 40_000.0 - 0.125).abs() < 0.01,
            "{counts:?}"
        );
    }

    /// However small the stretch of the second shape, its one place is drawn as often as that of the first.
    #[test]
    fn a_small_shape_is_seen_like_a_large_one() {
        let focus = Focus::new(
            &[pulled(&[1.0, 0.0, 0.0]), pulled(&[0.0, 0.05, 0.0])],
            0.6,
            0.5,
        );
        let counts = counts(&focus);
        let ratio = f64::from(counts[0] as u32) / f64::from(counts[1] as u32);
        assert!((ratio - 1.0).abs() < 0.05, "{counts:?}");
        let balance = focus.balance();
        assert!((balance.weight(1) / balance.weight(0) - 20.0).abs() < 1e-6);
    }

    #[test]
    fn shapes_at_rest_are_drawn_evenly() {
        let focus = Focus::new(&[pulled(&[0.0; 3])], 0.5, 0.5);
        assert_eq!(focus.balance().weight(0), 1.0);
        assert!(
            focus
                .draw(&mut draw::generator(1, 2, 3), 50)
                .iter()
                .all(|&i| i < 3)
        );
    }
}
