//! The network as dfdx tensors: everything that happens once per shape, on the tape.

use std::ops::Range;

use dfdx::prelude::*;

use crate::layout::SINE_LAYERS;
use crate::{JOINT_SIZE, NetworkConfig, ParameterTensor};

/// Slope of the leaky rectifiers for negative input.
const LEAK: f64 = 0.01;

pub(crate) type Vector<E, T = NoneTape> = Tensor<(usize,), E, Cpu, T>;
pub(crate) type Matrix<E, T = NoneTape> = Tensor<(usize, usize), E, Cpu, T>;

/// A fully connected layer, `weight` `[outputs, inputs]`.
#[derive(Clone)]
pub(crate) struct Affine<E: Dtype> {
    pub weight: Matrix<E>,
    pub bias: Vector<E>,
}

struct SineLayer<E: Dtype> {
    affine: Affine<E>,
    modulation: Affine<E>,
}

/// All trainable tensors, made from a flat parameter vector.
pub(crate) struct Model<E: Dtype> {
    omega: E,
    encoder: [Affine<E>; 3],
    sine: [SineLayer<E>; SINE_LAYERS],
    head: Affine<E>,
    joint: [Affine<E>; 3],
    /// What the spacing of a grid adds to the code of the field, and the encoded spacing.
    resolution: Option<([Affine<E>; 3], Vector<E>)>,
    leaves: Leaves<E>,
}

/// The actuation field of one shape: a plain network, the latent code being folded into its weights.
pub(crate) struct Field<E: Dtype> {
    /// Four sine layers, `sin(weight h + bias)`, with `weight = omega W diag(1 + a(z))`.
    pub sine: [Affine<E>; SINE_LAYERS],
    pub head: Affine<E>,
}

/// What a model makes of one descriptor; `tape` leads back from every tensor to the parameters.
pub(crate) struct Conditioned<E: Dtype, T> {
    pub latent: Vector<E>,
    pub field: Field<E>,
    pub joint: Vector<E>,
    pub tape: T,
}

impl<E: Dtype> Model<E>
where
    Cpu: Device<E>,
{
    /// `parameters` must follow `layout`. Where the field depends on the spacing of the grid, it is that for `spacing`, or for the coarsest
    /// grid.
    pub fn new(
        config: &NetworkConfig,
        layout: &[ParameterTensor],
        parameters: &[E],
        spacing: Option<f32>,
    ) -> Self {
        let mut reader = Reader::new(layout, parameters);
        let encoder = std::array::from_fn(|_| reader.affine());
        let sine = std::array::from_fn(|_| SineLayer {
            affine: reader.affine(),
            modulation: reader.affine(),
        });
        let head = reader.affine();
        let joint = std::array::from_fn(|_| reader.affine());
        let resolution = config.resolution.map(|range| {
            let features = range.encoded(spacing.unwrap_or(range.coarse));
            let features = features.map(|x| E::from_f64(x).expect("every float takes a sine"));
            let features = Cpu::default().tensor_from_vec(features.to_vec(), (features.len(),));
            (std::array::from_fn(|_| reader.affine()), features)
        });
        Self {
            omega: E::from_f32(config.omega).expect("every float takes a frequency"),
            encoder,
            sine,
            head,
            joint,
            resolution,
            leaves: reader.into_leaves(),
        }
    }

    /// Encoder, modulation and bone network of one shape.
    pub fn condition<T: Tape<E, Cpu>>(
        &self,
        descriptor: Vector<E, T>,
    ) -> Result<Conditioned<E, T>, CpuError> {
        let (latent, tape) = dense_stack(&self.encoder, descriptor)?.split_tape();
        self.decode(latent, tape)
    }

    /// Modulation and bone network of one latent code; `tape` holds how the code came about.
    pub fn decode<T: Tape<E, Cpu>>(
        &self,
        latent: Vector<E>,
        mut tape: T,
    ) -> Result<Conditioned<E, T>, CpuError> {
        // The jaw does not know of grids: what the spacing adds is for the field alone.
        let mut code = latent.clone();
        if let Some((layers, features)) = &self.resolution {
            let offset;
            (offset, tape) = dense_stack(layers, features.clone().put_tape(tape))?.split_tape();
            (code, tape) = latent.clone().put_tape(tape).try_add(offset)?.split_tape();
        }
        let mut sine = Vec::with_capacity(SINE_LAYERS);
        for layer in &self.sine {
            let weight;
            (weight, tape) = layer
                .modulated_weight(self.omega, code.clone().put_tape(tape))?
                .split_tape();
            let bias = layer.affine.bias.clone();
            sine.push(Affine { weight, bias });
        }
        let (joint, tape) = dense_stack(&self.joint, latent.clone().put_tape(tape))?.split_tape();
        debug_assert_eq!(joint.shape().0, JOINT_SIZE);
        let Ok(sine) = sine.try_into() else {
            unreachable!("one effective weight per sine layer");
        };
        let head = self.head.clone();
        Ok(Conditioned {
            latent,
            field: Field { sine, head },
            joint,
            tape,
        })
    }

    /// Where to find the gradient of each parameter after the reverse sweep.
    pub fn into_leaves(self) -> Leaves<E> {
        self.leaves
    }
}

impl<E: Dtype> Affine<E>
where
    Cpu: Device<E>,
{
    /// `weight x + bias`.
    pub fn forward<T: Tape<E, Cpu>>(&self, x: Vector<E, T>) -> Result<Vector<E, T>, CpuError> {
        let transposed = self.weight.clone().try_permute::<_, Axes2<1, 0>>()?;
        x.try_matmul(transposed)?.try_add(self.bias.clone())
    }

    /// The same, and a leaky rectifier.
    pub fn forward_rectified<T: Tape<E, Cpu>>(
        &self,
        x: Vector<E, T>,
    ) -> Result<Vector<E, T>, CpuError> {
        let leak = E::from_f64(LEAK).expect("every float takes the leak");
        self.forward(x)?.try_prelu(leak)
    }

    /// The same as `forward` for every row of `x`.
    fn forward_rows<T: Tape<E, Cpu>>(&self, x: Matrix<E, T>) -> Result<Matrix<E, T>, CpuError> {
        let transposed = self.weight.clone().try_permute::<_, Axes2<1, 0>>()?;
        let product = x.try_matmul(transposed)?;
        let bias = self.bias.retaped::<T>();
        let bias = bias.try_broadcast_like::<_, Axis<0>>(product.shape())?;
        product.try_add(bias)
    }
}

impl<E: Dtype> SineLayer<E>
where
    Cpu: Device<E>,
{
    /// `omega W diag(1 + a(z))`.
    fn modulated_weight<T: Tape<E, Cpu>>(
        &self,
        omega: E,
        latent: Vector<E, T>,
    ) -> Result<Matrix<E, T>, CpuError> {
        let one = E::from_f32(1.0).expect("every float takes 1");
        let scale = self.modulation.forward(latent)?;
        let scale = scale.try_add(one)?.try_mul(omega)?;
        let weight = &self.affine.weight;
        scale
            .try_broadcast_like::<_, Axis<0>>(weight.shape())?
            .try_mul(weight.clone())
    }
}

impl<E: Dtype> Field<E>
where
    Cpu: Device<E>,
{
    /// All points at once with every activation on the tape: the plain path that the fused one is measured against.
    pub fn forward<T: Tape<E, Cpu>>(&self, points: Matrix<E, T>) -> Result<Matrix<E, T>, CpuError> {
        let mut h = points;
        for layer in &self.sine {
            h = layer.forward_rows(h)?.try_sin()?;
        }
        self.head.forward_rows(h)
    }
}

/// Three layers with leaky rectifiers between them.
pub(crate) fn dense_stack<E: Dtype, T: Tape<E, Cpu>>(
    layers: &[Affine<E>; 3],
    x: Vector<E, T>,
) -> Result<Vector<E, T>, CpuError>
where
    Cpu: Device<E>,
{
    let h = layers[0].forward_rectified(x)?;
    let h = layers[1].forward_rectified(h)?;
    layers[2].forward(h)
}

/// Turns the flat vector into tensors, in the order of the layout.
pub(crate) struct Reader<'a, E: Dtype> {
    layout: std::slice::Iter<'a, ParameterTensor>,
    parameters: &'a [E],
    device: Cpu,
    leaves: Leaves<E>,
}

impl<'a, E: Dtype> Reader<'a, E>
where
    Cpu: Device<E>,
{
    /// `parameters` must follow `layout`.
    pub fn new(layout: &'a [ParameterTensor], parameters: &'a [E]) -> Self {
        Self {
            layout: layout.iter(),
            parameters,
            device: Cpu::default(),
            leaves: Leaves {
                entries: Vec::new(),
            },
        }
    }

    /// The next layer.
    pub fn affine(&mut self) -> Affine<E> {
        let (shape, range) = self.next();
        let values = self.parameters[range].to_vec();
        let weight = self.device.tensor_from_vec(values, (shape[0], shape[1]));
        self.leaves.entries.push(Leaf::Matrix(weight.clone()));

        let (shape, range) = self.next();
        let values = self.parameters[range].to_vec();
        let bias = self.device.tensor_from_vec(values, (shape[0],));
        self.leaves.entries.push(Leaf::Vector(bias.clone()));
        Affine { weight, bias }
    }

    /// The tensors read so far.
    pub fn into_leaves(self) -> Leaves<E> {
        self.leaves
    }

    fn next(&mut self) -> (&'a [usize], Range<usize>) {
        let tensor = self
            .layout
            .next()
            .expect("the layout lists every tensor of the model");
        (&tensor.shape, tensor.range.clone())
    }
}

enum Leaf<E: Dtype> {
    Matrix(Matrix<E>),
    Vector(Vector<E>),
}

/// The trainable tensors in the order of the layout.
pub(crate) struct Leaves<E: Dtype> {
    entries: Vec<Leaf<E>>,
}

impl<E: Dtype> Leaves<E>
where
    Cpu: Device<E>,
{
    /// The flat gradient after a reverse sweep that reached every leaf.
    pub fn flat_gradient(&self, gradients: &Gradients<E, Cpu>) -> Vec<E> {
        self.entries
            .iter()
            .flat_map(|leaf| match leaf {
                Leaf::Matrix(tensor) => gradients.get(tensor).as_vec(),
                Leaf::Vector(tensor) => gradients.get(tensor).as_vec(),
            })
            .collect()
    }
}
