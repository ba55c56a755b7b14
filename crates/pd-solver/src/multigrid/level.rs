//! One level of the hierarchy: its operator, its smoother, and its vectors.

use super::fine::FineOperator;
use super::layout::{Layout, for_parts, load};
use super::stencil::Stencil;
use super::touch::Bridge;
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// A Chebyshev polynomial.
#[derive(Clone, Copy)]
pub(super) struct Smoother {
    /// Its degree on either side of the coarse correction.
    degree: usize,
    /// Lower end of the smoothed part of the spectrum, as share of the upper end.
    smoothed: f32,
}

impl Smoother {
    pub(super) const PLAIN: Self = Self {
        degree: 2,
        smoothed: 0.2,
    };
    /// Where flesh keeps its volume, the upper end is far above all else. On a box with ten times the stiffness of elasticity conjugate gradients
    /// take 10 iterations with this one and 15 with the plain one.
    pub(super) const OF_KEPT_VOLUME: Self = Self {
        degree: 3,
        smoothed: 0.08,
    };
    /// On top of the plain one at the nodes of flaps, where no coarse correction does the rest.
    pub(super) const OF_FLAPS: Self = Self {
        degree: 6,
        smoothed: 0.03,
    };
}

/// Power steps of the estimate of the largest eigenvalue.
const POWER_STEPS: usize = 6;
/// Numbers per task where nothing depends on planes.
const PART: usize = 8192;
/// What the estimate may be too small by.
const MARGIN: f32 = 1.2;

pub(super) enum Operator {
    Fine(FineOperator),
    Stencil(Stencil),
}

impl Operator {
    fn apply(&self, x: &[f32], y: &mut [f32]) {
        match self {
            Self::Fine(operator) => operator.apply(x, y),
            Self::Stencil(operator) => operator.apply(x, y),
        }
    }
}

/// `y = A x` with what touches.
fn product(operator: &Operator, bridges: &[Bridge], x: &[f32], y: &mut [f32]) {
    operator.apply(x, y);
    bridges.iter().for_each(|bridge| bridge.apply(x, y));
}

pub(super) struct Level {
    pub(super) layout: Layout,
    smoother: Smoother,
    pub(super) operator: Operator,
    /// What touches and is not in the operator.
    pub(super) bridges: Vec<Bridge>,
    /// Nodes whose values stay zero.
    pub(super) held: Vec<bool>,
    /// Inverse diagonal blocks, six components laid out like a vector; zero at held nodes and padding.
    inverse: Vec<f32>,
    /// Largest eigenvalue of the inverse diagonal times the operator.
    largest: f32,
    /// What the estimate of that eigenvalue starts from; the same every time, so that it does not depend on what was before.
    start: Vec<f32>,
    pub(super) x: Vec<f32>,
    pub(super) b: Vec<f32>,
    pub(super) y: Vec<f32>,
    d: Vec<f32>,
}

impl Level {
    pub(super) fn new(
        layout: Layout,
        operator: Operator,
        held: Vec<bool>,
        smoother: Smoother,
    ) -> Self {
        Self {
            smoother,
            inverse: vec![0.0; 2 * layout.len()],
            largest: 0.0,
            start: Vec::new(),
            x: layout.zeros(),
            b: layout.zeros(),
            y: layout.zeros(),
            d: layout.zeros(),
            layout,
            operator,
            bridges: Vec::new(),
            held,
        }
    }

    /// Takes over the operator's new entries: inverts its diagonal and bounds its spectrum.
    pub(super) fn refresh(&mut self) {
        self.refresh_diagonal();
        self.estimate_largest();
    }

    /// Inverts the operator's diagonal where its spectrum is bounded as before.
    pub(super) fn refresh_diagonal(&mut self) {
        let mut inverse = std::mem::take(&mut self.inverse);
        inverse.fill(0.0);
        match &self.operator {
            Operator::Fine(operator) => operator.add_diagonal(&mut inverse),
            Operator::Stencil(operator) => {
                for node in 0..self.held.len() {
                    self.layout
                        .add_block(node, operator.diagonal(node), &mut inverse);
                }
            }
        }
        for bridge in &self.bridges {
            let layout = &self.layout;
            bridge.for_each_block(|node, d| layout.add_block(node as usize, d, &mut inverse));
        }
        self.invert_diagonal(&mut inverse);
        self.inverse = inverse;
    }

    fn invert_diagonal(&self, blocks: &mut [f32]) {
        let layout = &self.layout;
        for_parts(
            blocks,
            &layout.doubled,
            layout.parallel(),
            &|plane, part: &mut [f32]| {
                let start = layout.starts[plane];
                let nodes = layout.nodes(plane).iter().map(|&n| n as usize);
                let step = part.len() / 6;
                for node in nodes {
                    let at = layout.slots[node] as usize - start;
                    let d: [f32; 6] = std::array::from_fn(|c| part[c * step + at]);
                    let inverse = if self.held[node] {
                        [0.0; 6]
                    } else {
                        inverse(&d)
                    };
                    for (c, value) in inverse.into_iter().enumerate() {
                        part[c * step + at] = value;
                    }
                }
            },
        );
    }

    /// Power iteration on the inverse diagonal times the operator.
    fn estimate_largest(&mut self) {
        if self.start.is_empty() {
            self.start = self.random_vector();
        }
        self.x.copy_from_slice(&self.start);
        let mut length = self.norm(&self.x);
        for _ in 0..POWER_STEPS {
            if length == 0.0 {
                break;
            }
            product(&self.operator, &self.bridges, &self.x, &mut self.y);
            let vectors = Vectors {
                b: None,
                y: Some(&self.y),
                inverse: &self.inverse,
            };
            // d = D^-1 A x / |x|
            vectors.update(&self.layout, 0.0, -1.0 / length, &mut self.d, None);
            length = self.norm(&self.d);
            self.largest = length * MARGIN;
            std::mem::swap(&mut self.d, &mut self.x);
        }
    }

    fn norm(&self, x: &[f32]) -> f32 {
        let sum: f64 = if self.layout.parallel() {
            let partial: Vec<f64> = x.par_chunks(PART).map(sum_of_squares).collect();
            partial.iter().sum()
        } else {
            x.chunks(PART).map(sum_of_squares).sum()
        };
        sum.sqrt() as f32
    }

    /// Takes the largest eigenvalue for larger than it was estimated.
    pub(super) fn strengthen(&mut self, factor: f32) {
        self.largest *= factor;
    }

    /// A vector with a bit of everything, the same in every run.
    fn random_vector(&self) -> Vec<f32> {
        let mut state = 1u64;
        let mut out = self.layout.zeros();
        for node in 0..self.held.len() {
            for at in self.layout.components(node) {
                state = state
                    .wrapping_mul(6364136223846793005)
                    .wrapping_add(1442695040888963407);
                out[at] = (state >> 40) as f32 / (1u64 << 24) as f32 - 0.5;
            }
        }
        out
    }

    /// Smooths `A x = b`; `zero` says that x is to be taken as zero.
    pub(super) fn smooth(&mut self, zero: bool) {
        let high = self.largest;
        let low = high * self.smoother.smoothed;
        let (middle, half) = ((high + low) / 2.0, (high - low) / 2.0);
        let sigma = middle / half;
        let mut rho = 1.0 / sigma;
        for step in 0..self.smoother.degree {
            let (keep, add) = if step == 0 {
                (0.0, 1.0 / middle)
            } else {
                let next = 1.0 / (2.0 * sigma - rho);
                let factors = (next * rho, 2.0 * next / half);
                rho = next;
                factors
            };
            let start = zero && step == 0;
            if start {
                self.x.fill(0.0);
            } else {
                product(&self.operator, &self.bridges, &self.x, &mut self.y);
            }
            let vectors = Vectors {
                b: Some(&self.b),
                y: (!start).then_some(&self.y),
                inverse: &self.inverse,
            };
            vectors.update(&self.layout, keep, add, &mut self.d, Some(&mut self.x));
        }
    }

    /// `y = b - A x`.
    pub(super) fn residual(&mut self) {
        product(&self.operator, &self.bridges, &self.x, &mut self.y);
        let one = |(y, b): (&mut [f32], &[f32])| y.iter_mut().zip(b).for_each(|(y, b)| *y = b - *y);
        if self.layout.parallel() {
            self.y
                .par_chunks_mut(PART)
                .zip(self.b.par_chunks(PART))
                .for_each(one);
        } else {
            one((&mut self.y, &self.b));
        }
    }
}

/// What an update of the search direction reads; what is absent counts as zero.
struct Vectors<'a> {
    b: Option<&'a [f32]>,
    y: Option<&'a [f32]>,
    inverse: &'a [f32],
}

impl Vectors<'_> {
    /// `d = keep d + add D^-1 (b - y)`, then `x += d`.
    fn update(&self, layout: &Layout, keep: f32, add: f32, d: &mut [f32], x: Option<&mut [f32]>) {
        let starts = &layout.starts;
        let arch = Arch::new();
        let one = |plane: usize, (d, x): (&mut [f32], Option<&mut [f32]>)| {
            let range = starts[plane]..starts[plane + 1];
            arch.dispatch(UpdatePlane {
                keep,
                add,
                inverse: &self.inverse[2 * range.start..2 * range.end],
                b: self.b.map(|b| &b[range.clone()]),
                y: self.y.map(|y| &y[range]),
                d,
                x,
            });
        };
        for_parts((d, x), starts, layout.parallel(), &one);
    }
}

/// The update in one plane.
struct UpdatePlane<'a> {
    keep: f32,
    add: f32,
    b: Option<&'a [f32]>,
    y: Option<&'a [f32]>,
    inverse: &'a [f32],
    d: &'a mut [f32],
    x: Option<&'a mut [f32]>,
}

impl WithSimd for UpdatePlane<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let step = self.d.len() / 3;
        let zero = simd.splat_f32s(0.0);
        let (keep, add) = (simd.splat_f32s(self.keep), simd.splat_f32s(self.add));
        for at in (0..step).step_by(S::F32_LANES) {
            let mut r = [zero; 3];
            for (c, r) in r.iter_mut().enumerate() {
                if let Some(b) = self.b {
                    *r = load::<S>(b, c * step + at);
                }
                if let Some(y) = self.y {
                    *r = simd.sub_f32s(*r, load::<S>(y, c * step + at));
                }
                *r = simd.mul_f32s(*r, add);
            }
            for (c, row) in [[0, 1, 2], [1, 3, 4], [2, 4, 5]].into_iter().enumerate() {
                let mut sum = zero;
                for (r, entry) in r.iter().zip(row) {
                    sum = simd.mul_add_e_f32s(load::<S>(self.inverse, entry * step + at), *r, sum);
                }
                let range = c * step + at..c * step + at + S::F32_LANES;
                let d = &mut S::as_mut_simd_f32s(&mut self.d[range.clone()]).0[0];
                if self.keep != 0.0 {
                    sum = simd.mul_add_e_f32s(keep, *d, sum);
                }
                *d = sum;
                if let Some(x) = &mut self.x {
                    let x = &mut S::as_mut_simd_f32s(&mut x[range]).0[0];
                    *x = simd.add_f32s(*x, sum);
                }
            }
        }
    }
}

/// Inverse of a symmetric positive definite matrix by its six entries; of a multiple of the identity that is at least as large where
/// it is not positive definite; zero where it has no positive entry on its diagonal, or is not finite.
fn inverse(d: &[f32; 6]) -> [f32; 6] {
    let [a, b, c, e, f, g] = d.map(f64::from);
    let cofactors = [
        e * g - f * f,
        c * f - b * g,
        b * f - c * e,
        a * g - c * c,
        b * c - a * f,
        a * e - b * b,
    ];
    let determinant = a * cofactors[0] + b * cofactors[1] + c * cofactors[2];
    let definite = a > 0.0 && cofactors[5] > 0.0 && determinant > 0.0;
    if definite && determinant.is_finite() {
        return cofactors.map(|x| (x / determinant) as f32);
    }
    let largest = a.max(e).max(g) + b.abs() + c.abs() + f.abs();
    if largest > 0.0 && largest.is_finite() {
        let small = (1.0 / largest) as f32;
        return [small, 0.0, 0.0, small, 0.0, small];
    }
    [0.0; 6]
}

/// In several sums side by side, which do not wait for one another.
fn sum_of_squares(x: &[f32]) -> f64 {
    let (groups, rest) = x.as_chunks::<8>();
    let mut sums = [0.0; 8];
    for group in groups {
        for (sum, &x) in sums.iter_mut().zip(group) {
            *sum += f64::from(x) * f64::from(x);
        }
    }
    let rest = rest.iter().map(|&x| f64::from(x) * f64::from(x));
    sums.into_iter().chain(rest).sum()
}
