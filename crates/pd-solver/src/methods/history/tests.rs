//! Directions against the two loops of the book in double precision.

use super::*;
use crate::vector::{dot as product, norm};

/// A preconditioner that divides each node by a number of its own, of about this size.
struct Diagonal(f64);

impl Preconditioner for Diagonal {
    fn apply(&mut self, r: &[Vector3<f64>], z: &mut NodalVector) {
        let scaled = r
            .iter()
            .enumerate()
            .map(|(i, r)| r / (self.0 * (1 + i % 7) as f64));
        z.clear();
        z.extend(scaled);
    }
}

/// A vector of smooth numbers of about this size.
fn vector(n: usize, seed: usize, size: f64) -> NodalVector {
    let entry = |i: usize, c: usize| size * ((i * (seed + 2) + 5 * c + seed * seed) as f64).sin();
    (0..n)
        .map(|i| Vector3::from_fn(|c, _| entry(i, c)))
        .collect()
}

/// Steps and changes of the gradient of a quadratic energy whose curvature differs from node to node, in these units.
fn pairs(n: usize, count: usize, size: f64, stiffness: f64) -> Vec<(NodalVector, NodalVector)> {
    let of = |seed| {
        let s = vector(n, seed, size);
        let y = s.iter().enumerate();
        let y = y.map(|(i, s)| s * (stiffness * (2.0 + (i % 5) as f64)));
        let y = y.collect();
        (s, y)
    };
    (0..count).map(of).collect()
}

fn push(history: &mut History, s: &NodalVector, y: &NodalVector) -> bool {
    let zero = zeros(s.len());
    let (from, to) = (
        State {
            u: &zero,
            gradient: &zero,
        },
        State { u: s, gradient: y },
    );
    history.push(from, to, (norm(s), norm(y)))
}

/// Algorithm 7.4 as it stands.
fn two_loops(
    pre: &mut Diagonal,
    pairs: &[(NodalVector, NodalVector)],
    gradient: &NodalVector,
) -> NodalVector {
    let mut q = gradient.clone();
    let mut alphas = Vec::new();
    for (s, y) in pairs.iter().rev() {
        let alpha = product(s, &q) / product(s, y);
        q.iter_mut().zip(y).for_each(|(q, y)| *q -= y * alpha);
        alphas.push(alpha);
    }
    let mut r = Vec::new();
    pre.apply(&q, &mut r);
    for ((s, y), alpha) in pairs.iter().zip(alphas.iter().rev()) {
        let beta = product(y, &r) / product(s, y);
        let factor = alpha - beta;
        r.iter_mut().zip(s).for_each(|(r, s)| *r += s * factor);
    }
    r
}

fn distance(a: &NodalVector, b: &NodalVector) -> f64 {
    let difference: NodalVector = a.iter().zip(b).map(|(a, b)| a - b).collect();
    norm(&difference) / norm(b)
}

/// Directions are those of the two loops to single precision, with as many pairs as there are and as the ring holds, for bodies of some and of
/// several parts, in any units.
#[test]
fn directions_are_those_of_two_loops() {
    for (n, size, stiffness) in [
        (40, 1.0, 1.0),
        (700, 1e-9, 1e6),
        (9001, 1e60, 1e-90),
        (9001, 1e-60, 1e120),
    ] {
        let all = pairs(n, 13, size, stiffness);
        let mut history = History::default();
        let mut pre = Diagonal(stiffness);
        let gradient = vector(n, 31, size * stiffness);
        let mut direction = Vec::new();
        for (count, (s, y)) in all.iter().enumerate() {
            let first = count.saturating_sub(HISTORY);
            history.direction(&mut pre, &gradient, &mut direction);
            let expected = two_loops(&mut pre, &all[first..count], &gradient);
            let error = distance(&direction, &expected);
            assert!(error < 3e-6, "{n} nodes, {count} pairs: {error:e}");
            assert!(push(&mut history, s, y));
            // The secant equation: the last step is the direction for its change of the gradient.
            history.direction(&mut pre, y, &mut direction);
            let error = distance(&direction, s);
            assert!(error < 3e-6, "{n} nodes, pair {count}: {error:e}");
        }
        assert_eq!(history.len(), HISTORY);
    }
}

/// Steps along which the gradient does not grow, or that are none, are not kept and take the place of no other.
#[test]
fn steps_of_no_curvature_are_not_kept() {
    let n = 60;
    let all = pairs(n, 2 * HISTORY, 1.0, 1.0);
    let gradient = vector(n, 77, 1.0);
    let mut history = History::default();
    let (mut with, mut without) = (Vec::new(), Vec::new());
    for (s, y) in &all {
        assert!(push(&mut history, s, y));
        history.direction(&mut Diagonal(1.0), &gradient, &mut without);
        let back: NodalVector = y.iter().map(|y| -y).collect();
        for (s, y) in [(s, &back), (&zeros(n), y), (s, &zeros(n))] {
            let kept = history.len();
            assert!(!push(&mut history, s, y));
            assert_eq!(history.len(), kept);
            history.direction(&mut Diagonal(1.0), &gradient, &mut with);
            assert_eq!(with, without);
        }
    }
    history.clear();
    assert!(history.is_empty());
    history.direction(&mut Diagonal(1.0), &gradient, &mut with);
    assert_eq!(with, two_loops(&mut Diagonal(1.0), &[], &gradient));
}
