//! The list of pairs that may be felt, kept while nothing has moved far.

use super::broad::{Motion, Near, near};
use super::distance::{Nearest, boxes_apart};
use super::topology::{Pair, Topology};
use nalgebra::Vector3;

/// Pairs nearer than their barriers and a margin, where the list was made.
#[derive(Default)]
pub(super) struct PairList {
    pub(super) pairs: Vec<Pair>,
    /// Where all points were then; nowhere before the first search.
    at: Vec<Vector3<f64>>,
    /// How often it was made.
    pub(super) searches: u64,
}

impl PairList {
    /// Whether at `x` nothing is felt that is not in the list: no point moved more than half the margin since.
    pub(super) fn serves(&self, x: &[Vector3<f64>], margin: f64) -> bool {
        let limit = 0.25 * margin * margin;
        let near = |(a, b): (&Vector3<f64>, &Vector3<f64>)| (a - b).norm_squared() <= limit;
        self.at.len() == x.len() && self.at.iter().zip(x).all(near)
    }

    /// Makes the next look a search.
    pub(super) fn forget(&mut self) {
        self.at.clear();
    }

    /// Makes the list anew where it does not serve. Positions that are not finite leave it as it is.
    pub(super) fn prepare(
        &mut self,
        topology: &Topology,
        own: bool,
        x: &[Vector3<f64>],
        (dhat, margin): (f64, f64),
    ) {
        if self.serves(x, margin) || !x.iter().all(|x| x.iter().all(|x| x.is_finite())) {
            return;
        }
        self.searches += 1;
        let keep = |near: Near| {
            // Few of those whose boxes meet are near, and looking costs less than what a pair takes.
            let (kind, points) = topology.points_of(near)?;
            let at = points.map(|p| x[p as usize]);
            if boxes_apart(kind, &at, dhat + margin) {
                return None;
            }
            let nearest = Nearest::of(kind, &at);
            let distance = nearest.squared().sqrt();
            if distance >= dhat + margin {
                return None;
            }
            let pair = topology.pair(near)?;
            (distance < pair.barrier.dhat + margin).then_some(pair)
        };
        let motion = Motion::at(x, dhat + margin);
        self.pairs = near(topology, motion, own, usize::MAX, keep).unwrap_or_default();
        self.at.clear();
        self.at.extend_from_slice(x);
    }

    pub(super) fn bytes(&self) -> usize {
        size_of_val(&self.pairs[..]) + size_of_val(&self.at[..])
    }
}
