//! An explicit decoder: fully connected layers that give the actuation of all elements at once, as networks for active
//! quasi-static bodies did before they were fields (Srinivasan et al. 2021, "Learning active quasistatic physics-based models from
//! data"). It is here to be compared with: its size grows with the grid, and it knows no other grid.

use dfdx::prelude::{
    Backward, Cpu, CpuError, Device, NoneTape, OwnedTape, PutTape, Rank0, SplitTape, SumTo, Tape,
    TensorFromVec, TryAdd, TryMul,
};
use serde::{Deserialize, Serialize};

use crate::config::check_code_sizes;
use crate::layout::{decoder_layout, initial_parameters};
use crate::model::{Leaves, Reader, Vector, dense_stack};
use crate::net::{OUT_OF_MEMORY, check_descriptor, check_output, check_parameters};
use crate::plain::{Real, joint_array};
use crate::{ACTUATION_SIZE, Error, JOINT_SIZE, Output, ParameterTensor};

/// Widest hidden layers.
const MAX_WIDTH: usize = 4096;
/// Most elements: the number of parameters then still fits a usize for every width.
const MAX_ELEMENTS: usize = 1 << 28;

/// Sizes of an explicit decoder.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DecoderConfig {
    /// Number of basis weights that describe a shape, 1 to 64.
    pub descriptor: usize,
    /// Size of the latent code `z`, 1 to 256.
    pub latent: usize,
    /// Width of the two hidden layers behind the latent code, 1 to 4096.
    pub width: usize,
    /// Elements of the grid, each with one actuation.
    pub elements: usize,
}

impl DecoderConfig {
    /// Checks every field against its documented range.
    ///
    /// # Errors
    /// [`Error::DescriptorSize`], [`Error::LatentSize`], [`Error::DecoderWidth`] or [`Error::ElementCount`].
    pub fn validate(&self) -> Result<(), Error> {
        check_code_sizes(self.descriptor, self.latent)?;
        if !(1..=MAX_WIDTH).contains(&self.width) {
            return Err(Error::DecoderWidth {
                found: self.width,
                largest: MAX_WIDTH,
            });
        }
        if !(1..=MAX_ELEMENTS).contains(&self.elements) {
            return Err(Error::ElementCount {
                found: self.elements,
                largest: MAX_ELEMENTS,
            });
        }
        Ok(())
    }

    /// Names, shapes and places of all parameters in the flat vector, in order.
    pub fn parameter_layout(&self) -> Vec<ParameterTensor> {
        decoder_layout(self)
    }
}

/// Encoder and bone network as in [`crate::ActuationNet`], and between them: latent code -> two layers of `width` with leaky
/// rectifiers -> six numbers for every element.
///
/// The scalar is f32 but for checks of gradients, which want f64.
#[derive(Debug, Clone, PartialEq)]
pub struct ExplicitDecoder<E = f32> {
    config: DecoderConfig,
    layout: Vec<ParameterTensor>,
    parameters: Vec<E>,
}

impl ExplicitDecoder {
    /// A decoder with freshly drawn weights; the same seed gives the same weights. Head and joint start at a hundredth of the
    /// scale of the other layers (He et al. 2015), so that `A` is close to `I` and the bones are close to rest.
    ///
    /// # Errors
    /// Those of [`DecoderConfig::validate`].
    pub fn new(config: &DecoderConfig, seed: u64) -> Result<Self, Error> {
        config.validate()?;
        let layout = decoder_layout(config);
        let parameters = initial_parameters(&layout, seed);
        Ok(Self {
            config: config.clone(),
            layout,
            parameters,
        })
    }
}

impl<E: Real> ExplicitDecoder<E>
where
    Cpu: Device<E>,
{
    /// A decoder with given parameters, in the order of [`DecoderConfig::parameter_layout`].
    ///
    /// # Errors
    /// Those of [`DecoderConfig::validate`], [`Error::ParameterCount`] and [`Error::NonFiniteParameter`].
    pub fn from_parameters(config: &DecoderConfig, parameters: Vec<E>) -> Result<Self, Error> {
        config.validate()?;
        let layout = decoder_layout(config);
        check_parameters(&layout, &parameters)?;
        Ok(Self {
            config: config.clone(),
            layout,
            parameters,
        })
    }

    /// The sizes this decoder was made with.
    pub fn config(&self) -> &DecoderConfig {
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

    /// All parameters, flat, in the order of [`DecoderConfig::parameter_layout`].
    pub fn parameters(&self) -> &[E] {
        &self.parameters
    }

    /// All parameters in place, for an optimiser such as [`crate::Adam`], which keeps them finite.
    pub fn parameters_mut(&mut self) -> &mut [E] {
        &mut self.parameters
    }

    /// Joint and actuation, `[elements, 6]`, of the shape `descriptor`.
    ///
    /// # Errors
    /// [`Error::DescriptorLength`], [`Error::NonFiniteDescriptor`], and [`Error::NonFiniteOutput`] if the weights are so large
    /// that the output overflows.
    pub fn evaluate(&self, descriptor: &[E]) -> Result<Output<E>, Error> {
        let (code, _) = self.decode::<NoneTape>(descriptor)?;
        self.output(&code)
    }

    /// [`ExplicitDecoder::evaluate`] that remembers what the reverse pass needs.
    ///
    /// # Errors
    /// Those of [`ExplicitDecoder::evaluate`].
    pub fn trace(&self, descriptor: &[E]) -> Result<TracedDecoder<'_, E>, Error> {
        let (code, leaves) = self.decode::<OwnedTape<E, Cpu>>(descriptor)?;
        Ok(TracedDecoder {
            output: self.output(&code)?,
            decoder: self,
            code,
            leaves,
        })
    }

    /// Everything but the head, on the tape.
    fn decode<T: Tape<E, Cpu>>(&self, descriptor: &[E]) -> Result<(Code<E, T>, Leaves<E>), Error> {
        check_descriptor(self.config.descriptor, descriptor)?;
        let mut reader = Reader::new(&self.layout, &self.parameters);
        let encoder = std::array::from_fn(|_| reader.affine());
        let hidden = [reader.affine(), reader.affine()];
        let joint = std::array::from_fn(|_| reader.affine());
        let descriptor = Cpu::default().tensor_from_vec(descriptor.to_vec(), (descriptor.len(),));
        let code = (|| {
            let (latent, tape) =
                dense_stack(&encoder, descriptor.put_tape(T::default()))?.split_tape();
            let mut h = latent.clone().put_tape(tape);
            for layer in &hidden {
                h = layer.forward_rectified(h)?;
            }
            let (hidden, tape) = h.split_tape();
            let (joint, tape) = dense_stack(&joint, latent.put_tape(tape))?.split_tape();
            Ok::<_, CpuError>(Code {
                hidden,
                joint,
                tape,
            })
        })();
        Ok((code.expect(OUT_OF_MEMORY), reader.into_leaves()))
    }

    /// The head's weight, `[6 elements, width]`, and bias.
    ///
    /// It stays off the tape, which would copy it, and it is nearly all there is.
    fn head(&self) -> (&[E], &[E]) {
        let [.., weight, bias] = self.layout.as_slice() else {
            unreachable!("the layout ends with the head");
        };
        let part = |tensor: &ParameterTensor| &self.parameters[tensor.range.clone()];
        (part(weight), part(bias))
    }

    fn output<T>(&self, code: &Code<E, T>) -> Result<Output<E>, Error> {
        let hidden = code.hidden.as_vec();
        let (weight, bias) = self.head();
        let rows = weight.chunks_exact(self.config.width).zip(bias);
        let actuation: Vec<E> = rows.map(|(row, &b)| dot(row, &hidden) + b).collect();
        let joint = joint_array(&code.joint.as_vec());
        check_output("actuation", &actuation)?;
        check_output("joint", &joint)?;
        Ok(Output { actuation, joint })
    }
}

/// What the head and the solver take; `tape` leads back to the parameters in front.
struct Code<E: Real, T> {
    hidden: Vector<E>,
    joint: Vector<E>,
    tape: T,
}

/// An evaluation whose reverse pass is still to come: a solver may run between the two.
pub struct TracedDecoder<'d, E: Real = f32> {
    output: Output<E>,
    decoder: &'d ExplicitDecoder<E>,
    code: Code<E, OwnedTape<E, Cpu>>,
    leaves: Leaves<E>,
}

impl<E: Real> TracedDecoder<'_, E>
where
    Cpu: Device<E>,
{
    /// The decoder's output.
    pub fn output(&self) -> &Output<E> {
        &self.output
    }

    /// Flat gradient, in the order of [`DecoderConfig::parameter_layout`], of a loss whose derivative with respect to the output
    /// is `actuation_bar` (`[elements, 6]`) and `joint_bar`.
    ///
    /// # Panics
    /// If `actuation_bar` has another length than the output's actuation.
    pub fn backward(self, actuation_bar: &[E], joint_bar: &[E; JOINT_SIZE]) -> Vec<E> {
        let DecoderConfig {
            width, elements, ..
        } = self.decoder.config;
        assert_eq!(
            actuation_bar.len(),
            ACTUATION_SIZE * elements,
            "the cotangent needs {ACTUATION_SIZE} entries per element"
        );
        let hidden = self.code.hidden.as_vec();
        let (weight, _) = self.decoder.head();
        let mut hidden_bar = vec![E::zero(); width];
        for (row, &bar) in weight.chunks_exact(width).zip(actuation_bar) {
            let sums = hidden_bar.iter_mut().zip(row);
            sums.for_each(|(sum, &w)| *sum += bar * w);
        }
        let mut gradient = sweep(self.code, hidden_bar, joint_bar, &self.leaves);
        gradient.reserve_exact(self.decoder.parameters.len() - gradient.len());
        for &bar in actuation_bar {
            gradient.extend(hidden.iter().map(|&h| bar * h));
        }
        gradient.extend_from_slice(actuation_bar);
        gradient
    }
}

/// The gradient of everything in front of the head.
fn sweep<E: Real>(
    code: Code<E, OwnedTape<E, Cpu>>,
    hidden_bar: Vec<E>,
    joint_bar: &[E; JOINT_SIZE],
    leaves: &Leaves<E>,
) -> Vec<E>
where
    Cpu: Device<E>,
{
    let device = Cpu::default();
    let width = hidden_bar.len();
    let hidden_bar = device.tensor_from_vec(hidden_bar, (width,));
    let joint_bar = device.tensor_from_vec(joint_bar.to_vec(), (JOINT_SIZE,));
    let gradients = (|| {
        let of_joint = code.joint.put_tape(code.tape).try_mul(joint_bar)?;
        let (of_joint, tape) = of_joint.try_sum::<Rank0, _>()?.split_tape();
        let of_hidden = code.hidden.put_tape(tape).try_mul(hidden_bar)?;
        let loss = of_hidden.try_sum::<Rank0, _>()?.try_add(of_joint)?;
        loss.try_backward()
    })();
    leaves.flat_gradient(&gradients.expect(OUT_OF_MEMORY))
}

/// Sums in eight lanes: one running sum would wait for itself at every term.
fn dot<E: Real>(a: &[E], b: &[E]) -> E {
    let (a_lanes, a_rest) = a.as_chunks::<8>();
    let (b_lanes, b_rest) = b.as_chunks::<8>();
    let mut sums = [E::zero(); 8];
    for (a, b) in a_lanes.iter().zip(b_lanes) {
        for ((sum, &a), &b) in sums.iter_mut().zip(a).zip(b) {
            *sum += a * b;
        }
    }
    let rest = a_rest.iter().zip(b_rest).map(|(&a, &b)| a * b);
    sums.into_iter().chain(rest).fold(E::zero(), |s, x| s + x)
}
