//! Where the last solve ended, for one that goes on from there.

use crate::parameters::Parameters;
use crate::vector::{NodalVector, all_pairs, zeros};
use nalgebra::Vector3;

/// The last equilibrium, if the last solve found one.
#[derive(Default)]
pub(super) struct Ended {
    found: bool,
    positions: NodalVector,
    /// What was left of it there.
    gradient: NodalVector,
    /// Without their actuation.
    parameters: Parameters,
}

impl Ended {
    /// Says that a solve found an equilibrium at `u`. Takes the gradient there, and leaves memory of the same length.
    pub(super) fn keep(
        &mut self,
        u: &NodalVector,
        gradient: &mut NodalVector,
        parameters: &Parameters,
    ) {
        self.found = true;
        self.positions.clone_from(u);
        if self.gradient.len() != u.len() {
            self.gradient = zeros(u.len());
        }
        std::mem::swap(&mut self.gradient, gradient);
        self.parameters.copy_apart_from_actuation(parameters);
    }

    /// Says that another solve begins. True if it goes on from there, and by these parameters has another actuation at most: `gradient`, memory
    /// of the same length, is then what was left there.
    pub(super) fn leave(
        &mut self,
        start: Option<&[Vector3<f64>]>,
        parameters: &Parameters,
        gradient: &mut NodalVector,
    ) -> bool {
        let found = std::mem::take(&mut self.found);
        let here = |start| all_pairs(&self.positions, start, |a, b| a == b);
        let goes_on = found
            && start.is_some_and(here)
            && self.parameters.is_same_apart_from_actuation(parameters);
        if goes_on {
            std::mem::swap(&mut self.gradient, gradient);
        }
        goes_on
    }
}
