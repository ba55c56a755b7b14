//! The first step of a solve that goes on from the equilibrium for another actuation.

use super::history::History;
use super::{Preconditioner, Workspace};
use crate::problem::Problem;
use crate::vector::{NodalVector, add_scaled, norm};

/// Takes a full step by the gradient before the actuation changed, which is the workspace's last, and about what that change did to it, which costs
/// a third of the gradient. Where the gradient fell by it, gives the norm of that before: the workspace is then as after the step of a descent. Else
/// `u` is as it was, and the preconditioner is prepared.
pub(super) fn predict(
    problem: &mut Problem,
    pre: &mut dyn Preconditioner,
    space: &mut Workspace,
    u: &mut NodalVector,
    history: &mut History,
) -> Option<f64> {
    space.reserve(problem.len());
    if pre.prepare(problem, u) {
        history.clear();
    }
    if !problem.add_gradient_change(u, &mut space.last_gradient) {
        return None;
    }
    history.direction(pre, &space.last_gradient, &mut space.direction);
    add_scaled(u, -1.0, &space.direction, &mut space.last);
    let energy = problem.evaluate(&space.last, &mut space.gradient);
    let before = norm(&space.last_gradient);
    if norm(&space.gradient) < before {
        std::mem::swap(u, &mut space.last);
        space.energy_at_start = Some(energy);
        return Some(before);
    }
    None
}
