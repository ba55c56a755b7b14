//! Continuous collision detection: how far a pair may move along straight lines before it comes too near.
//!
//! Additive CCD (Li et al. 2021, "Codimensional Incremental Potential Contact", algorithm 1): the distance over the largest relative motion
//! bounds from below the time at which the two can meet, and is added up. Every addition keeps a tenth of the distance in hand, so that roundoff
//! cannot hide a collision.

use super::distance::{Kind, Quad, squared_distance};
use std::sync::atomic::{AtomicU64, Ordering};

/// Share of the distance that is kept.
const KEPT: f64 = 0.1;
/// Additions after which what is safe so far has to do.
const MAX_ADDITIONS: usize = 100;

/// The share of the motion `p` from `x`, at most `limit`, within which the pair keeps at least a tenth of its distance.
pub(crate) fn free_share(kind: Kind, x: &Quad, p: &Quad, limit: f64) -> f64 {
    let mean = (p[0] + p[1] + p[2] + p[3]) / 4.0;
    let p = p.map(|p| p - mean);
    let length = |i: usize| p[i].norm();
    let motion = match kind {
        Kind::VertexTriangle => length(0) + length(1).max(length(2)).max(length(3)),
        Kind::EdgeEdge => length(0).max(length(1)) + length(2).max(length(3)),
    };
    if motion == 0.0 {
        return limit;
    }
    let mut distance = squared_distance(kind, x).sqrt();
    let kept = KEPT * distance;
    if apart(kind, x, &p, kept) {
        return limit;
    }
    let (mut share, mut step) = (0.0_f64, (1.0 - KEPT) * distance / motion);
    for _ in 0..MAX_ADDITIONS {
        // What is seen on the way must not hang on the limit, so that the least of many does not hang on their order.
        let next = (share + step).min(1.0);
        let moved: Quad = std::array::from_fn(|i| x[i] + p[i] * next);
        distance = squared_distance(kind, &moved).sqrt();
        if share > 0.0 && distance < kept {
            break;
        }
        if next >= limit {
            return limit;
        }
        share = next;
        step = (1.0 - KEPT) * distance / motion;
        // Below the roundoff of positions, distances tell nothing.
        if step.is_nan() || step < 1e-12 {
            break;
        }
    }
    share.min(limit)
}

/// Whether boxes around the ways of both stay farther apart than `kept`.
fn apart(kind: Kind, x: &Quad, p: &Quad, kept: f64) -> bool {
    (0..3).any(|axis| {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for i in 0..4 {
            let side = usize::from(i >= kind.first());
            for at in [x[i][axis], x[i][axis] + p[i][axis]] {
                (low[side], high[side]) = (low[side].min(at), high[side].max(at));
            }
        }
        low[1] - high[0] > kept || low[0] - high[1] > kept
    })
}

/// The smallest of the shares of many pairs, which spares the others what lies beyond it. The order in which pairs come does not change the end.
pub(crate) struct Least(AtomicU64);

impl Least {
    pub(crate) fn new(share: f64) -> Self {
        Self(AtomicU64::new(share.to_bits()))
    }

    /// Takes a pair into account.
    pub(crate) fn see(&self, kind: Kind, x: &Quad, p: &Quad) {
        let least = self.share();
        let share = free_share(kind, x, p, least);
        if share < least {
            // Bits of numbers that are not negative have the order of the numbers.
            self.0.fetch_min(share.to_bits(), Ordering::Relaxed);
        }
    }

    /// The smallest so far.
    pub(crate) fn share(&self) -> f64 {
        f64::from_bits(self.0.load(Ordering::Relaxed))
    }
}

#[cfg(test)]
mod tests;
