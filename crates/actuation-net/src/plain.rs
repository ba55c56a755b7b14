//! The same network by plain dfdx operations with the whole tape, in f32 or f64: slow, and the reference for everything else.

use dfdx::prelude::{
    Backward, Cpu, Device, Dtype, NoneTape, OwnedTape, PutTape, Rank0, SplitTape, SumTo,
    TensorFromVec, TryAdd, TryMul,
};

use crate::model::{Conditioned, Matrix, Model};
use crate::net::{OUT_OF_MEMORY, check_descriptor, check_latent, check_parameters, check_points};
use crate::{
    ACTUATION_SIZE, ActuationNet, Error, JOINT_SIZE, NetworkConfig, Output, OutputCotangent,
    ParameterTensor,
};

/// The scalars that [`PlainNet`] and [`crate::ExplicitDecoder`] compute with: `f32` and `f64`.
pub trait Real: Dtype + num_traits::Float + sealed::Sealed {}

impl Real for f32 {}
impl Real for f64 {}

mod sealed {
    pub trait Sealed {}
    impl Sealed for f32 {}
    impl Sealed for f64 {}
}

/// A network on the plain dfdx path. Every activation of every point is kept on the tape: use it for checks, with few points.
#[derive(Debug, Clone, PartialEq)]
pub struct PlainNet<E> {
    config: NetworkConfig,
    layout: Vec<ParameterTensor>,
    parameters: Vec<E>,
    spacing: Option<f32>,
}

impl<E: Real> PlainNet<E>
where
    Cpu: Device<E>,
{
    /// The same network with its parameters converted to `E`.
    pub fn from_net(net: &ActuationNet) -> Self {
        let convert = |p: f32| E::from_f32(p).expect("every float takes an f32");
        Self {
            config: net.config().clone(),
            layout: net.parameter_layout().to_vec(),
            parameters: net.parameters().into_iter().map(convert).collect(),
            spacing: None,
        }
    }

    /// Evaluates for a grid of this spacing from now on: the counterpart of [`ActuationNet::evaluate_at`].
    pub fn set_spacing(&mut self, spacing: Option<f32>) {
        self.spacing = spacing;
    }

    /// All parameters, flat, in the order of [`NetworkConfig::parameter_layout`].
    pub fn parameters(&self) -> &[E] {
        &self.parameters
    }

    /// Replaces all parameters.
    ///
    /// # Errors
    /// [`Error::ParameterCount`] and [`Error::NonFiniteParameter`]; then nothing has changed.
    pub fn set_parameters(&mut self, parameters: &[E]) -> Result<(), Error> {
        check_parameters(&self.layout, parameters)?;
        self.parameters.copy_from_slice(parameters);
        Ok(())
    }

    /// The plain counterpart of [`ActuationNet::evaluate`].
    ///
    /// # Errors
    /// As there, but overflow is not looked for.
    pub fn evaluate(&self, descriptor: &[E], points: &[E]) -> Result<Output<E>, Error> {
        check_descriptor(self.config.descriptor, descriptor)?;
        check_points(points)?;
        let device = Cpu::default();
        let model = Model::new(&self.config, &self.layout, &self.parameters, self.spacing);
        let descriptor = device.tensor_from_vec(descriptor.to_vec(), (descriptor.len(),));
        let points = device.tensor_from_vec(points.to_vec(), (points.len() / 3, 3));
        let conditioned = model
            .condition::<NoneTape>(descriptor)
            .expect(OUT_OF_MEMORY);
        Ok(output(&conditioned, points))
    }

    /// The plain counterpart of [`ActuationNet::evaluate_latent`].
    ///
    /// # Errors
    /// As there, but overflow is not looked for.
    pub fn evaluate_latent(&self, latent: &[E], points: &[E]) -> Result<Output<E>, Error> {
        check_latent(&self.config, latent)?;
        check_points(points)?;
        let device = Cpu::default();
        let model = Model::new(&self.config, &self.layout, &self.parameters, self.spacing);
        let latent = device.tensor_from_vec(latent.to_vec(), (latent.len(),));
        let points = device.tensor_from_vec(points.to_vec(), (points.len() / 3, 3));
        let conditioned = model.decode(latent, NoneTape).expect(OUT_OF_MEMORY);
        Ok(output(&conditioned, points))
    }

    /// The plain counterpart of [`ActuationNet::evaluate_vjp`].
    ///
    /// # Errors
    /// As [`PlainNet::evaluate`].
    ///
    /// # Panics
    /// If the cotangent's actuation has another length than the output's.
    pub fn evaluate_vjp(
        &self,
        descriptor: &[E],
        points: &[E],
        cotangent: impl FnOnce(&Output<E>) -> OutputCotangent<E>,
    ) -> Result<(Output<E>, Vec<E>), Error> {
        check_descriptor(self.config.descriptor, descriptor)?;
        check_points(points)?;
        let device = Cpu::default();
        let model = Model::new(&self.config, &self.layout, &self.parameters, self.spacing);
        let descriptor = device.tensor_from_vec(descriptor.to_vec(), (descriptor.len(),));
        let shape = (points.len() / 3, 3);
        let points = device.tensor_from_vec(points.to_vec(), shape);
        let conditioned = model
            .condition(descriptor.put_tape(OwnedTape::default()))
            .expect(OUT_OF_MEMORY);
        let (actuation, tape) = conditioned
            .field
            .forward(points.put_tape(conditioned.tape))
            .expect(OUT_OF_MEMORY)
            .split_tape();
        let output = Output {
            actuation: actuation.as_vec(),
            joint: joint_array(&conditioned.joint.as_vec()),
        };

        let bar = cotangent(&output);
        assert_eq!(bar.actuation.len(), output.actuation.len());
        let actuation_bar = device.tensor_from_vec(bar.actuation, (shape.0, ACTUATION_SIZE));
        let joint_bar = device.tensor_from_vec(bar.joint.to_vec(), (JOINT_SIZE,));
        let gradients = (|| {
            let (of_joint, tape) = conditioned
                .joint
                .put_tape(tape)
                .try_mul(joint_bar)?
                .try_sum::<Rank0, _>()?
                .split_tape();
            let of_field = actuation.put_tape(tape).try_mul(actuation_bar)?;
            let loss = of_field.try_sum::<Rank0, _>()?.try_add(of_joint)?;
            loss.try_backward()
        })()
        .expect(OUT_OF_MEMORY);
        Ok((output, model.into_leaves().flat_gradient(&gradients)))
    }
}

fn output<E: Real>(conditioned: &Conditioned<E, NoneTape>, points: Matrix<E>) -> Output<E>
where
    Cpu: Device<E>,
{
    let actuation = conditioned.field.forward(points).expect(OUT_OF_MEMORY);
    Output {
        actuation: actuation.as_vec(),
        joint: joint_array(&conditioned.joint.as_vec()),
    }
}

/// The joint's values as an array.
pub(crate) fn joint_array<E: Copy>(joint: &[E]) -> [E; JOINT_SIZE] {
    std::array::from_fn(|i| joint[i])
}
