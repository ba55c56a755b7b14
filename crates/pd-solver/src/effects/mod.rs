//! The one contract that every effect keeps.

mod build;
mod contact;
mod damping;
mod dead_load;
mod elasticity;
mod inertia;
mod mean_strain;
mod points;
mod pressure;
pub(crate) mod springs;
#[cfg(test)]
mod tests;
mod volume;

use crate::constant::ConstantMatrix;
use crate::error::SolverError;
use crate::multigrid::{Form, Grid, Transfer};
use crate::parameters::Parameters;
use crate::vector::NodalVector;
pub(crate) use build::{Batches, Stepping, build};
pub use contact::ContactReport;
pub(crate) use elasticity::Elasticity;
pub use elasticity::deformation_gradients;
use nalgebra::Vector3;

/// Takes the nodes, the weights and the stiffness of a linear form.
pub(crate) type FormVisitor<'a> = &'a mut dyn FnMut(&[u32], &[f64], f64);

/// What an effect can contribute to a problem. Dispatch is once per batch, never inside a loop over elements.
///
/// Conventions: `u` holds positions of all nodes; everything is added to what the output holds; entries at prescribed nodes are
/// written like all others and removed by the caller.
pub(crate) trait Effect: Send + Sync {
    /// Adds the entries of the constant matrix. For any state the true Hessian is at most this matrix (times identity), if
    /// [`Effect::is_bounded`].
    fn add_constant(&self, matrix: &mut ConstantMatrix);

    /// Takes over the parameters of the next evaluations.
    fn set_parameters(&mut self, parameters: &Parameters);

    /// Adds the gradient at `u` and returns the energy.
    fn energy_gradient(&mut self, u: &[Vector3<f64>], gradient: &mut NodalVector) -> f64;

    /// [`Effect::energy_gradient`] where most of the body is at rest.
    fn energy_gradient_at_rest(&mut self, u: &[Vector3<f64>], gradient: &mut NodalVector) -> f64 {
        self.energy_gradient(u, gradient)
    }

    /// Prepares Hessian products and parameter derivatives at `u`.
    fn linearise(&mut self, u: &[Vector3<f64>]);

    /// [`Effect::linearise`], and adds the gradient at `u`.
    fn linearise_with_gradient(&mut self, u: &[Vector3<f64>], gradient: &mut NodalVector) {
        self.energy_gradient(u, gradient);
        self.linearise(u);
    }

    /// Adds `H x` at the last linearisation.
    fn hessian_product(&mut self, x: &[Vector3<f64>], out: &mut NodalVector);

    /// Adds `-(d gradient / d parameters)^T z` at the last linearisation, which was at `u` and these parameters. That by the actuation, which
    /// elasticity alone has, is written over what the output holds.
    fn parameter_vjp(&mut self, u: &[Vector3<f64>], z: &[Vector3<f64>], out: &mut Parameters);

    /// The same effect on a coarser grid, for the coarse-to-fine start. Parameters keep their places but for the actuation, which
    /// has eight samples per coarse element. `None` for what a coarse body cannot have: there is no such start then.
    fn coarsen(&self, view: &CoarseView) -> Option<Box<dyn Effect>>;

    /// Whether all entries of the actuation are finite; elasticity alone has one.
    fn actuation_is_finite(&self) -> bool {
        true
    }

    /// Remembers the parameters, for [`Effect::add_gradient_change`].
    fn remember_parameters(&mut self) {}

    /// Adds about what the gradient at `u` has changed by since the parameters were remembered, as far as the actuation did it: false, if
    /// that is nothing.
    fn add_gradient_change(&self, _u: &[Vector3<f64>], _out: &mut NodalVector) -> bool {
        false
    }

    /// Writes the mean A of the samples of every element; elasticity alone has one.
    fn mean_actuation(&self, _out: &mut [[f64; 6]]) {}

    /// Whether the constant matrix bounds the Hessian, so that methods without a line search get along with it.
    fn is_bounded(&self) -> bool {
        true
    }

    /// Whether steps have a limit. Such an effect is stiff, and stiff otherwise after every step: Newton's method is the one to use.
    fn limits_steps(&self) -> bool {
        false
    }

    /// The share of the way from the positions `from` to the positions `to` that a step may go.
    fn step_limit(&mut self, _from: &[Vector3<f64>], _to: &[Vector3<f64>]) -> f64 {
        1.0
    }

    /// Moves obstacles, given by the vertices of all of them.
    fn set_obstacles(&mut self, _obstacles: &[Vector3<f64>]) {}

    /// The share of a motion of the body and of obstacles, from where they are set, that both may go.
    fn motion_limit(
        &mut self,
        _from: &[Vector3<f64>],
        _to: &[Vector3<f64>],
        _obstacles: &[Vector3<f64>],
    ) -> f64 {
        1.0
    }

    /// What passes through what at `u` and must not.
    fn intersection(&mut self, _u: &[Vector3<f64>]) -> Option<SolverError> {
        None
    }

    /// What contact sees at `u`.
    fn contact_report(&mut self, _u: &[Vector3<f64>]) -> Option<ContactReport> {
        None
    }

    /// Calls `f` with nodes, weights and stiffness of every linear form `stiffness / 2 |weights . u|^2` in the Hessian that is
    /// not elastic: what a preconditioner has to know of springs.
    fn for_each_form(&self, _f: FormVisitor) {}

    /// Forms over nodes whose squares are most of the Hessian of what touches at `u`: what a preconditioner has to know of contact.
    fn touches(&mut self, _u: &[Vector3<f64>]) -> Vec<Form> {
        Vec::new()
    }

    /// Stiffness against changes of volume, an energy per volume: what a preconditioner has to know of it.
    fn volume_stiffness(&self) -> f64 {
        0.0
    }

    /// About the largest diagonal entry of the constant matrix, which makes roundoff comparable.
    fn largest_diagonal(&self) -> f64 {
        0.0
    }

    /// Searches for what is near so far.
    fn queries(&self) -> u64 {
        0
    }

    /// Samples with det F < 0 where [`Effect::energy_gradient`] was last asked.
    fn inverted_where_evaluated(&self) -> usize {
        0
    }

    /// Samples with det F < 0 at `u`.
    fn inverted_samples(&self, _u: &[Vector3<f64>]) -> usize {
        0
    }

    /// Local projections done by one evaluation.
    fn projections(&self) -> u64 {
        0
    }

    /// Smallest s_i + s_j over all samples of the last linearisation: how near a rotation is to being not unique.
    fn smallest_pair_sum(&self) -> Option<f64> {
        None
    }

    /// Bytes held for this effect.
    fn bytes(&self) -> usize;
}

/// What an effect sees of the next coarser grid.
pub(crate) struct CoarseView<'a> {
    pub(crate) grid: &'a Grid,
    pub(crate) transfer: &'a Transfer,
    /// Energy per volume for a unit misfit.
    pub(crate) stiffness: f64,
}
