//! The methods, one per file, behind one signature.

mod anderson;
mod descent;
mod lbfgs;
mod local_global;
mod newton;

use crate::solution::Status;
pub(crate) use anderson::anderson;
pub(crate) use lbfgs::lbfgs;
pub(crate) use local_global::local_global;
pub(crate) use newton::newton;

/// When a method may stop: at an estimated error in length units, or at a gradient norm; the gradient norm is never zero.
pub(crate) struct Target {
    pub(crate) accuracy: Option<f64>,
    pub(crate) gradient: f64,
}

impl Target {
    /// Whether the rule is met by a gradient norm and, where there is one, an error estimate.
    pub(crate) fn is_met(&self, gradient_norm: f64, estimate: Option<f64>) -> bool {
        let near = match (self.accuracy, estimate) {
            (Some(accuracy), Some(estimate)) => estimate <= accuracy,
            _ => false,
        };
        near || gradient_norm <= self.gradient
    }
}

/// How a method ended; the positions are updated in place.
pub(crate) struct Outcome {
    pub(crate) status: Status,
    pub(crate) iterations: usize,
    pub(crate) energy: f64,
    pub(crate) gradient_norm: f64,
    pub(crate) estimated_error: Option<f64>,
}
