//! The one list of all parameters: names, shapes, places in the flat vector and initial ranges.

use std::ops::Range;

use dfdx::prelude::{Cpu, SampleTensor};
use rand_distr::Uniform;

use crate::{ACTUATION_SIZE, DecoderConfig, JOINT_SIZE, NetworkConfig};

/// Number of modulated sine layers.
pub(crate) const SINE_LAYERS: usize = 4;
/// Width of the encoder's hidden layers.
const ENCODER_WIDTH: usize = 64;
/// Width of the bone network's hidden layers.
const JOINT_WIDTH: usize = 32;
/// Numbers that encode the spacing of a grid.
pub(crate) const RESOLUTION_FEATURES: usize = 4;
/// Width of the hidden layers of the branch that makes the field depend on the spacing.
const RESOLUTION_WIDTH: usize = 32;
/// Scale of the layers that must start close to zero: modulation (a plain SIREN at first), head (`A` close to `I`) and the
/// bone network's last layer (bones at rest).
const SMALL: f32 = 0.01;

/// One named parameter tensor inside the flat parameter vector.
///
/// Names, in order (`W` the width, `d` the descriptor's size, `z` the latent size):
/// `encoder.{0,1,2}.{weight,bias}` (`[64,d]`, `[64,64]`, `[z,64]`), then for each of the four sine layers with `n` inputs
/// `sine.{0..3}.weight` `[W,n]`, `.bias` `[W]`, `.modulation.weight` `[n,z]`, `.modulation.bias` `[n]`, then
/// `head.{weight,bias}` (`[6,W]`), then `joint.{0,1,2}.{weight,bias}` (`[32,z]`, `[32,32]`, `[5,32]`), and, where the field depends on the spacing of the grid,
/// `resolution.{0,1,2}.{weight,bias}` (`[32,4]`, `[32,32]`, `[z,32]`).
/// Those of an [`crate::ExplicitDecoder`] of `e` elements: `encoder` as above, `decoder.{0,1}.{weight,bias}` (`[W,z]`, `[W,W]`),
/// `joint` as above, and `head.{weight,bias}` (`[6e,W]`).
/// Matrices are row-major, `[outputs, inputs]`.
#[derive(Debug, Clone, PartialEq)]
pub struct ParameterTensor {
    /// Dotted name, also the tensor's name in a weights file.
    pub name: String,
    /// `[outputs, inputs]` of a matrix, `[outputs]` of a bias.
    pub shape: Vec<usize>,
    /// Where its entries lie in the flat parameter vector.
    pub range: Range<usize>,
    /// Initial values are uniform in plus/minus this.
    bound: f32,
}

impl ParameterTensor {
    /// Initial values: independent and uniform in plus/minus the tensor's bound.
    fn sample(&self, device: &Cpu) -> Vec<f32> {
        if self.bound == 0.0 {
            return vec![0.0; self.range.len()];
        }
        let distribution = Uniform::new(-self.bound, self.bound);
        device
            .sample_like(&(self.range.len(),), distribution)
            .as_vec()
    }
}

/// The parameters of a valid configuration, in flat order.
pub(crate) fn parameter_layout(config: &NetworkConfig) -> Vec<ParameterTensor> {
    let (width, latent) = (config.width.size(), config.latent);
    let mut list = List::default();

    list.encoder(config.descriptor, latent);
    for layer in 0..SINE_LAYERS {
        let inputs = if layer == 0 { 3 } else { width };
        list.sine_layer(layer, inputs, config);
    }
    list.head(ACTUATION_SIZE, width);
    list.joint(latent);
    // Last, so that the parameters before are those of the same network without it.
    if config.resolution.is_some() {
        list.resolution(latent);
    }
    list.tensors
}

/// The parameters of a valid decoder, in flat order: the head, far the largest part, comes last.
pub(crate) fn decoder_layout(config: &DecoderConfig) -> Vec<ParameterTensor> {
    let (width, latent) = (config.width, config.latent);
    let mut list = List::default();
    list.encoder(config.descriptor, latent);
    list.dense("decoder.0", [width, latent], 1.0);
    list.dense("decoder.1", [width, width], 1.0);
    list.joint(latent);
    list.head(ACTUATION_SIZE * config.elements, width);
    list.tensors
}

/// Seeded initial values of all parameters of a valid configuration.
pub(crate) fn initial_parameters(layout: &[ParameterTensor], seed: u64) -> Vec<f32> {
    let device = Cpu::seed_from_u64(seed);
    layout
        .iter()
        .flat_map(|tensor| tensor.sample(&device))
        .collect()
}

/// Bound of a uniform distribution that keeps the variance through a rectified layer (He et al. 2015).
fn he_bound(inputs: usize) -> f32 {
    (6.0 / inputs as f32).sqrt()
}

/// Collects tensors one after another.
#[derive(Default)]
struct List {
    tensors: Vec<ParameterTensor>,
}

impl List {
    fn push(&mut self, name: String, shape: &[usize], bound: f32) {
        let start = self.tensors.last().map_or(0, |last| last.range.end);
        self.tensors.push(ParameterTensor {
            name,
            shape: shape.to_vec(),
            range: start..start + shape.iter().product::<usize>(),
            bound,
        });
    }

    fn affine(&mut self, name: &str, shape: [usize; 2], weight_bound: f32, bias_bound: f32) {
        self.push(format!("{name}.weight"), &shape, weight_bound);
        self.push(format!("{name}.bias"), &shape[..1], bias_bound);
    }

    /// Three fully connected layers; `last_scale` shrinks the last one.
    fn dense_stack(&mut self, name: &str, sizes: [usize; 4], last_scale: f32) {
        for layer in 0..3 {
            let scale = if layer == 2 { last_scale } else { 1.0 };
            let shape = [sizes[layer + 1], sizes[layer]];
            self.dense(&format!("{name}.{layer}"), shape, scale);
        }
    }

    /// A fully connected layer, `[outputs, inputs]`, whose initial values are `scale` times those of He et al. 2015.
    fn dense(&mut self, name: &str, shape: [usize; 2], scale: f32) {
        let inputs = shape[1];
        let bias_bound = scale / (inputs as f32).sqrt();
        self.affine(name, shape, scale * he_bound(inputs), bias_bound);
    }

    fn encoder(&mut self, descriptor: usize, latent: usize) {
        let sizes = [descriptor, ENCODER_WIDTH, ENCODER_WIDTH, latent];
        self.dense_stack("encoder", sizes, 1.0);
    }

    fn joint(&mut self, latent: usize) {
        let sizes = [latent, JOINT_WIDTH, JOINT_WIDTH, JOINT_SIZE];
        self.dense_stack("joint", sizes, SMALL);
    }

    /// The last layer starts at zero: the field is then that without the branch.
    fn resolution(&mut self, latent: usize) {
        let sizes = [
            RESOLUTION_FEATURES,
            RESOLUTION_WIDTH,
            RESOLUTION_WIDTH,
            latent,
        ];
        self.dense_stack("resolution", sizes, 0.0);
    }

    /// The layer that gives actuations.
    fn head(&mut self, outputs: usize, width: usize) {
        let bound = SMALL * he_bound(width);
        self.affine("head", [outputs, width], bound, 0.0);
    }

    /// Initial ranges of Sitzmann et al. 2020. Their frequency multiplies the bias too, ours does not, so the bias's range is
    /// `omega / sqrt(n)`, cut at pi because a phase beyond that only wraps around.
    fn sine_layer(&mut self, layer: usize, inputs: usize, config: &NetworkConfig) {
        let name = format!("sine.{layer}");
        let weight_bound = if layer == 0 {
            1.0 / inputs as f32
        } else {
            he_bound(inputs) / config.omega
        };
        let bias_bound = (config.omega / (inputs as f32).sqrt()).min(std::f32::consts::PI);
        self.affine(
            &name,
            [config.width.size(), inputs],
            weight_bound,
            bias_bound,
        );
        self.affine(
            &format!("{name}.modulation"),
            [inputs, config.latent],
            SMALL * he_bound(config.latent),
            0.0,
        );
    }
}
