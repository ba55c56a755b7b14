//! The network that users hold: flat f32 parameters, evaluated through the fused path.

use dfdx::prelude::{
    Backward, Cpu, CpuError, Gradients, NoneTape, OwnedTape, PutTape, Rank0, SumTo, Tape,
    TensorFromVec, TryMul,
};

use crate::field::FieldWeights;
use crate::layout::{initial_parameters, parameter_layout};
use crate::model::{Conditioned, Leaves, Model};
use crate::{ACTUATION_SIZE, Error, JOINT_SIZE, NetworkConfig, ParameterTensor, ResolutionRange};

/// Why a dfdx error cannot happen here: shapes come from the layout, and a CPU device fails only when memory runs out.
pub(crate) const OUT_OF_MEMORY: &str = "out of memory in the network evaluation";

/// What a network says about one shape.
#[derive(Debug, Clone, PartialEq)]
pub struct Output<E = f32> {
    /// `b`, `[n, 6]` row-major, one row per point in the order 11, 12, 13, 22, 23, 33; the actuation is `A = I + sym(b)`.
    pub actuation: Vec<E>,
    /// Joint values `theta_x, theta_y, t_x, t_y, t_z`.
    pub joint: [E; JOINT_SIZE],
}

/// Derivative of a scalar loss with respect to an [`Output`], entry by entry.
#[derive(Debug, Clone, PartialEq)]
pub struct OutputCotangent<E = f32> {
    /// `[n, 6]`, as [`Output::actuation`].
    pub actuation: Vec<E>,
    /// As [`Output::joint`].
    pub joint: [E; JOINT_SIZE],
}

/// Encoder, actuation field and bone network with their f32 parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct ActuationNet {
    config: NetworkConfig,
    layout: Vec<ParameterTensor>,
    parameters: Vec<f32>,
}

impl ActuationNet {
    /// A network with freshly drawn weights; the same seed gives the same weights.
    ///
    /// Sine layers start as in Sitzmann et al. 2020, dense layers as in He et al. 2015. Modulation, head and the bone
    /// network's last layer start at a hundredth of that, so that the field is a plain SIREN at first, `A` close to `I` and
    /// the bones close to rest.
    ///
    /// # Errors
    /// Those of [`NetworkConfig::validate`].
    pub fn new(config: &NetworkConfig, seed: u64) -> Result<Self, Error> {
        config.validate()?;
        let layout = parameter_layout(config);
        let parameters = initial_parameters(&layout, seed);
        Ok(Self {
            config: config.clone(),
            layout,
            parameters,
        })
    }

    /// A network with given parameters, in the order of [`NetworkConfig::parameter_layout`].
    ///
    /// # Errors
    /// Those of [`NetworkConfig::validate`] and [`ActuationNet::set_parameters`].
    pub fn from_parameters(config: &NetworkConfig, parameters: Vec<f32>) -> Result<Self, Error> {
        config.validate()?;
        let layout = parameter_layout(config);
        check_parameters(&layout, &parameters)?;
        Ok(Self {
            config: config.clone(),
            layout,
            parameters,
        })
    }

    /// The sizes this network was made with.
    pub fn config(&self) -> &NetworkConfig {
        &self.config
    }

    /// Number of parameters.
    pub fn parameter_count(&self) -> usize {
        self.parameters.len()
    }

    /// Names, shapes and places of all parameters, in flat order.
    pub fn parameter_layout(&self) -> &[ParameterTensor] {
        &self.layout
    }

    /// A copy of all parameters, flat, in the order of [`ActuationNet::parameter_layout`].
    pub fn parameters(&self) -> Vec<f32> {
        self.parameters.clone()
    }

    /// All parameters in place, for an optimiser such as [`crate::Adam`], which keeps them finite. Anything else should use
    /// [`ActuationNet::set_parameters`], which checks.
    pub fn parameters_mut(&mut self) -> &mut [f32] {
        &mut self.parameters
    }

    /// Replaces all parameters.
    ///
    /// # Errors
    /// [`Error::ParameterCount`] and [`Error::NonFiniteParameter`]; then nothing has changed.
    pub fn set_parameters(&mut self, parameters: &[f32]) -> Result<(), Error> {
        check_parameters(&self.layout, parameters)?;
        self.parameters.copy_from_slice(parameters);
        Ok(())
    }

    /// The latent code `z` of a shape.
    ///
    /// # Errors
    /// [`Error::DescriptorLength`] and [`Error::NonFiniteDescriptor`].
    pub fn latent(&self, descriptor: &[f32]) -> Result<Vec<f32>, Error> {
        check_descriptor(self.config.descriptor, descriptor)?;
        let (conditioned, _) = self.condition::<NoneTape>(descriptor, None);
        Ok(conditioned.latent.as_vec())
    }

    /// The same network with a field that also depends on the spacing of the grid, which at first makes no difference.
    ///
    /// # Errors
    /// [`Error::Resolution`] when the range is none.
    pub fn with_resolution(&self, range: ResolutionRange, seed: u64) -> Result<Self, Error> {
        let config = NetworkConfig {
            resolution: Some(range),
            ..self.config.clone()
        };
        let mut net = Self::new(&config, seed)?;
        // Those of a branch that is there already begin anew.
        let kept = self.config.layout_without_resolution();
        net.parameters[..kept].copy_from_slice(&self.parameters[..kept]);
        Ok(net)
    }

    /// Actuation and joint of the shape `descriptor` at `points`: `[n, 3]` row-major, normalised to `[-1, 1]`. A field that depends on the
    /// spacing of the grid is that for the coarsest.
    ///
    /// # Errors
    /// [`Error::DescriptorLength`], [`Error::NonFiniteDescriptor`], [`Error::PointsLength`], [`Error::NonFinitePoint`], and
    /// [`Error::NonFiniteOutput`] if the weights are so large that the output overflows.
    pub fn evaluate(&self, descriptor: &[f32], points: &[f32]) -> Result<Output, Error> {
        self.evaluate_at(descriptor, points, None)
    }

    /// [`ActuationNet::evaluate`] for a grid of elements with edge `spacing`, in the coordinates of the points. Without a field that depends on
    /// it, it does not matter.
    ///
    /// # Errors
    /// Those of [`ActuationNet::evaluate`], and [`Error::Spacing`].
    pub fn evaluate_at(
        &self,
        descriptor: &[f32],
        points: &[f32],
        spacing: Option<f32>,
    ) -> Result<Output, Error> {
        check_descriptor(self.config.descriptor, descriptor)?;
        check_points(points)?;
        check_spacing(spacing)?;
        let (conditioned, _) = self.condition::<NoneTape>(descriptor, spacing);
        output(&FieldWeights::new(&conditioned.field), &conditioned, points)
    }

    /// [`ActuationNet::evaluate`] that remembers what the reverse pass needs.
    ///
    /// Memory beside the output: a few copies of the weights; activations are recomputed in the reverse pass.
    ///
    /// # Errors
    /// Those of [`ActuationNet::evaluate`].
    pub fn trace<'p>(&self, descriptor: &[f32], points: &'p [f32]) -> Result<Traced<'p>, Error> {
        self.trace_at(descriptor, points, None)
    }

    /// [`ActuationNet::evaluate_at`] that remembers what the reverse pass needs.
    ///
    /// # Errors
    /// Those of [`ActuationNet::evaluate_at`].
    pub fn trace_at<'p>(
        &self,
        descriptor: &[f32],
        points: &'p [f32],
        spacing: Option<f32>,
    ) -> Result<Traced<'p>, Error> {
        check_descriptor(self.config.descriptor, descriptor)?;
        check_points(points)?;
        check_spacing(spacing)?;
        let (conditioned, leaves) = self.condition::<OwnedTape<f32, Cpu>>(descriptor, spacing);
        let weights = FieldWeights::new(&conditioned.field);
        Ok(Traced {
            output: output(&weights, &conditioned, points)?,
            points,
            weights,
            conditioned,
            leaves,
        })
    }

    /// [`ActuationNet::evaluate`] of a latent code itself, `[latent]`, which need not be that of any descriptor.
    ///
    /// # Errors
    /// [`Error::LatentLength`], [`Error::NonFiniteLatent`], and those of [`ActuationNet::evaluate`] for points and output.
    pub fn evaluate_latent(&self, latent: &[f32], points: &[f32]) -> Result<Output, Error> {
        check_latent(&self.config, latent)?;
        check_points(points)?;
        let conditioned = self.decode(latent, NoneTape);
        output(&FieldWeights::new(&conditioned.field), &conditioned, points)
    }

    /// [`ActuationNet::evaluate_latent`] that remembers what the reverse pass to the latent code needs; the parameters stay as
    /// they are.
    ///
    /// # Errors
    /// Those of [`ActuationNet::evaluate_latent`].
    pub fn trace_latent<'p>(
        &self,
        latent: &[f32],
        points: &'p [f32],
    ) -> Result<LatentTrace<'p>, Error> {
        check_latent(&self.config, latent)?;
        check_points(points)?;
        let conditioned = self.decode(latent, OwnedTape::<f32, Cpu>::default());
        let weights = FieldWeights::new(&conditioned.field);
        Ok(LatentTrace {
            output: output(&weights, &conditioned, points)?,
            points,
            weights,
            conditioned,
        })
    }

    /// Output and flat gradient of a loss whose derivative with respect to the output is `cotangent(output)`.
    ///
    /// # Errors
    /// Those of [`ActuationNet::evaluate`].
    ///
    /// # Panics
    /// If the cotangent's actuation has another length than the output's.
    pub fn evaluate_vjp(
        &self,
        descriptor: &[f32],
        points: &[f32],
        cotangent: impl FnOnce(&Output) -> OutputCotangent,
    ) -> Result<(Output, Vec<f32>), Error> {
        let mut traced = self.trace(descriptor, points)?;
        let bar = cotangent(traced.output());
        let output = traced.take_output();
        Ok((output, traced.backward(&bar.actuation, &bar.joint)))
    }

    fn condition<T: Tape<f32, Cpu>>(
        &self,
        descriptor: &[f32],
        spacing: Option<f32>,
    ) -> (Conditioned<f32, T>, Leaves<f32>) {
        let model = Model::new(&self.config, &self.layout, &self.parameters, spacing);
        let descriptor = Cpu::default().tensor_from_vec(descriptor.to_vec(), (descriptor.len(),));
        let conditioned = model
            .condition(descriptor.put_tape(T::default()))
            .expect(OUT_OF_MEMORY);
        (conditioned, model.into_leaves())
    }

    fn decode<T: Tape<f32, Cpu>>(&self, latent: &[f32], tape: T) -> Conditioned<f32, T> {
        let model = Model::new(&self.config, &self.layout, &self.parameters, None);
        let latent = Cpu::default().tensor_from_vec(latent.to_vec(), (latent.len(),));
        model.decode(latent, tape).expect(OUT_OF_MEMORY)
    }
}

/// An evaluation whose reverse pass is still to come: a solver may run between the two.
///
/// Holds a dfdx tape and so stays on the thread that made it.
pub struct Traced<'p> {
    output: Output,
    points: &'p [f32],
    weights: FieldWeights,
    conditioned: Conditioned<f32, OwnedTape<f32, Cpu>>,
    leaves: Leaves<f32>,
}

impl Traced<'_> {
    /// The network's output.
    pub fn output(&self) -> &Output {
        &self.output
    }

    fn take_output(&mut self) -> Output {
        let actuation = std::mem::take(&mut self.output.actuation);
        let joint = self.output.joint;
        Output { actuation, joint }
    }

    /// Flat gradient, in the order of [`ActuationNet::parameter_layout`], of a loss whose derivative with respect to the
    /// output is `actuation_bar` (`[n, 6]`) and `joint_bar`. A cotangent that is not finite gives a gradient that is not
    /// finite, which [`crate::Adam::step`] refuses.
    ///
    /// # Panics
    /// If `actuation_bar` has another length than the output's actuation.
    pub fn backward(self, actuation_bar: &[f32], joint_bar: &[f32; JOINT_SIZE]) -> Vec<f32> {
        let field_bar = field_cotangent(&self.weights, self.points, actuation_bar);
        let gradients = sweep(self.conditioned, field_bar, joint_bar).expect(OUT_OF_MEMORY);
        self.leaves.flat_gradient(&gradients)
    }
}

/// An evaluation of a latent code whose reverse pass is still to come: a solver may run between the two.
///
/// Holds a dfdx tape and so stays on the thread that made it.
pub struct LatentTrace<'p> {
    output: Output,
    points: &'p [f32],
    weights: FieldWeights,
    conditioned: Conditioned<f32, OwnedTape<f32, Cpu>>,
}

impl LatentTrace<'_> {
    /// The network's output.
    pub fn output(&self) -> &Output {
        &self.output
    }

    /// Gradient by the latent code, `[latent]`, of a loss whose derivative with respect to the output is `actuation_bar`
    /// (`[n, 6]`) and `joint_bar`. A cotangent that is not finite gives a gradient that is not finite.
    ///
    /// # Panics
    /// If `actuation_bar` has another length than the output's actuation.
    pub fn backward(self, actuation_bar: &[f32], joint_bar: &[f32; JOINT_SIZE]) -> Vec<f32> {
        let field_bar = field_cotangent(&self.weights, self.points, actuation_bar);
        let latent = self.conditioned.latent.clone();
        let gradients = sweep(self.conditioned, field_bar, joint_bar).expect(OUT_OF_MEMORY);
        gradients.get(&latent).as_vec()
    }
}

/// The cotangent of the effective weights from that of the actuation, whose length is checked.
fn field_cotangent(weights: &FieldWeights, points: &[f32], actuation_bar: &[f32]) -> FieldWeights {
    assert_eq!(
        actuation_bar.len(),
        points.len() / 3 * ACTUATION_SIZE,
        "the cotangent needs {ACTUATION_SIZE} entries per point"
    );
    weights.vjp(points, actuation_bar)
}

/// The reverse sweep from the effective weights and the joint to everything they came from. The point evaluation enters the
/// tape as one operation, whose cotangent has come from outside.
fn sweep(
    conditioned: Conditioned<f32, OwnedTape<f32, Cpu>>,
    field_bar: FieldWeights,
    joint_bar: &[f32; JOINT_SIZE],
) -> Result<Gradients<f32, Cpu>, CpuError> {
    let Conditioned {
        field,
        joint,
        mut tape,
        ..
    } = conditioned;
    tape.add_backward_op(move |gradients| field_bar.seed(&field, gradients));
    let joint_bar = Cpu::default().tensor_from_vec(joint_bar.to_vec(), (JOINT_SIZE,));
    let seeded = joint.put_tape(tape).try_mul(joint_bar)?;
    seeded.try_sum::<Rank0, _>()?.try_backward()
}

fn output<T>(
    weights: &FieldWeights,
    conditioned: &Conditioned<f32, T>,
    points: &[f32],
) -> Result<Output, Error> {
    let actuation = weights.forward(points);
    let mut joint = [0.0; JOINT_SIZE];
    conditioned.joint.copy_into(&mut joint);
    check_output("actuation", &actuation)?;
    check_output("joint", &joint)?;
    Ok(Output { actuation, joint })
}

fn first_non_finite<E: num_traits::Float>(values: &[E]) -> Option<(usize, f64)> {
    let index = values.iter().position(|value| !value.is_finite())?;
    Some((index, values[index].to_f64().unwrap_or(f64::NAN)))
}

/// The finiteness of one output of a network.
pub(crate) fn check_output<E: num_traits::Float>(
    output: &'static str,
    values: &[E],
) -> Result<(), Error> {
    match first_non_finite(values) {
        None => Ok(()),
        Some((index, value)) => Err(Error::NonFiniteOutput {
            output,
            index,
            value,
        }),
    }
}

/// The length and finiteness of flat parameters.
pub(crate) fn check_parameters<E: num_traits::Float>(
    layout: &[ParameterTensor],
    parameters: &[E],
) -> Result<(), Error> {
    let expected = layout.last().map_or(0, |tensor| tensor.range.end);
    if parameters.len() != expected {
        return Err(Error::ParameterCount {
            expected,
            found: parameters.len(),
        });
    }
    for tensor in layout {
        if let Some((index, value)) = first_non_finite(&parameters[tensor.range.clone()]) {
            return Err(Error::NonFiniteParameter {
                tensor: tensor.name.clone(),
                index,
                value,
            });
        }
    }
    Ok(())
}

/// The length and finiteness of a descriptor.
pub(crate) fn check_descriptor<E: num_traits::Float>(
    expected: usize,
    descriptor: &[E],
) -> Result<(), Error> {
    if descriptor.len() != expected {
        return Err(Error::DescriptorLength {
            expected,
            found: descriptor.len(),
        });
    }
    match first_non_finite(descriptor) {
        None => Ok(()),
        Some((index, value)) => Err(Error::NonFiniteDescriptor { index, value }),
    }
}

/// The length and finiteness of a latent code.
pub(crate) fn check_latent<E: num_traits::Float>(
    config: &NetworkConfig,
    latent: &[E],
) -> Result<(), Error> {
    if latent.len() != config.latent {
        return Err(Error::LatentLength {
            expected: config.latent,
            found: latent.len(),
        });
    }
    match first_non_finite(latent) {
        None => Ok(()),
        Some((index, value)) => Err(Error::NonFiniteLatent { index, value }),
    }
}

/// A length above zero.
fn check_spacing(spacing: Option<f32>) -> Result<(), Error> {
    match spacing.filter(|h| !(h.is_finite() && *h > 0.0)) {
        None => Ok(()),
        Some(found) => Err(Error::Spacing { found }),
    }
}

/// The length and finiteness of flat points.
pub(crate) fn check_points<E: num_traits::Float>(points: &[E]) -> Result<(), Error> {
    if !points.len().is_multiple_of(3) {
        return Err(Error::PointsLength {
            found: points.len(),
        });
    }
    match first_non_finite(points) {
        None => Ok(()),
        Some((index, value)) => Err(Error::NonFinitePoint {
            point: index / 3,
            axis: index % 3,
            value,
        }),
    }
}
