//! The barrier: what a pair, or a vertex above a plane, costs when it comes near.
//!
//! `E = weight stiffness dhat phi(d / dhat)` with `phi(t) = -(1 - t)^2 ln t` below 1, and nothing beyond: twice continuously differentiable,
//! infinite at contact (Li et al. 2020, "Incremental Potential Contact", eq. 6, in the distance itself so that stiffness is a pressure). Over a
//! weight that is an area the pressure is `-stiffness phi'(t)`: 0.34 stiffness at t = 0.7, 1.2 at 0.5, 12 at 0.1.

use super::distance::{
    Gradient, Hessian, Kind, Nearest, Quad, boxes_apart, crossing, crossing_gradient,
    crossing_hessian,
};

/// phi with its first two derivatives.
pub(crate) fn phi(t: f64) -> [f64; 3] {
    if t >= 1.0 {
        return [0.0; 3];
    }
    let (below, ln) = (1.0 - t, t.ln());
    let ratio = below / t;
    [
        -below * below * ln,
        2.0 * below * ln - below * ratio,
        -2.0 * ln + 4.0 * ratio + ratio * ratio,
    ]
}

/// How a pair resists.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Barrier {
    pub(crate) kind: Kind,
    /// Area times stiffness.
    pub(crate) strength: f64,
    /// Distance at which it begins.
    pub(crate) dhat: f64,
    /// Below this [`crossing`], edges count as nearly parallel and are felt less and less.
    pub(crate) parallel: f64,
}

impl Barrier {
    /// Energy and, by the squared distance, its first two derivatives; none where the distance is too large.
    fn of_distance(&self, squared: f64) -> Option<[f64; 3]> {
        if squared >= self.dhat * self.dhat {
            return None;
        }
        let d = squared.sqrt();
        let [energy, first, second] = phi(d / self.dhat);
        let (strength, dhat) = (self.strength, self.dhat);
        let slope = strength * first / (2.0 * d);
        let bend = strength * (second / (4.0 * dhat * squared) - first / (4.0 * squared * d));
        Some([strength * dhat * energy, slope, bend])
    }

    /// The mollifier of nearly parallel edges with its first two derivatives by the crossing (Li et al. 2020, eq. 24).
    fn mollifier(&self, x: &Quad) -> Option<[f64; 3]> {
        if self.kind != Kind::EdgeEdge {
            return None;
        }
        let t = crossing(x) / self.parallel;
        let scale = 1.0 / self.parallel;
        (t < 1.0).then(|| [t * (2.0 - t), 2.0 * (1.0 - t) * scale, -2.0 * scale * scale])
    }

    /// Energy and gradient; none where nothing is felt.
    pub(crate) fn energy_gradient(&self, x: &Quad) -> Option<(f64, Gradient)> {
        if boxes_apart(self.kind, x, self.dhat) {
            return None;
        }
        let nearest = Nearest::of(self.kind, x);
        let [energy, slope, _] = self.of_distance(nearest.squared())?;
        let gradient = nearest.gradient() * slope;
        Some(match self.mollifier(x) {
            None => (energy, gradient),
            Some([share, by_crossing, _]) => (
                share * energy,
                gradient * share + crossing_gradient(x) * (by_crossing * energy),
            ),
        })
    }

    /// The form along the distance whose square is most of the Hessian; none where nothing is felt.
    pub(crate) fn stiffest(&self, x: &Quad) -> Option<Gradient> {
        if boxes_apart(self.kind, x, self.dhat) {
            return None;
        }
        let nearest = Nearest::of(self.kind, x);
        let d = nearest.squared().sqrt();
        let [_, _, second] = phi(d / self.dhat);
        let share = self.mollifier(x).map_or(1.0, |[share, ..]| share);
        let root = (share * self.strength * second / self.dhat).sqrt() / d;
        let form = Gradient::from_fn(|i, _| root * nearest.beta[i / 3] * nearest.q[i % 3]);
        (root > 0.0 && root.is_finite()).then_some(form)
    }

    /// The Hessian; none where nothing is felt.
    pub(crate) fn hessian(&self, x: &Quad) -> Option<Hessian> {
        if boxes_apart(self.kind, x, self.dhat) {
            return None;
        }
        let nearest = Nearest::of(self.kind, x);
        let [energy, slope, bend] = self.of_distance(nearest.squared())?;
        let g = nearest.gradient();
        let hessian = nearest.hessian(x) * slope + g * g.transpose() * bend;
        Some(match self.mollifier(x) {
            None => hessian,
            Some([share, first, second]) => {
                let c = crossing_gradient(x);
                let mixed = g * c.transpose() * (slope * first);
                let of_crossing = crossing_hessian(x) * first + c * c.transpose() * second;
                hessian * share + mixed + mixed.transpose() + of_crossing * energy
            }
        })
    }
}

/// Energy, slope and second derivative by the distance `d` from a plane.
pub(crate) fn above_plane(strength: f64, dhat: f64, d: f64) -> [f64; 3] {
    let [energy, first, second] = phi(d / dhat);
    [
        strength * dhat * energy,
        strength * first,
        strength * second / dhat,
    ]
}

#[cfg(test)]
mod tests;
