//! What L-BFGS remembers of its steps, and its directions.
//!
//! The two loops of Nocedal and Wright (Numerical Optimization, algorithm 7.4) ask for products of every pair with a vector that the other pairs have
//! changed. They follow from products with the vector as it was and from those of the pairs with each other, which stay as they are. So a
//! direction reads every pair four times and the vector twice, instead of eight readings and two writings per pair. Pairs tell how the gradient bends
//! to a few digits and are kept in single precision; all products are those of what is kept, so the approximation stays positive definite.

use super::Preconditioner;
use crate::vector::{NodalVector, for_parts, sums_over_parts, sums_over_written, zeros};
use nalgebra::Vector3;
use pulp::Arch;
use std::array::from_fn;
use std::ops::Range;

/// Steps that are remembered. With a good preconditioner the first few are what counts.
const HISTORY: usize = 8;
/// Places of the ring: one more, so that a pair which is not kept takes the place of none.
const PLACES: usize = HISTORY + 1;
/// Nodes that all pairs are read for before the next ones: they stay in the first cache.
const TILE: usize = 512;
/// Nodes that are added side by side.
const SIDE: usize = 8;

/// A number per pair, oldest first.
type PerPair = [f64; HISTORY];
/// A value per node in single precision.
type Single = [[f32; 3]];

/// The pairs of the last steps in a ring.
#[derive(Default)]
pub(crate) struct History {
    ring: Vec<Pair>,
    /// Pairs pushed since the last clearing.
    count: usize,
    /// What the pairs leave of a gradient to the preconditioner.
    rest: NodalVector,
}

/// A step s and the change y of the gradient over it, each in a unit of its own.
#[derive(Default)]
struct Pair {
    s: Vec<[f32; 3]>,
    y: Vec<[f32; 3]>,
    /// The unit of s over that of y.
    units: f64,
    /// Products of this y with the s of every place.
    products: [f64; PLACES],
}

/// Where a descent stood, and its gradient there.
#[derive(Clone, Copy)]
pub(super) struct State<'a> {
    pub(super) u: &'a [Vector3<f64>],
    pub(super) gradient: &'a [Vector3<f64>],
}

impl History {
    /// Pairs that directions are made of.
    pub(super) fn len(&self) -> usize {
        self.count.min(HISTORY)
    }

    pub(super) fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Forgets all pairs.
    pub(super) fn clear(&mut self) {
        self.count = 0;
    }

    /// Where pair `i` is in the ring, counted from the oldest.
    fn place(&self, i: usize) -> usize {
        (self.count - self.len() + i) % PLACES
    }

    fn pair(&self, i: usize) -> &Pair {
        &self.ring[self.place(i)]
    }

    /// The product of the s of pair `i` with the y of pair `j`, which is no older.
    fn product(&self, i: usize, j: usize) -> f64 {
        self.pair(j).products[self.place(i)]
    }

    /// `direction = B^-1 gradient` with the quasi-Newton approximation B, whose first guess is the preconditioner.
    pub(super) fn direction(
        &mut self,
        pre: &mut dyn Preconditioner,
        gradient: &[Vector3<f64>],
        direction: &mut NodalVector,
    ) {
        let len = self.len();
        if len == 0 {
            return pre.apply(gradient, direction);
        }
        let mut rest = std::mem::take(&mut self.rest);
        if rest.len() != gradient.len() {
            rest = zeros(gradient.len());
        }
        let along = self.products_with(gradient, |pair| &pair.s);
        let mut alphas = [0.0; HISTORY];
        for i in (0..len).rev() {
            let newer: f64 = (i + 1..len).map(|j| alphas[j] * self.product(i, j)).sum();
            alphas[i] = (along[i] - newer) / self.product(i, i);
        }
        rest.copy_from_slice(gradient);
        self.add(&alphas.map(|alpha| -alpha), |pair| &pair.y, &mut rest);
        pre.apply(&rest, direction);
        let along = self.products_with(direction, |pair| &pair.y);
        let mut factors = [0.0; HISTORY];
        for i in 0..len {
            let older: f64 = (0..i).map(|j| factors[j] * self.product(j, i)).sum();
            let beta = (along[i] + older) / self.product(i, i);
            factors[i] = self.pair(i).units * alphas[i] - beta;
        }
        self.add(&factors, |pair| &pair.s, direction);
        self.rest = rest;
    }

    /// Products of one vector of every pair with `x`.
    fn products_with(
        &self,
        x: &[Vector3<f64>],
        vector: impl Fn(&Pair) -> &Single + Sync,
    ) -> PerPair {
        let len = self.len();
        sums_over_parts(x.len(), |part| {
            let mut sums = [0.0; HISTORY];
            for tile in tiles(part) {
                let x = &x[tile.clone()];
                for (i, sum) in sums[..len].iter_mut().enumerate() {
                    *sum += dot(&vector(self.pair(i))[tile.clone()], x);
                }
            }
            sums
        })
    }

    /// Adds one vector of every pair, times its factor, to `x`.
    fn add(
        &self,
        factors: &PerPair,
        vector: impl Fn(&Pair) -> &Single + Sync,
        x: &mut [Vector3<f64>],
    ) {
        let len = self.len();
        for_parts(x, |first, x| {
            for (number, x) in x.chunks_mut(TILE).enumerate() {
                let from = first + number * TILE;
                for (i, factor) in factors[..len].iter().enumerate() {
                    axpy(*factor, &vector(self.pair(i))[from..from + x.len()], x);
                }
            }
        });
    }

    /// Keeps the step between two states; false where its product with the change of the gradient is not safely positive. The units are about
    /// the sizes of the largest entries of both.
    pub(super) fn push(&mut self, from: State, to: State, units: (f64, f64)) -> bool {
        let place = self.count % PLACES;
        if self.ring.len() <= place {
            self.ring.resize_with(place + 1, Pair::default);
        }
        let n = from.u.len();
        let mut pair = std::mem::take(&mut self.ring[place]);
        pair.s.resize(n, [0.0; 3]);
        pair.y.resize(n, [0.0; 3]);
        pair.units = units.0 / units.1;
        let len = self.len();
        let (mut s, mut y) = (std::mem::take(&mut pair.s), std::mem::take(&mut pair.y));
        let sums = sums_over_written((&mut s, &mut y), |first, s, y| {
            let mut sums = [0.0; HISTORY + 3];
            let tiles = s.chunks_mut(TILE).zip(y.chunks_mut(TILE));
            for (number, (s, y)) in tiles.enumerate() {
                let tile = first + number * TILE..first + number * TILE + s.len();
                let change =
                    |from: &[Vector3<f64>], to: &[Vector3<f64>], unit, out: &mut Single| {
                        write_change(&from[tile.clone()], &to[tile.clone()], unit, out);
                    };
                change(from.u, to.u, units.0, s);
                change(from.gradient, to.gradient, units.1, y);
                let [s_y, s_s, y_y, others @ ..] = &mut sums;
                *s_y += dot(s, y);
                *s_s += dot(s, s);
                *y_y += dot(y, y);
                for (i, other) in others[..len].iter_mut().enumerate() {
                    *other += dot(&self.pair(i).s[tile.clone()], y);
                }
            }
            sums
        });
        (pair.s, pair.y) = (s, y);
        let [s_y, s_s, y_y, others @ ..] = sums;
        for (i, other) in others[..len].iter().enumerate() {
            pair.products[self.place(i)] = *other;
        }
        pair.products[place] = s_y;
        self.ring[place] = pair;
        let positive = s_y > f64::EPSILON * (s_s * y_y).sqrt();
        self.count += usize::from(positive);
        positive
    }
}

/// The tiles of a range of nodes.
fn tiles(part: Range<usize>) -> impl Iterator<Item = Range<usize>> {
    part.clone()
        .step_by(TILE)
        .map(move |from| from..part.end.min(from + TILE))
}

/// Entries of nodes side by side, in double precision.
const WIDE: usize = 3 * SIDE;

/// The value of a node, in either precision.
trait Value {
    fn entry(&self, k: usize) -> f64;
}

impl Value for [f32; 3] {
    #[inline(always)]
    fn entry(&self, k: usize) -> f64 {
        f64::from(self[k])
    }
}

impl Value for Vector3<f64> {
    #[inline(always)]
    fn entry(&self, k: usize) -> f64 {
        self[k]
    }
}

#[inline(always)]
fn side<T: Value>(x: &[T; SIDE]) -> [f64; WIDE] {
    from_fn(|k| x[k / 3].entry(k % 3))
}

fn dot<T: Value>(v: &Single, x: &[T]) -> f64 {
    let ((v, v_left), (x, x_left)) = (v.as_chunks(), x.as_chunks());
    Arch::new().dispatch(|| {
        let mut sums = [0.0; WIDE];
        for (v, x) in v.iter().zip(x) {
            let (v, x) = (side(v), side(x));
            for k in 0..WIDE {
                sums[k] += v[k] * x[k];
            }
        }
        let mut sum = sums.iter().sum();
        for (v, x) in v_left.iter().zip(x_left) {
            for k in 0..3 {
                sum += v.entry(k) * x.entry(k);
            }
        }
        sum
    })
}

/// `x += factor v`.
fn axpy(factor: f64, v: &Single, x: &mut [Vector3<f64>]) {
    Arch::new().dispatch(|| {
        for (x, v) in x.iter_mut().zip(v) {
            for k in 0..3 {
                x[k] += factor * f64::from(v[k]);
            }
        }
    });
}

/// `out = (to - from) / unit`.
fn write_change(from: &[Vector3<f64>], to: &[Vector3<f64>], unit: f64, out: &mut Single) {
    let per_unit = 1.0 / unit;
    Arch::new().dispatch(|| {
        for ((out, from), to) in out.iter_mut().zip(from).zip(to) {
            for k in 0..3 {
                out[k] = ((to[k] - from[k]) * per_unit) as f32;
            }
        }
    });
}

#[cfg(test)]
mod tests;
