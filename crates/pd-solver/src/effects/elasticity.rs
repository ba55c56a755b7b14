//! Shape-targeting elasticity with actuation: energy, gradient, Hessian products and the derivative by the actuation, as sums
//! over elements and their samples (maths.md "Energy, gradient, Hessian").

mod block;
mod change;
mod hourglass;
mod inverted;
mod kernel;
mod least_pair_sum;
mod linearise;
mod plain;
mod quaternion;
mod slabs;
mod tensor;
#[cfg(test)]
mod tests;

use super::{CoarseView, Effect};
use crate::constant::ConstantMatrix;
use crate::parameters::Parameters;
use crate::vector::NodalVector;
use block::{Block, LANES};
use change::ActuationChange;
use hex_mesh::{HexMesh, Quadrature};
use inverted::Inverted;
use kernel::{
    Actuation, ActuationVjp, AddForces, AtRest, EnergyGradient, HessianProduct, Linearisation,
    SampleLaw, Total,
};
use linearise::{Linearise, LinearisingGradient};
use nalgebra::Vector3;
use plain::constant_blocks;
pub(super) use plain::deformation_gradient;
pub use plain::deformation_gradients;
use pulp::Arch;
use rayon::prelude::*;
pub(super) use slabs::Slabs;
use tensor::TensorRule;

/// Blocks per task where nothing is added to nodes.
const BLOCKS_PER_TASK: usize = 32;

/// What elasticity needs to know of a body: boxes along the axes, of any sizes.
pub(crate) struct ElasticBody {
    /// The eight nodes of each element, x slowest and z fastest.
    pub(crate) elements: Vec<[u32; 8]>,
    /// Edge lengths of each element.
    pub(crate) sizes: Vec<Vector3<f64>>,
    /// Stiffness times volume (times the share of it that is filled) of each element.
    pub(crate) weights: Vec<f64>,
    /// Samples per element.
    pub(crate) quadrature: Quadrature,
    /// Nodes of the body.
    pub(crate) node_count: usize,
}

impl ElasticBody {
    /// The full cubes of a mesh, with a factor on the stiffness of each where they differ.
    pub(crate) fn from_mesh(mesh: &HexMesh, stiffness: f64, factors: Option<&[f64]>) -> Self {
        let count = mesh.elements().len();
        let weight = stiffness * mesh.element_volume();
        Self {
            elements: mesh.elements().to_vec(),
            sizes: vec![Vector3::repeat(mesh.element_size()); count],
            weights: match factors {
                Some(factors) => factors.iter().map(|f| f * weight).collect(),
                None => vec![weight; count],
            },
            quadrature: Quadrature::from_count(mesh.quadrature().len())
                .expect("a mesh has one of the known rules"),
            node_count: mesh.nodes().len(),
        }
    }

    /// About the largest diagonal entry of the constant matrix.
    fn largest_diagonal(&self) -> f64 {
        let of_element = |(size, weight): (&Vector3<f64>, &f64)| {
            weight * size.iter().map(|h| 1.0 / (h * h)).sum::<f64>()
        };
        // Eight elements meet in a node, and each gives it a ninth of this sum.
        let elements = self.sizes.iter().zip(&self.weights);
        elements.map(of_element).fold(0.0, f64::max)
    }
}

/// The Gauss rule, by its points per axis.
enum Rule {
    One(TensorRule<1>),
    Two(TensorRule<2>),
    Three(TensorRule<3>),
}

impl Rule {
    fn new(quadrature: Quadrature) -> Self {
        match quadrature {
            Quadrature::One => Self::One(TensorRule::new(quadrature)),
            Quadrature::Eight => Self::Two(TensorRule::new(quadrature)),
            Quadrature::TwentySeven => Self::Three(TensorRule::new(quadrature)),
        }
    }
}

/// Does the same with the rule that there is, whose points per axis are a constant in `$body`.
macro_rules! with_rule {
    ($rule:expr, $name:ident => $body:expr) => {
        match $rule {
            Rule::One($name) => $body,
            Rule::Two($name) => $body,
            Rule::Three($name) => $body,
        }
    };
}

/// All elements of the body in one batch.
pub(crate) struct Elasticity {
    body: ElasticBody,
    largest_diagonal: f64,
    rule: Rule,
    slabs: Slabs,
    /// Eight elements each.
    blocks: Vec<Block>,
    /// `[blocks * samples]`.
    actuation: Vec<Actuation>,
    /// `[blocks * samples]`, empty before the first linearisation.
    linearisation: Vec<Linearisation>,
    /// Means over the samples of each block: now, and when they were last to be remembered (empty before that).
    mean: Vec<Actuation>,
    remembered: Vec<Actuation>,
    /// The means are to be remembered once others come.
    to_remember: bool,
    /// One sample in the middle.
    middle: TensorRule<1>,
    /// Samples inside out where energy and gradient were last evaluated.
    inverted: usize,
    /// Of the last linearisation.
    smallest_pair_sum: Option<f64>,
    arch: Arch,
}

impl Elasticity {
    /// The batch of a body, with the actuation at rest.
    ///
    /// # Panics
    /// When there is not one size and one weight per element.
    pub(crate) fn new(body: ElasticBody) -> Self {
        let count = body.elements.len();
        assert_eq!(body.sizes.len(), count, "one size per element");
        assert_eq!(body.weights.len(), count, "one weight per element");
        let ranges = (0..count).step_by(LANES);
        let blocks: Vec<Block> = ranges
            .map(|first| first..count.min(first + LANES))
            .map(|range| {
                Block::new(
                    &body.elements[range.clone()],
                    &body.sizes[range.clone()],
                    &body.weights[range],
                )
            })
            .collect();
        Self {
            largest_diagonal: body.largest_diagonal(),
            rule: Rule::new(body.quadrature),
            slabs: Slabs::new(&body.elements, body.node_count),
            actuation: vec![Actuation::identity(); blocks.len() * body.quadrature.count()],
            linearisation: Vec::new(),
            mean: vec![Actuation::identity(); blocks.len()],
            remembered: Vec::new(),
            to_remember: false,
            inverted: 0,
            middle: TensorRule::new(Quadrature::One),
            smallest_pair_sum: None,
            arch: Arch::new(),
            blocks,
            body,
        }
    }

    /// The batch of the cubes of a mesh, with a factor on the stiffness of each where they differ.
    pub(crate) fn from_mesh(mesh: &HexMesh, stiffness: f64, factors: Option<&[f64]>) -> Self {
        Self::new(ElasticBody::from_mesh(mesh, stiffness, factors))
    }

    fn samples(&self) -> usize {
        self.body.quadrature.count()
    }

    /// Adds the forces of the stresses that `law` answers the values `x` with, and returns the energy.
    fn add_forces<L: SampleLaw + Copy + Sync>(
        &self,
        x: &[Vector3<f64>],
        out: &mut [Vector3<f64>],
        law: L,
    ) -> Total {
        with_rule!(&self.rule, rule => self.add_forces_by(rule, x, out, law))
    }

    fn add_forces_by<const N: usize, L: SampleLaw + Copy + Sync>(
        &self,
        rule: &TensorRule<N>,
        x: &[Vector3<f64>],
        out: &mut [Vector3<f64>],
        law: L,
    ) -> Total {
        self.check(x);
        self.check(out);
        let nothing: &mut [()] = &mut [];
        let total = (Total::ZERO, Total::plus as fn(_, _) -> _);
        self.slabs
            .run_with(out, (nothing, 0), total, &|blocks, first_node, out, _| {
                let first_block = blocks.start;
                let blocks = &self.blocks[blocks];
                let forces = AddForces {
                    rule,
                    law,
                    blocks,
                    first_block,
                    x,
                    out,
                    first_node,
                };
                let (total, _) = self.arch.dispatch(forces);
                total
            })
    }

    fn check(&self, x: &[Vector3<f64>]) {
        assert_eq!(x.len(), self.body.node_count, "one vector per node");
    }

    /// The memory of linearisations, to be put back.
    fn take_linearisation(&mut self) -> Vec<Linearisation> {
        let mut all = std::mem::take(&mut self.linearisation);
        all.resize(self.actuation.len(), Linearisation::unset());
        all
    }
}

impl Effect for Elasticity {
    fn add_constant(&self, matrix: &mut ConstantMatrix) {
        let body = &self.body;
        let axes = constant_blocks(body.quadrature);
        let sizes = body.sizes.iter().zip(&body.weights);
        for (nodes, (size, weight)) in body.elements.iter().zip(sizes) {
            let inverse2 = [0, 1, 2].map(|axis| 1.0 / (size[axis] * size[axis]));
            let mut block = [[0.0; 8]; 8];
            for (axis, inverse2) in axes.iter().zip(inverse2) {
                for (entry, x) in block.as_flattened_mut().iter_mut().zip(axis.as_flattened()) {
                    *entry += inverse2 * x;
                }
            }
            if body.quadrature == Quadrature::One {
                hourglass::add_to_constant(inverse2, &mut block);
            }
            matrix.add_block(nodes, |a, b| weight * block[a][b]);
        }
    }

    fn set_parameters(&mut self, parameters: &Parameters) {
        if std::mem::take(&mut self.to_remember) {
            std::mem::swap(&mut self.mean, &mut self.remembered);
            self.mean.resize(self.blocks.len(), Actuation::identity());
        }
        let samples = self.samples();
        self.actuation
            .par_chunks_mut(samples)
            .zip(&mut self.mean)
            .zip(parameters.actuation.par_chunks(LANES * samples))
            .with_min_len(BLOCKS_PER_TASK)
            .for_each(|((out, mean), of_block)| {
                // Filled lanes repeat the first element, as in the block.
                let rest = of_block
                    .chunks(samples)
                    .chain(std::iter::repeat(&of_block[..samples]));
                for (lane, of_element) in rest.take(LANES).enumerate() {
                    for (out, b) in out.iter_mut().zip(of_element) {
                        out.set(lane, b);
                    }
                }
                *mean = Actuation::mean(out);
            });
    }

    fn actuation_is_finite(&self) -> bool {
        // Means are not finite where a sample is not, and are much less to read.
        self.mean.iter().all(Actuation::is_finite)
    }

    fn remember_parameters(&mut self) {
        self.to_remember = true;
    }

    fn add_gradient_change(&self, u: &[Vector3<f64>], out: &mut NodalVector) -> bool {
        if self.remembered.is_empty() || self.remembered == self.mean {
            return false;
        }
        let law = ActuationChange {
            before: &self.remembered,
            after: &self.mean,
        };
        self.add_forces_by(&self.middle, u, out, law);
        true
    }

    fn mean_actuation(&self, out: &mut [[f64; 6]]) {
        for (out, mean) in out.chunks_mut(LANES).zip(&self.mean) {
            for (lane, out) in out.iter_mut().enumerate() {
                *out = mean.get(lane);
            }
        }
    }

    fn energy_gradient(&mut self, u: &[Vector3<f64>], gradient: &mut NodalVector) -> f64 {
        let actuation = &self.actuation;
        let total = self.add_forces(u, gradient, EnergyGradient { actuation });
        self.inverted = total.inverted;
        total.energy
    }

    fn inverted_where_evaluated(&self) -> usize {
        self.inverted
    }

    fn energy_gradient_at_rest(&mut self, u: &[Vector3<f64>], gradient: &mut NodalVector) -> f64 {
        let actuation = &self.actuation;
        let law = AtRest(EnergyGradient { actuation });
        self.add_forces(u, gradient, law).energy
    }

    fn linearise(&mut self, u: &[Vector3<f64>]) {
        self.check(u);
        let mut all = self.take_linearisation();
        let per_task = BLOCKS_PER_TASK * self.samples();
        let smallest = with_rule!(&self.rule, rule => {
            all.par_chunks_mut(per_task)
                .zip(self.actuation.par_chunks(per_task))
                .zip(self.blocks.par_chunks(BLOCKS_PER_TASK))
                .map(|((out, actuation), blocks)| {
                    self.arch.dispatch(Linearise { rule, blocks, actuation, u, out })
                })
                .reduce(|| f64::INFINITY, f64::min)
        });
        self.linearisation = all;
        self.smallest_pair_sum = Some(smallest);
    }

    fn linearise_with_gradient(&mut self, u: &[Vector3<f64>], gradient: &mut NodalVector) {
        self.check(u);
        self.check(gradient);
        let mut all = self.take_linearisation();
        let samples = self.samples();
        let smallest = with_rule!(&self.rule, rule => {
            let per_block = (&mut all[..], samples);
            self.slabs.run_with(gradient, per_block, (f64::INFINITY, f64::min), &|blocks, first_node, out, own| {
                let first_block = blocks.start;
                let law = LinearisingGradient::new(&self.actuation, first_block * samples, own);
                let blocks = &self.blocks[blocks];
                let (_, law) =
                    self.arch.dispatch(AddForces { rule, law, blocks, first_block, x: u, out, first_node });
                law.smallest()
            })
        });
        self.linearisation = all;
        self.smallest_pair_sum = Some(smallest);
    }

    fn hessian_product(&mut self, x: &[Vector3<f64>], out: &mut NodalVector) {
        assert_eq!(self.linearisation.len(), self.actuation.len(), "linearised");
        let law = HessianProduct {
            actuation: &self.actuation,
            linearisation: &self.linearisation,
        };
        self.add_forces(x, out, law);
    }

    fn parameter_vjp(&mut self, u: &[Vector3<f64>], z: &[Vector3<f64>], out: &mut Parameters) {
        assert_eq!(self.linearisation.len(), self.actuation.len(), "linearised");
        let per_task = BLOCKS_PER_TASK * self.samples();
        with_rule!(&self.rule, rule => {
            out.actuation
                .par_chunks_mut(LANES * per_task)
                .zip(self.actuation.par_chunks(per_task))
                .zip(self.linearisation.par_chunks(per_task))
                .zip(self.blocks.par_chunks(BLOCKS_PER_TASK))
                .for_each(|(((out, actuation), linearisation), blocks)| {
                    self.arch.dispatch(ActuationVjp { rule, blocks, actuation, linearisation, u, z, out });
                });
        });
    }

    fn coarsen(&self, view: &CoarseView) -> Option<Box<dyn Effect>> {
        let grid = view.grid;
        let count = grid.elements.len();
        Some(Box::new(Self::new(ElasticBody {
            elements: grid.elements.clone(),
            sizes: (0..count).map(|e| grid.size(e)).collect(),
            weights: (0..count)
                .map(|e| view.stiffness * grid.volume(e) * grid.stiffness[e])
                .collect(),
            quadrature: Quadrature::Eight,
            node_count: grid.node_count(),
        })))
    }

    fn largest_diagonal(&self) -> f64 {
        self.largest_diagonal
    }

    fn inverted_samples(&self, u: &[Vector3<f64>]) -> usize {
        with_rule!(&self.rule, rule => {
            self.blocks
                .par_chunks(BLOCKS_PER_TASK)
                .map(|blocks| self.arch.dispatch(Inverted { rule, blocks, u }))
                .sum()
        })
    }

    fn projections(&self) -> u64 {
        (self.body.elements.len() * self.samples()) as u64
    }

    fn smallest_pair_sum(&self) -> Option<f64> {
        self.smallest_pair_sum
    }

    fn bytes(&self) -> usize {
        size_of_val(self.body.elements.as_slice())
            + size_of_val(self.body.sizes.as_slice())
            + size_of_val(self.body.weights.as_slice())
            + size_of_val(self.blocks.as_slice())
            + self.slabs.bytes()
            + size_of_val(self.actuation.as_slice())
            + size_of_val(self.linearisation.as_slice())
            + size_of_val(self.mean.as_slice())
            + size_of_val(self.remembered.as_slice())
    }
}
