//! The fused field evaluation: points stream in chunks through the effective weights of one shape.
//!
//! The reverse pass recomputes the activations of a chunk instead of storing them, so memory does not grow with the number
//! of points beyond input and output. Chunks and groups of chunks depend on the number of points only, every group sums its
//! own gradient in order and groups are summed in order: the result is the same for any number of threads.

use dfdx::prelude::{Cpu, CpuError, Gradients};
use rayon::prelude::*;

use crate::ACTUATION_SIZE;
use crate::kernel::{
    Level, MatrixView, Update, first_layer, multiply, scale_and_sum_rows, sine_cosine_rows,
    sine_rows,
};
use crate::layout::SINE_LAYERS;
use crate::model::{Affine, Field};

/// Points per chunk. CPU time forward and reverse of 50,000 points at width 128 with AVX2 and 512 KiB of L2 per core: 64 points
/// 419 ms, 128: 389, 256: 371, 512: 375; width 64 likes 256 best too (96 ms against 112 with 512).
const CHUNK: usize = 256;
/// Upper limit of groups of chunks, hence of threads at work in the reverse pass.
const GROUPS: usize = 32;

/// Weight `[outputs, inputs]` row-major and bias of one layer; also their gradient.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Layer {
    pub weight: Vec<f32>,
    pub bias: Vec<f32>,
}

/// Effective weights of one shape's field; also their gradient.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FieldWeights {
    pub sine: [Layer; SINE_LAYERS],
    pub head: Layer,
}

impl Layer {
    fn new(affine: &Affine<f32>) -> Self {
        Self {
            weight: affine.weight.as_vec(),
            bias: affine.bias.as_vec(),
        }
    }

    fn zeros_like(other: &Self) -> Self {
        Self {
            weight: vec![0.0; other.weight.len()],
            bias: vec![0.0; other.bias.len()],
        }
    }

    fn add(&mut self, other: &Self) {
        add(&mut self.weight, &other.weight);
        add(&mut self.bias, &other.bias);
    }

    /// Adds this gradient to that of the tensors it belongs to.
    fn seed(
        &self,
        affine: &Affine<f32>,
        gradients: &mut Gradients<f32, Cpu>,
    ) -> Result<(), CpuError> {
        add(gradients.get_or_alloc_mut(&affine.weight)?, &self.weight);
        add(gradients.get_or_alloc_mut(&affine.bias)?, &self.bias);
        Ok(())
    }
}

impl FieldWeights {
    pub fn new(field: &Field<f32>) -> Self {
        Self {
            sine: std::array::from_fn(|l| Layer::new(&field.sine[l])),
            head: Layer::new(&field.head),
        }
    }

    fn zeros_like(other: &Self) -> Self {
        Self {
            sine: std::array::from_fn(|l| Layer::zeros_like(&other.sine[l])),
            head: Layer::zeros_like(&other.head),
        }
    }

    fn width(&self) -> usize {
        self.head.weight.len() / ACTUATION_SIZE
    }

    fn add(&mut self, other: &Self) {
        for (layer, other) in self.sine.iter_mut().zip(&other.sine) {
            layer.add(other);
        }
        self.head.add(&other.head);
    }

    /// Adds this gradient to that of the field's tensors, from where the tape carries it on to the parameters.
    pub fn seed(
        &self,
        field: &Field<f32>,
        gradients: &mut Gradients<f32, Cpu>,
    ) -> Result<(), CpuError> {
        for (layer, affine) in self.sine.iter().zip(&field.sine) {
            layer.seed(affine, gradients)?;
        }
        self.head.seed(&field.head, gradients)
    }

    /// The actuation `[n, 6]` at `points` `[n, 3]`.
    pub fn forward(&self, points: &[f32]) -> Vec<f32> {
        let evaluator = Evaluator::new(self);
        let mut actuation = vec![0.0; points.len() / 3 * ACTUATION_SIZE];
        points
            .par_chunks(3 * CHUNK)
            .zip(actuation.par_chunks_mut(ACTUATION_SIZE * CHUNK))
            .for_each_init(
                || [evaluator.activations(), evaluator.activations()],
                |scratch, (points, out)| evaluator.forward(points, out, scratch),
            );
        actuation
    }

    /// Vector-Jacobian product: the gradient of `sum(actuation_bar * actuation)` over all weights.
    pub fn vjp(&self, points: &[f32], actuation_bar: &[f32]) -> Self {
        let evaluator = Evaluator::new(self);
        let chunks = (points.len() / 3).div_ceil(CHUNK);
        let groups = chunks.min(GROUPS);
        let partial: Vec<Self> = (0..groups)
            .into_par_iter()
            .map_init(
                || ReverseScratch::new(&evaluator),
                |scratch, group| {
                    let mut gradient = Self::zeros_like(self);
                    for chunk in group * chunks / groups..(group + 1) * chunks / groups {
                        let points = chunk_of(points, chunk, 3);
                        let bar = chunk_of(actuation_bar, chunk, ACTUATION_SIZE);
                        evaluator.reverse(points, bar, scratch, &mut gradient);
                    }
                    gradient
                },
            )
            .collect();
        let mut partial = partial.into_iter();
        let mut total = partial.next().unwrap_or_else(|| Self::zeros_like(self));
        for gradient in partial {
            total.add(&gradient);
        }
        total
    }
}

/// The part of a flat `[n, columns]` array that belongs to a chunk.
fn chunk_of(data: &[f32], chunk: usize, columns: usize) -> &[f32] {
    let end = data.len().min((chunk + 1) * CHUNK * columns);
    &data[chunk * CHUNK * columns..end]
}

fn add(total: &mut [f32], part: &[f32]) {
    for (total, part) in total.iter_mut().zip(part) {
        *total += part;
    }
}

/// Buffers of one thread for the reverse pass, each `[CHUNK, width]`.
struct ReverseScratch {
    sine: [Vec<f32>; SINE_LAYERS],
    cosine: [Vec<f32>; SINE_LAYERS],
    bar: Vec<f32>,
    next_bar: Vec<f32>,
}

impl ReverseScratch {
    fn new(evaluator: &Evaluator) -> Self {
        let buffer = || evaluator.activations();
        Self {
            sine: std::array::from_fn(|_| buffer()),
            cosine: std::array::from_fn(|_| buffer()),
            bar: buffer(),
            next_bar: buffer(),
        }
    }
}

/// What all chunks share.
struct Evaluator<'a> {
    weights: &'a FieldWeights,
    width: usize,
    /// The first layer's weight by columns.
    first_columns: Vec<f32>,
    level: Level,
}

impl<'a> Evaluator<'a> {
    fn new(weights: &'a FieldWeights) -> Self {
        let first = &weights.sine[0].weight;
        Self {
            weights,
            width: weights.width(),
            first_columns: (0..3)
                .flat_map(|axis| first.iter().skip(axis).step_by(3).copied())
                .collect(),
            level: Level::best(),
        }
    }

    fn activations(&self) -> Vec<f32> {
        vec![0.0; CHUNK * self.width]
    }

    /// Pre-activation of layer `l` without its bias, from the points (layer 0) or from the previous layer's output `h`.
    fn linear(&self, l: usize, points: &[f32], h: &[f32], z: &mut [f32]) {
        if l == 0 {
            first_layer(self.level, points, &self.first_columns, z);
        } else {
            let weight = MatrixView::new(&self.weights.sine[l].weight, self.width);
            let h = MatrixView::new(h, self.width);
            multiply(z, Update::Overwrite, h, weight.transposed());
        }
    }

    fn forward(&self, points: &[f32], actuation: &mut [f32], scratch: &mut [Vec<f32>; 2]) {
        let length = points.len() / 3 * self.width;
        let [h, z] = scratch;
        let (mut h, mut z) = (&mut h[..length], &mut z[..length]);
        for l in 0..SINE_LAYERS {
            self.linear(l, points, h, z);
            sine_rows(self.level, z, &self.weights.sine[l].bias);
            std::mem::swap(&mut h, &mut z);
        }
        let head = &self.weights.head;
        for row in actuation.chunks_exact_mut(ACTUATION_SIZE) {
            row.copy_from_slice(&head.bias);
        }
        let weight = MatrixView::new(&head.weight, self.width).transposed();
        let h = MatrixView::new(h, self.width);
        multiply(actuation, Update::Add, h, weight);
    }

    /// Adds a chunk's share of the gradient.
    fn reverse(
        &self,
        points: &[f32],
        actuation_bar: &[f32],
        scratch: &mut ReverseScratch,
        gradient: &mut FieldWeights,
    ) {
        let length = points.len() / 3 * self.width;
        self.recompute(points, scratch);
        self.reverse_head(actuation_bar, scratch, &mut gradient.head);

        let ReverseScratch {
            sine,
            cosine,
            bar,
            next_bar,
        } = scratch;
        let (mut bar, mut next_bar) = (&mut bar[..length], &mut next_bar[..length]);
        for l in (0..SINE_LAYERS).rev() {
            let gradient = &mut gradient.sine[l];
            scale_and_sum_rows(self.level, bar, &cosine[l][..length], &mut gradient.bias);
            let input = match l {
                0 => MatrixView::new(points, 3),
                _ => MatrixView::new(&sine[l - 1][..length], self.width),
            };
            let bar_view = MatrixView::new(bar, self.width);
            multiply(
                &mut gradient.weight,
                Update::Add,
                bar_view.transposed(),
                input,
            );
            if l > 0 {
                let weight = MatrixView::new(&self.weights.sine[l].weight, self.width);
                multiply(next_bar, Update::Overwrite, bar_view, weight);
                std::mem::swap(&mut bar, &mut next_bar);
            }
        }
    }

    /// Sines and cosines of all layers of a chunk.
    fn recompute(&self, points: &[f32], scratch: &mut ReverseScratch) {
        let length = points.len() / 3 * self.width;
        for l in 0..SINE_LAYERS {
            let (before, after) = scratch.sine.split_at_mut(l);
            let h = before.last().map_or(&[][..], |h| &h[..length]);
            let z = &mut after[0][..length];
            self.linear(l, points, h, z);
            let cosine = &mut scratch.cosine[l][..length];
            sine_cosine_rows(self.level, z, cosine, &self.weights.sine[l].bias);
        }
    }

    /// The head's gradient, and the cotangent of the last sine layer into `scratch.bar`.
    fn reverse_head(&self, bar: &[f32], scratch: &mut ReverseScratch, gradient: &mut Layer) {
        let length = bar.len() / ACTUATION_SIZE * self.width;
        for row in bar.chunks_exact(ACTUATION_SIZE) {
            add(&mut gradient.bias, row);
        }
        let bar = MatrixView::new(bar, ACTUATION_SIZE);
        let h = MatrixView::new(&scratch.sine[SINE_LAYERS - 1][..length], self.width);
        multiply(&mut gradient.weight, Update::Add, bar.transposed(), h);
        let weight = MatrixView::new(&self.weights.head.weight, self.width);
        multiply(&mut scratch.bar[..length], Update::Overwrite, bar, weight);
    }
}
