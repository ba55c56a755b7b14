//! Slices of matrices, by the widest instruction set of the machine: no SIMD type in any signature.
//!
//! A symmetric matrix is given by the six entries 00, 01, 02, 11, 12, 22. Matrices may start anywhere and be any number; an
//! answer does not depend on its neighbours. One thread; split the slices for more.

use super::{
    polar_rotation_lanes, projected_factor_lanes, rotation_factor_lanes, rotation_tangent_lanes,
};
use nalgebra::Matrix3;
use pulp::{Arch, Simd, WithSimd};

/// Matrices that are brought into lanes together: enough for the stores to be done before the wide loads, few enough for the
/// first-level cache.
const BLOCK: usize = 64;

/// The polar rotation of every matrix, as [`crate::polar_rotation`] and to its accuracy.
///
/// # Panics
/// When the slices differ in length.
pub fn polar_rotations(matrices: &[Matrix3<f64>], rotations: &mut [Matrix3<f64>]) {
    same_lengths(&[matrices.len(), rotations.len()]);
    Arch::new().dispatch(PolarRotations {
        matrices,
        rotations,
    });
}

/// What the derivative of the polar rotation of every matrix needs: its rotation, `T = tr(S) I - S` and `B = T^-1`, as
/// [`crate::RotationGradient::at`] and with its floors.
///
/// # Panics
/// When the slices differ in length.
pub fn factors(
    matrices: &[Matrix3<f64>],
    rotations: &mut [Matrix3<f64>],
    pair_sums: &mut [[f64; 6]],
    factors: &mut [[f64; 6]],
) {
    same_lengths(&[
        matrices.len(),
        rotations.len(),
        pair_sums.len(),
        factors.len(),
    ]);
    Arch::new().dispatch(Factors {
        matrices,
        rotations,
        pair_sums,
        factors,
    });
}

/// The factors `B'` of the exact positive semi-definite projections of the Hessian cores with `pair_sums` T and `actuations` A:
/// see [`projected_factor_lanes`].
///
/// # Panics
/// When the slices differ in length.
pub fn projected_factors(
    pair_sums: &[[f64; 6]],
    actuations: &[[f64; 6]],
    projected: &mut [[f64; 6]],
) {
    same_lengths(&[pair_sums.len(), actuations.len(), projected.len()]);
    Arch::new().dispatch(ProjectedFactors {
        pair_sums,
        actuations,
        projected,
    });
}

/// The products `H_R vec(dM)`, that is `dR = R [B axial(R^T dM)]_x`, as [`crate::RotationGradient::apply`]. `factors` holds B, or
/// the B' of a projected core.
///
/// # Panics
/// When the slices differ in length.
pub fn hessian_products(
    rotations: &[Matrix3<f64>],
    factors: &[[f64; 6]],
    tangents: &[Matrix3<f64>],
    products: &mut [Matrix3<f64>],
) {
    same_lengths(&[
        rotations.len(),
        factors.len(),
        tangents.len(),
        products.len(),
    ]);
    Arch::new().dispatch(HessianProducts {
        rotations,
        factors,
        tangents,
        products,
    });
}

fn same_lengths(lengths: &[usize]) {
    assert!(
        lengths.iter().all(|length| *length == lengths[0]),
        "slices of different lengths: {lengths:?}"
    );
}

struct PolarRotations<'a> {
    matrices: &'a [Matrix3<f64>],
    rotations: &'a mut [Matrix3<f64>],
}

impl WithSimd for PolarRotations<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let mut block = Block::<9>::unset();
        for (m, out) in self
            .matrices
            .chunks(BLOCK)
            .zip(self.rotations.chunks_mut(BLOCK))
        {
            block.gather_matrices(m);
            for part in 0..parts::<S>(m.len()) {
                let rotation = polar_rotation_lanes(simd, &block.load::<S>(part));
                block.store::<S>(part, &rotation);
            }
            block.scatter_matrices(out);
        }
    }
}

struct Factors<'a> {
    matrices: &'a [Matrix3<f64>],
    rotations: &'a mut [Matrix3<f64>],
    pair_sums: &'a mut [[f64; 6]],
    factors: &'a mut [[f64; 6]],
}

impl WithSimd for Factors<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let mut matrices = Block::<9>::unset();
        let (mut pair_sums, mut factors) = (Block::<6>::unset(), Block::<6>::unset());
        let outputs = self
            .rotations
            .chunks_mut(BLOCK)
            .zip(self.pair_sums.chunks_mut(BLOCK))
            .zip(self.factors.chunks_mut(BLOCK));
        for (m, ((rotations, sums), inverses)) in self.matrices.chunks(BLOCK).zip(outputs) {
            matrices.gather_matrices(m);
            for part in 0..parts::<S>(m.len()) {
                let m = matrices.load::<S>(part);
                let rotation = polar_rotation_lanes(simd, &m);
                let derivative = rotation_factor_lanes(simd, &rotation, &m);
                matrices.store::<S>(part, &rotation);
                pair_sums.store::<S>(part, &derivative.pair_sums);
                factors.store::<S>(part, &derivative.factor);
            }
            matrices.scatter_matrices(rotations);
            pair_sums.scatter_entries(sums);
            factors.scatter_entries(inverses);
        }
    }
}

struct ProjectedFactors<'a> {
    pair_sums: &'a [[f64; 6]],
    actuations: &'a [[f64; 6]],
    projected: &'a mut [[f64; 6]],
}

impl WithSimd for ProjectedFactors<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (mut pair_sums, mut actuations) = (Block::<6>::unset(), Block::<6>::unset());
        let inputs = self
            .pair_sums
            .chunks(BLOCK)
            .zip(self.actuations.chunks(BLOCK));
        for ((t, a), out) in inputs.zip(self.projected.chunks_mut(BLOCK)) {
            pair_sums.gather_entries(t);
            actuations.gather_entries(a);
            for part in 0..parts::<S>(t.len()) {
                let (t, a) = (pair_sums.load::<S>(part), actuations.load::<S>(part));
                pair_sums.store::<S>(part, &projected_factor_lanes(simd, &t, &a));
            }
            pair_sums.scatter_entries(out);
        }
    }
}

struct HessianProducts<'a> {
    rotations: &'a [Matrix3<f64>],
    factors: &'a [[f64; 6]],
    tangents: &'a [Matrix3<f64>],
    products: &'a mut [Matrix3<f64>],
}

impl WithSimd for HessianProducts<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (mut rotations, mut tangents) = (Block::<9>::unset(), Block::<9>::unset());
        let mut factors = Block::<6>::unset();
        let inputs = self
            .rotations
            .chunks(BLOCK)
            .zip(self.factors.chunks(BLOCK))
            .zip(self.tangents.chunks(BLOCK));
        for (((r, b), x), out) in inputs.zip(self.products.chunks_mut(BLOCK)) {
            rotations.gather_matrices(r);
            factors.gather_entries(b);
            tangents.gather_matrices(x);
            for part in 0..parts::<S>(r.len()) {
                let (r, b) = (rotations.load::<S>(part), factors.load::<S>(part));
                let product = rotation_tangent_lanes(simd, &r, &b, &tangents.load::<S>(part));
                tangents.store::<S>(part, &product);
            }
            tangents.scatter_matrices(out);
        }
    }
}

/// Registers that hold `count` matrices.
#[inline(always)]
fn parts<S: Simd>(count: usize) -> usize {
    count.div_ceil(S::F64_LANES)
}

/// `N` numbers of each of up to [`BLOCK`] matrices, the same number of all matrices side by side.
struct Block<const N: usize>([[f64; BLOCK]; N]);

impl<const N: usize> Block<N> {
    fn unset() -> Self {
        Self([[0.0; BLOCK]; N])
    }

    #[inline(always)]
    fn load<S: Simd>(&self, part: usize) -> [S::f64s; N] {
        let mut out = [S::as_simd_f64s(&self.0[0]).0[part]; N];
        for (value, row) in out.iter_mut().zip(&self.0) {
            *value = S::as_simd_f64s(row).0[part];
        }
        out
    }

    #[inline(always)]
    fn store<S: Simd>(&mut self, part: usize, values: &[S::f64s; N]) {
        for (row, value) in self.0.iter_mut().zip(values) {
            S::as_mut_simd_f64s(row).0[part] = *value;
        }
    }

    /// Repeats the last matrix up to a multiple of the widest register, so that every lane holds numbers of the caller's.
    #[inline(always)]
    fn pad(&mut self, count: usize) {
        for row in &mut self.0 {
            let last = row[count - 1];
            row[count..count.next_multiple_of(WIDEST)].fill(last);
        }
    }
}

/// Lanes of the widest register known.
const WIDEST: usize = 8;

impl Block<9> {
    #[inline(always)]
    fn gather_matrices(&mut self, matrices: &[Matrix3<f64>]) {
        for (i, m) in matrices.iter().enumerate() {
            for k in 0..9 {
                self.0[k][i] = m[(k / 3, k % 3)];
            }
        }
        self.pad(matrices.len());
    }

    #[inline(always)]
    fn scatter_matrices(&self, matrices: &mut [Matrix3<f64>]) {
        for (i, m) in matrices.iter_mut().enumerate() {
            for k in 0..9 {
                m[(k / 3, k % 3)] = self.0[k][i];
            }
        }
    }
}

impl Block<6> {
    #[inline(always)]
    fn gather_entries(&mut self, entries: &[[f64; 6]]) {
        for (i, entries) in entries.iter().enumerate() {
            for (row, x) in self.0.iter_mut().zip(entries) {
                row[i] = *x;
            }
        }
        self.pad(entries.len());
    }

    #[inline(always)]
    fn scatter_entries(&self, entries: &mut [[f64; 6]]) {
        for (i, entries) in entries.iter_mut().enumerate() {
            for (row, x) in self.0.iter().zip(entries) {
                *x = row[i];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{HARD_CLASSES, Random, planted};
    use crate::{Filter, HessianCore, RotationGradient, actuation_from_b, polar_rotation};

    /// Ordinary matrices and hard ones, in turn.
    fn matrices(count: usize) -> Vec<Matrix3<f64>> {
        let mut random = Random::new(12);
        (0..count)
            .map(|k| match k % 3 {
                0 => planted(HARD_CLASSES[k / 3 % HARD_CLASSES.len()].1, k as u64).matrix,
                _ => random.rotation() * (Matrix3::identity() + random.matrix() * 0.4),
            })
            .collect()
    }

    fn entries(m: &Matrix3<f64>) -> [f64; 6] {
        super::super::PLACES.map(|place| m[place])
    }

    fn from_entries(s: &[f64; 6]) -> Matrix3<f64> {
        Matrix3::new(s[0], s[1], s[2], s[1], s[3], s[4], s[2], s[4], s[5])
    }

    /// Everything the functions answer for some matrices.
    #[derive(Clone, Debug, PartialEq)]
    struct Answers {
        rotations: Vec<Matrix3<f64>>,
        pair_sums: Vec<[f64; 6]>,
        factors: Vec<[f64; 6]>,
        projected: Vec<[f64; 6]>,
        products: Vec<Matrix3<f64>>,
    }

    fn answers(m: &[Matrix3<f64>], a: &[[f64; 6]], d_m: &[Matrix3<f64>]) -> Answers {
        let n = m.len();
        let mut out = Answers {
            rotations: vec![Matrix3::zeros(); n],
            pair_sums: vec![[0.0; 6]; n],
            factors: vec![[0.0; 6]; n],
            projected: vec![[0.0; 6]; n],
            products: vec![Matrix3::zeros(); n],
        };
        let mut rotations = vec![Matrix3::zeros(); n];
        polar_rotations(m, &mut rotations);
        factors(m, &mut out.rotations, &mut out.pair_sums, &mut out.factors);
        assert_eq!(rotations, out.rotations);
        projected_factors(&out.pair_sums, a, &mut out.projected);
        hessian_products(&out.rotations, &out.factors, d_m, &mut out.products);
        out
    }

    /// Every length, and slices that start anywhere, give the bits of the whole list.
    #[test]
    fn any_length_and_start() {
        let mut random = Random::new(3);
        let m = matrices(200);
        let a: Vec<_> = m
            .iter()
            .map(|_| entries(&actuation_from_b(&random.actuation_entries(0.4))))
            .collect();
        let d_m: Vec<_> = m.iter().map(|_| random.matrix()).collect();
        let whole = answers(&m, &a, &d_m);
        for start in 0..8 {
            for length in (0..=33).chain([64, 65, 130]) {
                let range = start..start + length;
                let part = answers(&m[range.clone()], &a[range.clone()], &d_m[range.clone()]);
                let expected = Answers {
                    rotations: whole.rotations[range.clone()].to_vec(),
                    pair_sums: whole.pair_sums[range.clone()].to_vec(),
                    factors: whole.factors[range.clone()].to_vec(),
                    projected: whole.projected[range.clone()].to_vec(),
                    products: whole.products[range].to_vec(),
                };
                assert_eq!(part, expected, "{start} {length}");
            }
        }
    }

    #[test]
    fn agrees_with_the_scalar_functions() {
        let mut random = Random::new(4);
        let m: Vec<_> = matrices(300)
            .into_iter()
            .filter(|m| RotationGradient::at(m).smallest_pair_sum > 1e-2)
            .collect();
        let a: Vec<_> = m
            .iter()
            .map(|_| actuation_from_b(&random.actuation_entries(0.4)))
            .collect();
        let six: Vec<_> = a.iter().map(entries).collect();
        let d_m: Vec<_> = m.iter().map(|_| random.matrix()).collect();
        let out = answers(&m, &six, &d_m);
        assert!(m.len() > 200);
        for i in 0..m.len() {
            let gradient = RotationGradient::at(&m[i]);
            let core = HessianCore {
                gradient,
                actuation: a[i],
                filter: Filter::Exact,
            };
            let projected = core.filtered(Filter::Projected).gradient.factor;
            let size = gradient.factor.amax();
            let pairs = [
                (out.rotations[i], polar_rotation(&m[i]), 1.0),
                (from_entries(&out.pair_sums[i]), gradient.pair_sums, 1.0),
                (from_entries(&out.factors[i]), gradient.factor, size),
                (from_entries(&out.projected[i]), projected, 1.0),
                (out.products[i], gradient.apply(&d_m[i]), size),
            ];
            for (x, expected, size) in pairs {
                let error = (x - expected).amax();
                assert!(error < 2e-12 * size, "{} {x} {expected} {error:e}", m[i]);
            }
        }
    }

    #[test]
    #[should_panic(expected = "slices of different lengths: [3, 2]")]
    fn unequal_lengths_panic() {
        polar_rotations(&matrices(3), &mut [Matrix3::zeros(); 2]);
    }
}
