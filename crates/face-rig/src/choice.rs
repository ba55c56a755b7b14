//! Which of many shapes make a basis: the farthest one first.

use crate::blend::{BlendBasis, Bounds};
use crate::error::RigError;
use nalgebra::Vector3;

/// Shapes chosen as a basis, and how well they describe the others.
#[derive(Clone, Debug, PartialEq)]
pub struct BasisChoice {
    /// Indices of the chosen shapes, in the order in which they were chosen.
    pub chosen: Vec<usize>,
    /// For each shape given, the largest distance at a vertex that the best weights in [0, 1] over the chosen ones leave of it, in
    /// length units; 0 for the chosen ones.
    pub residual_max: Vec<f64>,
}

impl BasisChoice {
    /// Chooses `count` of the shapes: the largest one, then again and again the one that weights in [0, 1] over those chosen so far
    /// describe worst. Ties go to the first.
    ///
    /// The weights are fitted by least squares, but how far off they are is counted at the worst vertex (of those with a weight): the
    /// closing of an eye is small in the mean over a face, and yet all that one looks at. So no vertex of a shape left out is far from
    /// where the basis would put it, which is what a descriptor needs: a shape of which the weights leave most undescribed looks to a
    /// network like a shape that it is not.
    ///
    /// # Errors
    /// When `count` is 0 or exceeds the number of shapes, and as [`BlendBasis::weighted`].
    pub fn farthest_first(
        deltas: &[Vec<Vector3<f64>>],
        vertex_weights: &[f64],
        count: usize,
    ) -> Result<Self, RigError> {
        if count == 0 || count > deltas.len() {
            return Err(RigError::BasisCount {
                count,
                shapes: deltas.len(),
            });
        }
        // Checks the shapes, and what is left of each before any is chosen is the shape itself.
        BlendBasis::weighted(deltas.to_vec(), vertex_weights)?;
        let size = |shape: &Vec<Vector3<f64>>| {
            let counted = shape.iter().zip(vertex_weights).filter(|(_, c)| **c > 0.0);
            counted.map(|(d, _)| d.norm()).fold(0.0, f64::max)
        };
        let mut choice = Self {
            chosen: Vec::with_capacity(count),
            residual_max: deltas.iter().map(size).collect(),
        };
        while choice.chosen.len() < count {
            choice.chosen.push(choice.farthest());
            let members = choice.chosen.iter().map(|&i| deltas[i].clone());
            let basis = BlendBasis::weighted(members.collect(), vertex_weights)?;
            let bounds = Bounds::uniform(choice.chosen.len(), 0.0, 1.0);
            for (i, delta) in deltas.iter().enumerate() {
                choice.residual_max[i] = if choice.chosen.contains(&i) {
                    0.0
                } else {
                    basis.fit(delta, &bounds, 0.0)?.residual_max
                };
            }
        }
        Ok(choice)
    }

    /// The first of the shapes not chosen with the largest residual.
    fn farthest(&self) -> usize {
        let left = (0..self.residual_max.len()).filter(|i| !self.chosen.contains(i));
        let farther = |best: Option<usize>, i: usize| match best {
            Some(b) if self.residual_max[b] >= self.residual_max[i] => Some(b),
            _ => Some(i),
        };
        left.fold(None, farther)
            .expect("fewer are chosen than there are")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shape(entries: [f64; 3]) -> Vec<Vector3<f64>> {
        vec![Vector3::from(entries), Vector3::zeros()]
    }

    #[test]
    fn what_others_blend_is_chosen_last() {
        let deltas = [
            shape([1.0, 0.0, 0.0]),
            shape([1.0, 2.0, 0.0]),
            shape([0.0, 2.0, 0.0]),
            shape([0.0, 0.0, 1.5]),
        ];
        let choice = BasisChoice::farthest_first(&deltas, &[1.0, 1.0], 3).unwrap();
        // The sum of x and y is the largest; z lies beside it; then x and y are as far, and the first goes.
        assert_eq!(choice.chosen, [1, 3, 0]);
        // The sum less x would be y, but weights are not negative: 0.8 of the sum leave (-0.8, 0.4).
        let left = 0.8_f64.hypot(0.4);
        assert!((choice.residual_max[2] - left).abs() < 1e-12, "{choice:?}");
        let all = BasisChoice::farthest_first(&deltas, &[1.0, 1.0], 4).unwrap();
        assert_eq!(all.residual_max, [0.0; 4]);
        assert_eq!(all.chosen[..3], choice.chosen[..]);
    }

    /// The residual told is that of the bounded fit: 2 x by x alone, whose weight may be 1 at most, leaves 1 at one vertex of two.
    #[test]
    fn the_residual_is_that_of_the_bounded_fit() {
        let deltas = [
            shape([-1.0, 0.0, 0.0]),
            shape([0.25, 0.0, 0.0]),
            shape([0.0, 0.0, 0.0]),
        ];
        let choice = BasisChoice::farthest_first(&deltas, &[1.0, 1.0], 1).unwrap();
        assert_eq!(choice.chosen, [0]);
        assert!((choice.residual_max[1] - 0.25).abs() < 1e-12);
        assert_eq!(choice.residual_max[2], 0.0);
    }

    /// A vertex of no weight does not count.
    #[test]
    fn weights_decide() {
        let deltas = [
            vec![Vector3::x(), Vector3::zeros()],
            vec![Vector3::zeros(), Vector3::x() * 5.0],
        ];
        let first = |weights: [f64; 2]| {
            let choice = BasisChoice::farthest_first(&deltas, &weights, 1).unwrap();
            choice.chosen[0]
        };
        assert_eq!(first([1.0, 1.0]), 1);
        assert_eq!(first([1.0, 0.0]), 0);
    }

    #[test]
    fn counts_that_cannot_be_are_refused() {
        for count in [0, 2] {
            let error = BasisChoice::farthest_first(&[shape([1.0; 3])], &[1.0, 1.0], count);
            assert_eq!(error, Err(RigError::BasisCount { count, shapes: 1 }));
        }
        let none = BasisChoice::farthest_first(&[shape([f64::NAN; 3])], &[1.0, 1.0], 1);
        assert!(matches!(none, Err(RigError::NonFiniteShape { .. })));
    }
}
