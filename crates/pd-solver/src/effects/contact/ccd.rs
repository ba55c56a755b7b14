//! Continuous collision detection: how far a pair may move along straight lines before it comes too near.
//!
//! Additive CCD (Li et al. 2021, "Codimensional Incremental Potential Contact", algorithm 1): the distance over the largest relative motion
//! bounds from below the time at which the two can meet, and is added up. Every addition keeps a tenth of the distance in hand, so that roundoff
//! cannot hide a collision.

use super::distance::{Kind, Nearest, Quad};

/// Share of the distance that is kept.
const KEPT: f64 = 0.1;
/// Additions after which what is safe so far has to do.
const MAX_ADDITIONS: usize = 500;

/// The share of the motion `p` from `x`, at most 1, within which the pair keeps at least a tenth of its distance.
pub(crate) fn free_share(kind: Kind, x: &Quad, p: &Quad) -> f64 {
    let mean = (p[0] + p[1] + p[2] + p[3]) / 4.0;
    let p = p.map(|p| p - mean);
    let length = |i: usize| p[i].norm();
    let motion = match kind {
        Kind::VertexTriangle => length(0) + length(1).max(length(2)).max(length(3)),
        Kind::EdgeEdge => length(0).max(length(1)) + length(2).max(length(3)),
    };
    if motion == 0.0 {
        return 1.0;
    }
    let mut distance = Nearest::of(kind, x).squared().sqrt();
    let kept = KEPT * distance;
    let (mut share, mut step) = (0.0, (1.0 - KEPT) * distance / motion);
    for _ in 0..MAX_ADDITIONS {
        let next = (share + step).min(1.0);
        let moved: Quad = std::array::from_fn(|i| x[i] + p[i] * next);
        distance = Nearest::of(kind, &moved).squared().sqrt();
        if share > 0.0 && distance < kept {
            break;
        }
        if next == 1.0 {
            return 1.0;
        }
        share = next;
        step = (1.0 - KEPT) * distance / motion;
        // Below the roundoff of positions, distances tell nothing.
        if step.is_nan() || step < 1e-12 {
            break;
        }
    }
    share
}

#[cfg(test)]
mod tests;
