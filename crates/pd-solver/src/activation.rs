//! Parts of the body that follow the actuation less.

use crate::parameters::Parameters;

/// Scales of the actuation per element.
pub(crate) struct Activation {
    scales: Vec<f64>,
    /// The parameters with the actuation scaled.
    scaled: Parameters,
}

impl Activation {
    pub(crate) fn new(scales: Vec<f64>) -> Self {
        Self {
            scales,
            scaled: Parameters::default(),
        }
    }

    /// The parameters as the material follows them.
    pub(crate) fn apply(&mut self, parameters: &Parameters) -> &Parameters {
        self.scaled.clone_from(parameters);
        let mut actuation = std::mem::take(&mut self.scaled.actuation);
        self.scale(&mut actuation);
        self.scaled.actuation = actuation;
        &self.scaled
    }

    /// Scales an actuation, or the gradient by one.
    pub(crate) fn scale(&self, actuation: &mut [[f64; 6]]) {
        let samples = actuation.len() / self.scales.len();
        for (samples, scale) in actuation.chunks_exact_mut(samples).zip(&self.scales) {
            samples
                .as_flattened_mut()
                .iter_mut()
                .for_each(|b| *b *= scale);
        }
    }
}
