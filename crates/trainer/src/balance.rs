//! How much shapes count beside each other.
//!
//! A blink stretches the body a thousandth of what an opening jaw does. Counted alike, the network leaves such shapes out: what they would
//! take off the loss is less than what the large ones leave in it.

use crate::body::Body;
use crate::shapes::Shape;

/// The least share of the mean square that a shape is taken for: one that does next to nothing must not outweigh the rest.
const LEAST_SHARE: f64 = 1e-4;

/// What each shape counts in the mean over all, given the mean square of what it does: `(square / mean of the squares)^-balance`. With a
/// balance of 0 absolute errors count alike, with 1 relative ones.
#[derive(Debug, Clone, PartialEq)]
pub struct Balance {
    /// Each square's share of their mean.
    shares: Vec<f64>,
    balance: f64,
}

impl Balance {
    /// Shapes with these mean squares; they count alike where all of them are zero.
    pub fn new(squares: &[f64], balance: f64) -> Self {
        let mean = squares.iter().sum::<f64>() / squares.len().max(1) as f64;
        let share = |square: &f64| match mean > 0.0 {
            true => (square / mean).max(LEAST_SHARE),
            false => 1.0,
        };
        Self {
            shares: squares.iter().map(share).collect(),
            balance,
        }
    }

    /// Shapes by how far they move the surface of a body, each vertex by what it counts.
    pub fn of_motion(body: &Body, shapes: &[&Shape], balance: f64) -> Self {
        let square = |shape: &&Shape| {
            let moved = shape.positions.iter().zip(body.surface.vertices());
            let counted = moved.zip(&body.vertex_weights);
            counted
                .map(|((x, rest), a)| a * (x - rest).norm_squared())
                .sum()
        };
        let squares: Vec<f64> = shapes.iter().map(square).collect();
        Self::new(&squares, balance)
    }

    /// Each shape's square as a share of the mean.
    pub fn shares(&self) -> &[f64] {
        &self.shares
    }

    /// What shape number `shape` counts.
    pub fn weight(&self, shape: usize) -> f64 {
        self.shares[shape].powf(-self.balance)
    }

    /// What a superposition of some of the shapes counts: as a shape of their mean square, however small their weights in it.
    pub fn weight_of(&self, members: impl ExactSizeIterator<Item = usize>) -> f64 {
        let count = members.len().max(1) as f64;
        let mean = members.map(|member| self.shares[member]).sum::<f64>() / count;
        mean.max(LEAST_SHARE).powf(-self.balance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_counts_relative_errors_and_zero_absolute_ones() {
        let squares = [4.0, 0.04, 0.0];
        let alike = Balance::new(&squares, 0.0);
        assert_eq!([0, 1, 2].map(|i| alike.weight(i)), [1.0; 3]);
        let relative = Balance::new(&squares, 1.0);
        assert!((relative.weight(1) / relative.weight(0) - 100.0).abs() < 1e-9);
        let half = Balance::new(&squares, 0.5);
        assert!((half.weight(1) / half.weight(0) - 10.0).abs() < 1e-9);
        assert!(
            (relative.weight(2) - 1e4).abs() < 1e-8,
            "no shape outweighs"
        );
    }

    #[test]
    fn shapes_at_rest_count_alike() {
        let rest = Balance::new(&[0.0, 0.0], 1.0);
        assert_eq!((rest.weight(0), rest.weight(1)), (1.0, 1.0));
        assert_eq!(Balance::new(&[], 1.0).shares(), [0.0; 0]);
    }

    #[test]
    fn a_superposition_counts_like_the_mean_of_its_members() {
        let balance = Balance::new(&[3.0, 1.0, 5.0], 1.0);
        assert!((balance.weight_of([0, 1].into_iter()) - 1.5).abs() < 1e-12);
        assert_eq!(balance.weight_of([2].into_iter()), balance.weight(2));
    }
}
