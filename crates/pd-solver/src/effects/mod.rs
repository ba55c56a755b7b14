//! The one contract that every effect keeps, and the turning of a list of [`EffectSpec`] into batches.

mod elasticity;
mod gravity;
pub(crate) mod springs;

use crate::constant::ConstantMatrix;
use crate::error::SolverError;
use crate::multigrid::{Grid, Transfer};
use crate::spec::{EffectSpec, Parameters};
use crate::vector::NodalVector;
use elasticity::Elasticity;
pub use elasticity::deformation_gradients;
use gravity::Gravity;
use hex_mesh::HexMesh;
use nalgebra::Vector3;
use springs::Springs;

/// Takes the nodes, the weights and the stiffness of a linear form.
pub(crate) type FormVisitor<'a> = &'a mut dyn FnMut(&[u32], &[f64], f64);

/// What an effect can contribute to a problem. Dispatch is once per batch, never inside a loop over elements.
///
/// Conventions: `u` holds positions of all nodes; everything is added to what the output holds; entries at prescribed nodes are
/// written like all others and removed by the caller.
pub(crate) trait Effect: Send + Sync {
    /// Adds the entries of the constant matrix. For any state the true Hessian is at most this matrix (times identity).
    fn add_constant(&self, matrix: &mut ConstantMatrix);

    /// Takes over the parameters of the next evaluations.
    fn set_parameters(&mut self, parameters: &Parameters);

    /// Adds the gradient at `u` and returns the energy.
    fn energy_gradient(&mut self, u: &[Vector3<f64>], gradient: &mut NodalVector) -> f64;

    /// Prepares Hessian products and parameter derivatives at `u`.
    fn linearise(&mut self, u: &[Vector3<f64>]);

    /// Adds `H x` at the last linearisation.
    fn hessian_product(&mut self, x: &[Vector3<f64>], out: &mut NodalVector);

    /// Adds `-(d gradient / d parameters)^T z` at the last linearisation, which was at `u` and these parameters.
    fn parameter_vjp(&mut self, u: &[Vector3<f64>], z: &[Vector3<f64>], out: &mut Parameters);

    /// The same effect on a coarser grid, for the coarse-to-fine start. Parameters keep their places but for the actuation, which
    /// has eight samples per coarse element.
    fn coarsen(&self, view: &CoarseView) -> Box<dyn Effect>;

    /// Calls `f` with nodes, weights and stiffness of every linear form `stiffness / 2 |weights . u|^2` in the Hessian that is
    /// not elastic: what a preconditioner has to know of springs.
    fn for_each_form(&self, _f: FormVisitor) {}

    /// About the largest diagonal entry of the constant matrix, which makes roundoff comparable.
    fn largest_diagonal(&self) -> f64 {
        0.0
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

/// The batches of a list of effects, with the parameters at rest and the prescribed nodes.
pub(crate) struct Batches {
    pub(crate) effects: Vec<Box<dyn Effect>>,
    pub(crate) prescribed: Vec<u32>,
    pub(crate) rest: Parameters,
    /// Nodes that a spring holds.
    pub(crate) anchored: Vec<u32>,
    /// Whether parts that nothing holds may float.
    pub(crate) may_float: bool,
    /// Energy per volume for a unit misfit.
    pub(crate) elastic_stiffness: f64,
}

/// Turns what a scene lists into batches.
pub(crate) fn build(mesh: &HexMesh, specs: &[EffectSpec]) -> Result<Batches, SolverError> {
    let samples = mesh.elements().len() * mesh.quadrature().len();
    let mut batches = Batches {
        effects: Vec::new(),
        prescribed: Vec::new(),
        anchored: Vec::new(),
        may_float: false,
        elastic_stiffness: 0.0,
        rest: Parameters {
            actuation: vec![[0.0; 6]; samples],
            prescribed: Vec::new(),
            spring_targets: Vec::new(),
            acceleration: Vec::new(),
        },
    };
    let mut elasticities = 0;
    for (index, spec) in specs.iter().enumerate() {
        match spec {
            EffectSpec::Elasticity { stiffness } => {
                positive(index, "stiffness", *stiffness)?;
                elasticities += 1;
                if elasticities > 1 {
                    let kind = spec.kind();
                    return Err(SolverError::DuplicateEffect { index, kind });
                }
                batches.elastic_stiffness = *stiffness;
                batches
                    .effects
                    .push(Box::new(Elasticity::from_mesh(mesh, *stiffness)));
            }
            EffectSpec::Floating {} => batches.may_float = true,
            EffectSpec::Prescribed { nodes } => {
                let nodes = nodes.resolve(mesh, index)?;
                batches.prescribe(mesh, &nodes, index)?;
            }
            EffectSpec::Springs { points, stiffness } => {
                positive(index, "stiffness", *stiffness)?;
                let first = batches.rest.spring_targets.len();
                let springs = Springs::new(mesh, points, *stiffness, first, index)?;
                batches.anchored.extend(springs.nodes());
                batches.rest.spring_targets.extend(springs.rest_targets());
                batches.effects.push(Box::new(springs));
            }
            EffectSpec::Gravity {
                acceleration,
                density,
            } => {
                positive(index, "density", *density)?;
                for &value in acceleration {
                    finite(index, "acceleration", value)?;
                }
                let slot = batches.rest.acceleration.len();
                let acceleration = Vector3::from(*acceleration);
                batches.rest.acceleration.push(acceleration);
                let gravity = Gravity::new(mesh, *density, acceleration, slot);
                batches.effects.push(Box::new(gravity));
            }
        }
    }
    if elasticities == 0 {
        return Err(SolverError::NoElasticity);
    }
    Ok(batches)
}

impl Batches {
    fn prescribe(
        &mut self,
        mesh: &HexMesh,
        nodes: &[u32],
        index: usize,
    ) -> Result<(), SolverError> {
        let mut held = vec![false; mesh.nodes().len()];
        for &node in &self.prescribed {
            held[node as usize] = true;
        }
        for &node in nodes {
            if std::mem::replace(&mut held[node as usize], true) {
                return Err(SolverError::PrescribedTwice { index, node });
            }
            self.prescribed.push(node);
            self.rest.prescribed.push(mesh.nodes()[node as usize]);
        }
        Ok(())
    }
}

fn positive(index: usize, field: &'static str, value: f64) -> Result<(), SolverError> {
    if value.is_finite() && value > 0.0 {
        return Ok(());
    }
    Err(SolverError::BadValue {
        index,
        field,
        value,
        expected: "a finite number above zero",
    })
}

fn finite(index: usize, field: &'static str, value: f64) -> Result<(), SolverError> {
    if value.is_finite() {
        return Ok(());
    }
    Err(SolverError::BadValue {
        index,
        field,
        value,
        expected: "a finite number",
    })
}
