//! The Adam optimiser (Kingma & Ba 2015) on flat parameters, with its whole state in the open so that it can be saved.

use crate::Error;

/// Settings of Adam. The learning rate may change between steps, as a decaying schedule does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Adam {
    /// Learning rate, not negative.
    pub lr: f64,
    /// Decay of the first moment, in `[0, 1)`.
    pub beta1: f64,
    /// Decay of the second moment, in `[0, 1)`.
    pub beta2: f64,
    /// Added to the root of the second moment, positive.
    pub eps: f64,
}

impl Default for Adam {
    fn default() -> Self {
        Self {
            lr: 2e-4,
            beta1: 0.9,
            beta2: 0.999,
            eps: 1e-8,
        }
    }
}

/// Everything Adam remembers between steps: saving and restoring it continues bit for bit.
#[derive(Debug, Clone, PartialEq)]
pub struct AdamState {
    /// Number of steps taken.
    pub step: u64,
    /// First moment, one entry per parameter.
    pub m: Vec<f32>,
    /// Second moment, one entry per parameter.
    pub v: Vec<f32>,
}

impl AdamState {
    /// The state before the first step.
    pub fn new(parameters: usize) -> Self {
        Self {
            step: 0,
            m: vec![0.0; parameters],
            v: vec![0.0; parameters],
        }
    }
}

impl Adam {
    /// One step, in place: `p -= lr m' / (sqrt(v') + eps)` with the bias-corrected moments `m'` and `v'`.
    /// The arithmetic is f64, the stored moments and parameters are f32.
    ///
    /// # Errors
    /// [`Error::AdamSetting`], [`Error::AdamLength`], [`Error::NonFiniteGradient`], and [`Error::NonFiniteStep`] where a parameter would
    /// leave the range of f32; then neither the state nor the parameters have changed.
    pub fn step(
        &self,
        state: &mut AdamState,
        parameters: &mut [f32],
        gradient: &[f32],
    ) -> Result<(), Error> {
        self.validate()?;
        check_lengths(state, parameters, gradient)?;
        check_gradient(gradient)?;

        let moved = self.moved(state.step + 1);
        let all = || {
            parameters
                .iter()
                .zip(gradient)
                .zip(state.m.iter().zip(&state.v))
        };
        // Asked before anything is changed: it costs the arithmetic twice, which beside a gradient is nothing.
        let lost = all().position(|((&p, &g), (&m, &v))| !moved(p, g, m, v).0.is_finite());
        if let Some(index) = lost {
            return Err(Error::NonFiniteStep {
                index,
                value: parameters[index],
                lr: self.lr,
            });
        }
        state.step += 1;
        let moments = state.m.iter_mut().zip(&mut state.v);
        for ((p, &g), (m, v)) in parameters.iter_mut().zip(gradient).zip(moments) {
            (*p, *m, *v) = moved(*p, g, *m, *v);
        }
        Ok(())
    }

    /// What step number `step` makes of a parameter with this gradient and these moments: the parameter and the moments.
    fn moved(&self, step: u64) -> impl Fn(f32, f32, f32, f32) -> (f32, f32, f32) {
        let Self {
            lr,
            beta1,
            beta2,
            eps,
        } = *self;
        let correction1 = 1.0 - beta1.powf(step as f64);
        let correction2 = 1.0 - beta2.powf(step as f64);
        move |p, g, m, v| {
            let g = f64::from(g);
            let m = (beta1 * f64::from(m) + (1.0 - beta1) * g) as f32;
            let v = (beta2 * f64::from(v) + (1.0 - beta2) * g * g) as f32;
            let direction =
                (f64::from(m) / correction1) / ((f64::from(v) / correction2).sqrt() + eps);
            ((f64::from(p) - lr * direction) as f32, m, v)
        }
    }

    fn validate(&self) -> Result<(), Error> {
        let unit = "use a number from 0 up to but not including 1";
        let settings = [
            ("lr", self.lr, self.lr >= 0.0, "use 0 or more"),
            ("beta1", self.beta1, (0.0..1.0).contains(&self.beta1), unit),
            ("beta2", self.beta2, (0.0..1.0).contains(&self.beta2), unit),
            ("eps", self.eps, self.eps > 0.0, "use a positive number"),
        ];
        for (name, value, allowed, range) in settings {
            if !(allowed && value.is_finite()) {
                return Err(Error::AdamSetting { name, value, range });
            }
        }
        Ok(())
    }
}

fn check_lengths(state: &AdamState, parameters: &[f32], gradient: &[f32]) -> Result<(), Error> {
    let length = parameters.len();
    if [gradient.len(), state.m.len(), state.v.len()] == [length; 3] {
        return Ok(());
    }
    Err(Error::AdamLength {
        parameters: length,
        gradient: gradient.len(),
        first_moment: state.m.len(),
        second_moment: state.v.len(),
    })
}

/// A finite entry whose square overflows would leave an infinite second moment, which freezes its parameter for ever.
fn check_gradient(gradient: &[f32]) -> Result<(), Error> {
    match gradient.iter().position(|g| !(g * g).is_finite()) {
        None => Ok(()),
        Some(index) => Err(Error::NonFiniteGradient {
            index,
            value: gradient[index],
        }),
    }
}
