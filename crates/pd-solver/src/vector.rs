//! Arithmetic on nodal vectors: parallel, and the same to the last bit for any number of threads, because partial sums are
//! taken over fixed chunks and added in order.

use nalgebra::Vector3;
use rayon::prelude::*;
use std::ops::Range;

/// A value per node.
pub type NodalVector = Vec<Vector3<f64>>;

/// Part of a nodal vector.
type Part = [Vector3<f64>];

/// Nodes per chunk. Fewer nodes than this are not worth waking another thread for.
const CHUNK: usize = 4096;

/// Sum of `a . b` over all nodes.
pub(crate) fn dot(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    let [sum] = sums_over_parts(a.len(), |part| {
        let pairs = a[part.clone()].iter().zip(&b[part]);
        [pairs.map(|(a, b)| a.dot(b)).sum()]
    });
    sum
}

/// Euclidean norm over all nodes, safe against overflow and underflow of the squares.
pub(crate) fn norm(a: &[Vector3<f64>]) -> f64 {
    safe_root(dot(a, a), a)
}

/// The norm of a vector from the sum of its squares, which is not trusted where it may have over- or underflowed.
fn safe_root(square: f64, a: &[Vector3<f64>]) -> f64 {
    if square.is_normal() && square < 1e300 && square > 1e-280 {
        return square.sqrt();
    }
    let largest = max_norm(a);
    if largest == 0.0 || !largest.is_finite() {
        return largest;
    }
    let scale = 1.0 / largest;
    let sum: f64 = a.iter().map(|v| (v * scale).norm_squared()).sum();
    largest * sum.sqrt()
}

/// Largest length of a node's vector; NaN when any entry is NaN.
pub(crate) fn max_norm(a: &[Vector3<f64>]) -> f64 {
    let chunk = |c: &[Vector3<f64>]| c.iter().map(length).fold(0.0, nan_max);
    if a.len() <= CHUNK {
        return chunk(a);
    }
    a.par_chunks(CHUNK).map(chunk).reduce(|| 0.0, nan_max)
}

fn length(v: &Vector3<f64>) -> f64 {
    let square = v.norm_squared();
    if square == 0.0 && *v == Vector3::zeros() {
        0.0
    } else if square > 1e-280 && square < 1e300 {
        square.sqrt()
    } else {
        v.x.hypot(v.y).hypot(v.z)
    }
}

fn nan_max(a: f64, b: f64) -> f64 {
    if a.is_nan() || a > b { a } else { b }
}

/// Whether both are of one length, and what is asked holds at every node.
pub(crate) fn all_pairs(
    a: &[Vector3<f64>],
    b: &[Vector3<f64>],
    holds: impl Fn(&Vector3<f64>, &Vector3<f64>) -> bool + Sync,
) -> bool {
    let chunk = |(a, b): (&Part, &Part)| a.iter().zip(b).all(|(a, b)| holds(a, b));
    if a.len() != b.len() || a.len() <= CHUNK {
        return a.len() == b.len() && chunk((a, b));
    }
    a.par_chunks(CHUNK).zip(b.par_chunks(CHUNK)).all(chunk)
}

/// `y += a x`.
pub(crate) fn axpy(a: f64, x: &[Vector3<f64>], y: &mut [Vector3<f64>]) {
    update(y, x, |y, x| *y += x * a);
}

/// `y += a x`, and then the Euclidean norm of `y`.
pub(crate) fn axpy_norm(a: f64, x: &[Vector3<f64>], y: &mut [Vector3<f64>]) -> f64 {
    let chunk = |(y, x): (&mut [Vector3<f64>], &[Vector3<f64>])| -> f64 {
        let mut sum = 0.0;
        for (y, x) in y.iter_mut().zip(x) {
            *y += x * a;
            sum += y.norm_squared();
        }
        sum
    };
    let square: f64 = if y.len() <= CHUNK {
        chunk((y, x))
    } else {
        let parts = y.par_chunks_mut(CHUNK).zip(x.par_chunks(CHUNK));
        let partial: Vec<f64> = parts.map(chunk).collect();
        partial.iter().sum()
    };
    safe_root(square, y)
}

/// `out = x + a y`.
pub(crate) fn add_scaled(x: &[Vector3<f64>], a: f64, y: &[Vector3<f64>], out: &mut [Vector3<f64>]) {
    let chunk = |((out, x), y): ((&mut Part, &Part), &Part)| {
        for ((out, x), y) in out.iter_mut().zip(x).zip(y) {
            *out = x + y * a;
        }
    };
    if out.len() <= CHUNK {
        return chunk(((out, x), y));
    }
    out.par_chunks_mut(CHUNK)
        .zip(x.par_chunks(CHUNK))
        .zip(y.par_chunks(CHUNK))
        .for_each(chunk);
}

/// `out = x - y`.
pub(crate) fn difference(x: &[Vector3<f64>], y: &[Vector3<f64>], out: &mut [Vector3<f64>]) {
    add_scaled(x, -1.0, y, out);
}

/// `x = x * a + y`.
pub(crate) fn scale_add(x: &mut [Vector3<f64>], a: f64, y: &[Vector3<f64>]) {
    update(x, y, |x, y| *x = *x * a + y);
}

/// Changes every entry of `y` by that of `x`.
fn update(
    y: &mut [Vector3<f64>],
    x: &[Vector3<f64>],
    one: impl Fn(&mut Vector3<f64>, &Vector3<f64>) + Sync,
) {
    let chunk = |(y, x): (&mut [Vector3<f64>], &[Vector3<f64>])| {
        y.iter_mut().zip(x).for_each(|(y, x)| one(y, x));
    };
    if y.len() <= CHUNK {
        return chunk((y, x));
    }
    y.par_chunks_mut(CHUNK)
        .zip(x.par_chunks(CHUNK))
        .for_each(chunk);
}

/// Sums over all of `n` nodes, from those over parts of them.
pub(crate) fn sums_over_parts<const N: usize>(
    n: usize,
    part: impl Fn(Range<usize>) -> [f64; N] + Sync,
) -> [f64; N] {
    let range = |first: usize| first..n.min(first + CHUNK);
    if n <= CHUNK {
        return part(0..n);
    }
    let starts = (0..n.div_ceil(CHUNK)).into_par_iter();
    let partial: Vec<[f64; N]> = starts.map(|k| part(range(k * CHUNK))).collect();
    add_up(&partial)
}

/// The same where every part also writes two arrays there, and is told its first node.
pub(crate) fn sums_over_written<A: Send, B: Send, const N: usize>(
    (a, b): (&mut [A], &mut [B]),
    part: impl Fn(usize, &mut [A], &mut [B]) -> [f64; N] + Sync,
) -> [f64; N] {
    if a.len() <= CHUNK {
        return part(0, a, b);
    }
    let parts = a.par_chunks_mut(CHUNK).zip(b.par_chunks_mut(CHUNK));
    let partial: Vec<[f64; N]> = parts
        .enumerate()
        .map(|(k, (a, b))| part(k * CHUNK, a, b))
        .collect();
    add_up(&partial)
}

fn add_up<const N: usize>(partial: &[[f64; N]]) -> [f64; N] {
    std::array::from_fn(|k| partial.iter().map(|sums| sums[k]).sum())
}

/// Changes all parts of a nodal vector, each of which is told its first node.
pub(crate) fn for_parts(x: &mut Part, part: impl Fn(usize, &mut Part) + Sync) {
    if x.len() <= CHUNK {
        return part(0, x);
    }
    let parts = x.par_chunks_mut(CHUNK).enumerate();
    parts.for_each(|(k, x)| part(k * CHUNK, x));
}

/// A nodal vector of zeros.
pub(crate) fn zeros(n: usize) -> NodalVector {
    vec![Vector3::zeros(); n]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn norms_survive_extreme_entries() {
        for scale in [1e-200, 1e-160, 1.0, 1e160, 1e200] {
            let v = vec![Vector3::new(3.0 * scale, 4.0 * scale, 0.0); 4];
            assert!((norm(&v) / (10.0 * scale) - 1.0).abs() < 1e-14, "{scale}");
            assert!(
                (max_norm(&v) / (5.0 * scale) - 1.0).abs() < 1e-14,
                "{scale}"
            );
        }
        assert!(max_norm(&[Vector3::new(0.0, f64::NAN, 0.0), Vector3::zeros()]).is_nan());
    }
}
