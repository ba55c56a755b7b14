//! The innermost loops of elasticity: eight elements side by side in SIMD lanes, their samples one after another (maths.md
//! "Energy, gradient, Hessian").

use super::block::{Block, LANES, Lanes, parts};
use super::hourglass;
use super::inverted::InvertedLanes;
use super::quaternion::{quaternion_of, rotation_of};
use super::tensor::{Gradients, TensorRule};
use nalgebra::Vector3;
use polar_grad::lanes::{
    LaneMatrix, SymmetricLanes, polar_rotation_lanes, product, rotation_tangent_lanes,
    symmetric_adjugate, transposed_product,
};
use pulp::{Simd, WithSimd};

/// Samples of an element at most.
const MAX_SAMPLES: usize = 27;
/// Places of the six entries of a symmetric matrix in its nine, row by row.
const SYMMETRIC: [usize; 9] = [0, 1, 2, 1, 3, 4, 2, 4, 5];

/// The actuation of one sample of a block: six entries of A.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct Actuation([Lanes; 6]);

impl Actuation {
    /// A = I.
    pub(super) fn identity() -> Self {
        Self([1.0, 0.0, 0.0, 1.0, 0.0, 1.0].map(|x| Lanes([x; LANES])))
    }

    /// Sets A = I + sym(b) in one lane.
    pub(super) fn set(&mut self, lane: usize, b: &[f64; 6]) {
        const IDENTITY: [f64; 6] = [1.0, 0.0, 0.0, 1.0, 0.0, 1.0];
        for k in 0..6 {
            self.0[k].0[lane] = IDENTITY[k] + b[k];
        }
    }

    /// A in one lane.
    pub(super) fn get(&self, lane: usize) -> [f64; 6] {
        self.0.map(|entry| entry.0[lane])
    }

    /// Whether all entries are finite, in all lanes.
    pub(super) fn is_finite(&self) -> bool {
        let entries = self.0.iter().flat_map(|entry| &entry.0);
        entries.fold(true, |all, x| all & x.is_finite())
    }

    /// The mean over samples, lane by lane.
    pub(super) fn mean(samples: &[Self]) -> Self {
        let share = 1.0 / samples.len() as f64;
        let mut mean = [Lanes::ZERO; 6];
        for sample in samples {
            for (mean, entry) in mean.iter_mut().zip(&sample.0) {
                let lanes = mean.0.iter_mut().zip(&entry.0);
                lanes.for_each(|(mean, a)| *mean += share * a);
            }
        }
        Self(mean)
    }

    #[inline(always)]
    pub(super) fn matrix<S: Simd>(&self, part: usize) -> LaneMatrix<S> {
        let mut out = [self.0[0].part::<S>(part); 9];
        for (out, k) in out.iter_mut().zip(SYMMETRIC) {
            *out = self.0[k].part::<S>(part);
        }
        out
    }
}

/// What a Hessian product needs of one sample of a block: the rotation, and the six entries of B that make its tangents.
#[derive(Clone, Copy)]
pub(super) struct Linearisation {
    quaternion: [Lanes; 4],
    factor: [Lanes; 6],
}

impl Linearisation {
    /// What memory holds before the first linearisation.
    pub(super) fn unset() -> Self {
        Self {
            quaternion: [Lanes::ZERO; 4],
            factor: [Lanes::ZERO; 6],
        }
    }

    /// Takes the rotations and factors of one register.
    #[inline(always)]
    pub(super) fn set<S: Simd>(
        &mut self,
        simd: S,
        part: usize,
        rotation: &LaneMatrix<S>,
        factor: &SymmetricLanes<S>,
    ) {
        let quaternion = quaternion_of(simd, rotation);
        for (out, x) in self.quaternion.iter_mut().zip(quaternion) {
            *out.part_mut::<S>(part) = x;
        }
        for (out, x) in self.factor.iter_mut().zip(factor) {
            *out.part_mut::<S>(part) = *x;
        }
    }

    /// `dR = R [B axial(R^T dM)]_x`, and R.
    #[inline(always)]
    fn tangent<S: Simd>(
        &self,
        simd: S,
        part: usize,
        d_m: &LaneMatrix<S>,
    ) -> (LaneMatrix<S>, LaneMatrix<S>) {
        let mut quaternion = [simd.splat_f64s(0.0); 4];
        for (out, lanes) in quaternion.iter_mut().zip(&self.quaternion) {
            *out = lanes.part::<S>(part);
        }
        let rotation = rotation_of(simd, &quaternion);
        let mut factor = [simd.splat_f64s(0.0); 6];
        for (out, lanes) in factor.iter_mut().zip(&self.factor) {
            *out = lanes.part::<S>(part);
        }
        let d_r = rotation_tangent_lanes(simd, &rotation, &factor, d_m);
        (d_r, rotation)
    }
}

/// What stress a sample answers with.
pub(super) trait SampleLaw {
    /// Whether elements of one sample answer with the stiffness of their hourglass modes as well.
    const HOURGLASS: bool = true;
    /// Whether samples that are inside out are counted.
    const COUNTS: bool = false;

    /// The stress at a sample of a block, by its number in the body, and twice the energy density (zero where there is none).
    fn stress<S: Simd>(
        &mut self,
        simd: S,
        sample: usize,
        part: usize,
        f: &LaneMatrix<S>,
    ) -> (LaneMatrix<S>, S::f64s);
}

/// Energy `1/2 |F - R A|^2` with R the polar rotation of F A, and its gradient `F - R A`.
#[derive(Clone, Copy)]
pub(super) struct EnergyGradient<'a> {
    pub(super) actuation: &'a [Actuation],
}

impl SampleLaw for EnergyGradient<'_> {
    const COUNTS: bool = true;

    #[inline(always)]
    fn stress<S: Simd>(
        &mut self,
        simd: S,
        sample: usize,
        part: usize,
        f: &LaneMatrix<S>,
    ) -> (LaneMatrix<S>, S::f64s) {
        let a = self.actuation[sample].matrix::<S>(part);
        misfit(simd, f, &rotated(simd, f, &a))
    }
}

/// `R A` with R the polar rotation of F A.
#[inline(always)]
pub(super) fn rotated<S: Simd>(simd: S, f: &LaneMatrix<S>, a: &LaneMatrix<S>) -> LaneMatrix<S> {
    let rotation = polar_rotation_lanes(simd, &product(simd, f, a));
    product(simd, &rotation, a)
}

/// How far from the identity a deformation gradient may be, squared, to count as that of rest.
const REST2: f64 = 1e-20;

/// The same where most samples are at rest and A is positive definite: the rotation is the identity there.
#[derive(Clone, Copy)]
pub(super) struct AtRest<'a>(pub(super) EnergyGradient<'a>);

impl SampleLaw for AtRest<'_> {
    #[inline(always)]
    fn stress<S: Simd>(
        &mut self,
        simd: S,
        sample: usize,
        part: usize,
        f: &LaneMatrix<S>,
    ) -> (LaneMatrix<S>, S::f64s) {
        let actuation = &self.0.actuation[sample];
        let (zero, one) = (simd.splat_f64s(0.0), simd.splat_f64s(1.0));
        let mut away = zero;
        for (i, f) in f.iter().enumerate() {
            let d = simd.sub_f64s(*f, if i % 4 == 0 { one } else { zero });
            away = simd.mul_add_e_f64s(d, d, away);
        }
        let mut entries = [zero; 6];
        for (entry, lanes) in entries.iter_mut().zip(&actuation.0) {
            *entry = lanes.part::<S>(part);
        }
        let (adjugate, determinant) = symmetric_adjugate(simd, &entries);
        let mut there = simd.less_than_f64s(away, simd.splat_f64s(REST2));
        // Of what overflowed signs tell nothing.
        let finite = simd.less_than_f64s(determinant, simd.splat_f64s(f64::MAX));
        there = simd.and_m64s(there, finite);
        for minor in [entries[0], adjugate[5], determinant] {
            there = simd.and_m64s(there, simd.less_than_f64s(zero, minor));
        }
        if simd.first_true_m64s(simd.not_m64s(there)) == S::F64_LANES {
            let stress = difference(simd, f, &actuation.matrix::<S>(part));
            return (stress, square(simd, &stress));
        }
        self.0.stress(simd, sample, part, f)
    }
}

#[inline(always)]
fn square<S: Simd>(simd: S, x: &LaneMatrix<S>) -> S::f64s {
    let mut square = simd.splat_f64s(0.0);
    for x in x {
        square = simd.mul_add_e_f64s(*x, *x, square);
    }
    square
}

/// `F - R A`, and its square.
#[inline(always)]
pub(super) fn misfit<S: Simd>(
    simd: S,
    f: &LaneMatrix<S>,
    rotated: &LaneMatrix<S>,
) -> (LaneMatrix<S>, S::f64s) {
    let stress = difference(simd, f, rotated);
    (stress, square(simd, &stress))
}

/// The product of the Hessian with a direction: `dF - dR A`.
#[derive(Clone, Copy)]
pub(super) struct HessianProduct<'a> {
    pub(super) actuation: &'a [Actuation],
    pub(super) linearisation: &'a [Linearisation],
}

impl SampleLaw for HessianProduct<'_> {
    #[inline(always)]
    fn stress<S: Simd>(
        &mut self,
        simd: S,
        sample: usize,
        part: usize,
        d_f: &LaneMatrix<S>,
    ) -> (LaneMatrix<S>, S::f64s) {
        let a = self.actuation[sample].matrix::<S>(part);
        let d_m = product(simd, d_f, &a);
        let (d_r, _) = self.linearisation[sample].tangent(simd, part, &d_m);
        let stress = difference(simd, d_f, &product(simd, &d_r, &a));
        (stress, simd.splat_f64s(0.0))
    }
}

#[inline(always)]
pub(super) fn difference<S: Simd>(simd: S, a: &LaneMatrix<S>, b: &LaneMatrix<S>) -> LaneMatrix<S> {
    let mut out = *a;
    for (out, b) in out.iter_mut().zip(b) {
        *out = simd.sub_f64s(*out, *b);
    }
    out
}

/// What all samples of some blocks have together.
pub(super) struct Total {
    pub(super) energy: f64,
    /// Samples with det F < 0, if the law has them counted.
    pub(super) inverted: usize,
}

impl Total {
    pub(super) const ZERO: Self = Self {
        energy: 0.0,
        inverted: 0,
    };

    pub(super) fn plus(self, other: Self) -> Self {
        Self {
            energy: self.energy + other.energy,
            inverted: self.inverted + other.inverted,
        }
    }
}

/// Adds the forces of consecutive blocks to their nodes; gives what they have together, and the law back.
pub(super) struct AddForces<'a, const N: usize, L> {
    pub(super) rule: &'a TensorRule<N>,
    pub(super) law: L,
    pub(super) blocks: &'a [Block],
    /// Number of the first block in the body.
    pub(super) first_block: usize,
    /// A vector per node of the body.
    pub(super) x: &'a [Vector3<f64>],
    /// The nodes from number `first_node` on.
    pub(super) out: &'a mut [Vector3<f64>],
    pub(super) first_node: usize,
}

impl<const N: usize, L: SampleLaw> WithSimd for AddForces<'_, N, L> {
    type Output = (Total, L);

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) -> (Total, L) {
        let samples = TensorRule::<N>::SAMPLES;
        let mut energy = 0.0;
        let mut inverted = InvertedLanes::new(simd);
        for (i, block) in self.blocks.iter().enumerate() {
            let first_sample = (self.first_block + i) * samples;
            let x = block.gather(self.x);
            let mut force = [[Lanes::ZERO; 8]; 3];
            for part in 0..parts::<S>() {
                let f = self.rule.gradients(simd, &x, &block.inverse_size, part);
                let mut stresses = Gradients::zero(simd);
                let mut square = simd.splat_f64s(0.0);
                let weight = block.weight.part::<S>(part);
                for number in 0..samples {
                    let sample = TensorRule::<N>::sample(number);
                    let f = f.at(sample);
                    if L::COUNTS {
                        inverted.see(simd, &f, weight);
                    }
                    let (stress, s) = (self.law).stress(simd, first_sample + number, part, &f);
                    let weight = self.rule.weight(sample);
                    square = simd.mul_add_e_f64s(simd.splat_f64s(weight), s, square);
                    stresses.add(simd, sample, weight, &stress);
                }
                self.rule.add_forces(
                    simd,
                    &stresses,
                    &block.inverse_size,
                    weight,
                    part,
                    &mut force,
                );
                let of_samples = simd.mul_f64s(square, weight);
                energy += 0.5 * simd.reduce_sum_f64s(of_samples);
                if N == 1 && L::HOURGLASS {
                    energy += hourglass::add_forces(simd, block, &x, part, &mut force);
                }
            }
            block.scatter(&force, self.first_node, self.out);
        }
        let inverted = inverted.count(simd);
        (Total { energy, inverted }, self.law)
    }
}

/// Writes `w D^T (Rhat^T + Fhat^T H_R Ahat) y` of all samples of consecutive blocks (maths.md "Implicit adjoint").
pub(super) struct ActuationVjp<'a, const N: usize> {
    pub(super) rule: &'a TensorRule<N>,
    pub(super) blocks: &'a [Block],
    /// Of the samples of these blocks.
    pub(super) actuation: &'a [Actuation],
    pub(super) linearisation: &'a [Linearisation],
    /// Positions of the nodes of the body, which the linearisation was made at.
    pub(super) u: &'a [Vector3<f64>],
    pub(super) z: &'a [Vector3<f64>],
    /// Of the samples of these elements, element by element.
    pub(super) out: &'a mut [[f64; 6]],
}

impl<const N: usize> WithSimd for ActuationVjp<'_, N> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let samples = TensorRule::<N>::SAMPLES;
        let outs = self.out.chunks_mut(LANES * samples);
        // Of a whole block, so that what is written lies together.
        let mut of_block = [[Lanes::ZERO; 6]; MAX_SAMPLES];
        for (i, (block, out)) in self.blocks.iter().zip(outs).enumerate() {
            let (u, z) = (block.gather(self.u), block.gather(self.z));
            for part in 0..parts::<S>() {
                let f = self.rule.gradients(simd, &u, &block.inverse_size, part);
                let y = self.rule.gradients(simd, &z, &block.inverse_size, part);
                for (number, of_block) in of_block[..samples].iter_mut().enumerate() {
                    let sample = TensorRule::<N>::sample(number);
                    let weight = simd.splat_f64s(self.rule.weight(sample));
                    let weight = simd.mul_f64s(weight, block.weight.part::<S>(part));
                    let (f, y) = (f.at(sample), y.at(sample));
                    let at = i * samples + number;
                    let a = self.actuation[at].matrix::<S>(part);
                    let b_bar = actuation_vjp(simd, &f, &y, &a, &self.linearisation[at], part);
                    for (lanes, b_bar) in of_block.iter_mut().zip(b_bar) {
                        *lanes.part_mut::<S>(part) = simd.mul_f64s(weight, b_bar);
                    }
                }
            }
            for (lane, out) in out.chunks_exact_mut(samples).enumerate() {
                for (out, lanes) in out.iter_mut().zip(&of_block) {
                    for (out, lanes) in out.iter_mut().zip(lanes) {
                        *out = lanes.0[lane];
                    }
                }
            }
        }
    }
}

/// `D^T vec(R^T y + F^T dR)` with dR the tangent of the rotation for `dM = y A`: [`polar_grad::actuation_vjp`], many at once.
#[inline(always)]
fn actuation_vjp<S: Simd>(
    simd: S,
    f: &LaneMatrix<S>,
    y: &LaneMatrix<S>,
    a: &LaneMatrix<S>,
    at: &Linearisation,
    part: usize,
) -> [S::f64s; 6] {
    let (d_r, rotation) = at.tangent(simd, part, &product(simd, y, a));
    let mut x = transposed_product(simd, &rotation, y);
    for (x, more) in x.iter_mut().zip(transposed_product(simd, f, &d_r)) {
        *x = simd.add_f64s(*x, more);
    }
    [
        x[0],
        simd.add_f64s(x[1], x[3]),
        simd.add_f64s(x[2], x[6]),
        x[4],
        simd.add_f64s(x[5], x[7]),
        x[8],
    ]
}
