//! What training and evaluation ask of a network, be it the field or an explicit decoder.

use crate::stage1::gather;
use actuation_net::{
    ACTUATION_SIZE, ActuationNet, Error, ExplicitDecoder, JOINT_SIZE, Output, Traced, TracedDecoder,
};
use std::borrow::Cow;

/// Points of a body, element after element, in the network's coordinates: the body's bounding box is centred at 0 and its longest side
/// spans [-1, 1].
#[derive(Debug, Clone, PartialEq)]
pub struct Points {
    /// Coordinates, `[n, 3]`.
    pub coordinates: Vec<f32>,
    /// Points of an element.
    pub per_element: usize,
    /// Edge of an element, in the same coordinates.
    pub spacing: f32,
}

impl Points {
    /// Number of points.
    pub fn count(&self) -> usize {
        self.coordinates.len() / 3
    }
}

/// Where a network is asked: at all of some points, or at a few.
pub struct Samples<'a> {
    coordinates: Cow<'a, [f32]>,
    /// Which of the points; all where not given.
    chosen: Option<Vec<usize>>,
    per_element: usize,
    spacing: f32,
}

impl<'a> Samples<'a> {
    /// All of `points`.
    pub fn all(points: &'a Points) -> Self {
        Self {
            coordinates: Cow::Borrowed(&points.coordinates),
            chosen: None,
            per_element: points.per_element,
            spacing: points.spacing,
        }
    }

    /// Those numbered `chosen` out of `points`.
    ///
    /// # Panics
    /// When there is no such point.
    pub fn some(points: &Points, chosen: Vec<usize>) -> Self {
        Self {
            coordinates: Cow::Owned(gather(&points.coordinates, &chosen, 3)),
            chosen: Some(chosen),
            per_element: points.per_element,
            spacing: points.spacing,
        }
    }

    /// The element of each.
    fn elements(&self) -> Vec<usize> {
        let point = |i: usize| self.chosen.as_ref().map_or(i, |chosen| chosen[i]);
        let all = 0..self.coordinates.len() / 3;
        all.map(|i| point(i) / self.per_element).collect()
    }
}

/// A network that says for a descriptor how a body is actuated at points of it and where the joint goes.
pub trait Actuator {
    /// An evaluation whose reverse pass is still to come.
    type Trace<'a>: Reverse
    where
        Self: 'a;

    /// Number of parameters.
    fn parameter_count(&self) -> usize;

    /// All parameters, flat, for the optimiser.
    fn parameters_mut(&mut self) -> &mut [f32];

    /// Joint, and actuation at the samples, `[n, 6]`.
    ///
    /// # Errors
    /// When the descriptor does not fit or the answer is not finite.
    fn evaluate(&self, descriptor: &[f32], samples: &Samples) -> Result<Output, Error>;

    /// [`Actuator::evaluate`] that remembers what the reverse pass needs.
    ///
    /// # Errors
    /// As [`Actuator::evaluate`].
    fn trace<'a>(
        &'a self,
        descriptor: &[f32],
        samples: &'a Samples,
    ) -> Result<Self::Trace<'a>, Error>;
}

/// The way back from an output to the parameters.
pub trait Reverse {
    /// What was answered.
    fn output(&self) -> &Output;

    /// The flat gradient of a loss with these derivatives by the output.
    ///
    /// # Panics
    /// When the cotangent has not six entries per sample.
    fn backward(self, actuation_bar: &[f32], joint_bar: &[f32; JOINT_SIZE]) -> Vec<f32>;
}

impl Actuator for ActuationNet {
    type Trace<'a> = Traced<'a>;

    fn parameter_count(&self) -> usize {
        self.parameter_count()
    }

    fn parameters_mut(&mut self) -> &mut [f32] {
        self.parameters_mut()
    }

    fn evaluate(&self, descriptor: &[f32], samples: &Samples) -> Result<Output, Error> {
        self.evaluate_at(descriptor, &samples.coordinates, Some(samples.spacing))
    }

    fn trace<'a>(&'a self, descriptor: &[f32], samples: &'a Samples) -> Result<Traced<'a>, Error> {
        self.trace_at(descriptor, &samples.coordinates, Some(samples.spacing))
    }
}

impl Reverse for Traced<'_> {
    fn output(&self) -> &Output {
        self.output()
    }

    fn backward(self, actuation_bar: &[f32], joint_bar: &[f32; JOINT_SIZE]) -> Vec<f32> {
        self.backward(actuation_bar, joint_bar)
    }
}

/// The answer at samples for that of elements.
fn spread(output: &Output, elements: &[usize]) -> Output {
    Output {
        actuation: gather(&output.actuation, elements, ACTUATION_SIZE),
        joint: output.joint,
    }
}

/// On the grid that it was made for: all points of an element have its actuation.
impl Actuator for ExplicitDecoder {
    type Trace<'a> = TracedElements<'a>;

    fn parameter_count(&self) -> usize {
        self.parameter_count()
    }

    fn parameters_mut(&mut self) -> &mut [f32] {
        self.parameters_mut()
    }

    fn evaluate(&self, descriptor: &[f32], samples: &Samples) -> Result<Output, Error> {
        let output = self.evaluate(descriptor)?;
        Ok(spread(&output, &samples.elements()))
    }

    fn trace<'a>(
        &'a self,
        descriptor: &[f32],
        samples: &'a Samples,
    ) -> Result<TracedElements<'a>, Error> {
        let traced = self.trace(descriptor)?;
        let elements = samples.elements();
        Ok(TracedElements {
            output: spread(traced.output(), &elements),
            traced,
            elements,
        })
    }
}

/// An evaluation of an [`ExplicitDecoder`] whose reverse pass is still to come.
pub struct TracedElements<'a> {
    output: Output,
    traced: TracedDecoder<'a>,
    /// Element of each sample.
    elements: Vec<usize>,
}

impl Reverse for TracedElements<'_> {
    fn output(&self) -> &Output {
        &self.output
    }

    fn backward(self, actuation_bar: &[f32], joint_bar: &[f32; JOINT_SIZE]) -> Vec<f32> {
        assert_eq!(actuation_bar.len(), self.output.actuation.len());
        let mut sums = vec![0.0; self.traced.output().actuation.len()];
        let rows = actuation_bar.chunks_exact(ACTUATION_SIZE);
        for (&element, row) in self.elements.iter().zip(rows) {
            let sum = &mut sums[ACTUATION_SIZE * element..][..ACTUATION_SIZE];
            sum.iter_mut().zip(row).for_each(|(s, x)| *s += x);
        }
        self.traced.backward(&sums, joint_bar)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use actuation_net::DecoderConfig;

    /// The answer of an element is that of all its samples, and its cotangent the sum of theirs.
    #[test]
    fn samples_share_the_actuation_of_their_element() {
        let config = DecoderConfig {
            descriptor: 2,
            latent: 3,
            width: 4,
            elements: 3,
        };
        let decoder = ExplicitDecoder::new(&config, 1).unwrap();
        let code = [1.0, 0.5];
        let points = Points {
            coordinates: vec![0.0; 3 * 6],
            per_element: 2,
            spacing: 0.1,
        };
        let of_elements = decoder.evaluate(&code).unwrap();
        let element = |e: usize| &of_elements.actuation[6 * e..6 * e + 6];
        let all = Actuator::evaluate(&decoder, &code, &Samples::all(&points)).unwrap();
        assert_eq!(all.joint, of_elements.joint);
        for (sample, row) in all.actuation.chunks(6).enumerate() {
            assert_eq!(row, element(sample / 2));
        }
        let some = Samples::some(&points, vec![5, 0, 4]);
        let traced = Actuator::trace(&decoder, &code, &some).unwrap();
        let answer = [element(2), element(0), element(2)].concat();
        assert_eq!(traced.output().actuation, answer);
        let bar: Vec<f32> = (0..18).map(|i| i as f32).collect();
        let gradient = traced.backward(&bar, &[0.0; 5]);
        // The head's bias comes last and has the element's cotangent itself.
        let bias = &gradient[gradient.len() - 18..];
        let expected: Vec<f32> = (0..18)
            .map(|i| match i / 6 {
                0 => bar[6 + i],
                1 => 0.0,
                _ => bar[i - 12] + bar[i],
            })
            .collect();
        assert_eq!(bias, expected);
    }
}
