//! The list of pairs that may be felt, kept while nothing has moved far from where, or from the way along which, it was made.

use super::broad::{Near, near};
use super::distance::{Kind, Quad, boxes_apart, squared_distance};
use super::topology::{Pair, Topology};
use super::tree::Motion;
use nalgebra::Vector3;

/// Pairs that come nearer than their barriers and a margin, somewhere on the way that the list was made for.
#[derive(Default)]
pub(super) struct PairList {
    pub(super) pairs: Vec<Pair>,
    /// The way of all points, from there straight to here; nowhere before the first search.
    from: Vec<Vector3<f64>>,
    to: Vec<Vector3<f64>>,
    /// How often it was made.
    pub(super) searches: u64,
}

/// What all searches for pairs share.
#[derive(Clone, Copy)]
pub(super) struct Reach {
    pub(super) own: bool,
    pub(super) dhat: f64,
    pub(super) margin: f64,
}

impl PairList {
    /// Whether at `x` nothing is felt that is not in the list: from some moment of the way, no point is farther than half the margin.
    pub(super) fn serves(&self, x: &[Vector3<f64>], margin: f64) -> bool {
        if self.from.len() != x.len() {
            return false;
        }
        let ways = || self.from.iter().zip(&self.to);
        let (mut along, mut length) = (0.0, 0.0);
        for ((a, b), x) in ways().zip(x) {
            let way = b - a;
            along += way.dot(&(x - a));
            length += way.norm_squared();
        }
        let moment = match length > 0.0 {
            true => (along / length).clamp(0.0, 1.0),
            false => 0.0,
        };
        let limit = 0.25 * margin * margin;
        let near = |((a, b), x): ((&Vector3<f64>, &Vector3<f64>), &Vector3<f64>)| {
            (x - a - (b - a) * moment).norm_squared() <= limit
        };
        ways().zip(x).all(near)
    }

    /// Makes the next look a search.
    pub(super) fn forget(&mut self) {
        self.from.clear();
    }

    /// Makes the list anew where it does not serve. Positions that are not finite leave it as it is.
    pub(super) fn prepare(&mut self, topology: &Topology, x: &[Vector3<f64>], reach: Reach) {
        if self.serves(x, reach.margin) || !x.iter().all(|x| x.iter().all(|x| x.is_finite())) {
            return;
        }
        self.search(topology, x, x, reach, usize::MAX);
    }

    /// Makes the list for all of a straight way; false, and the list as it was, where more than `limit` boxes meet on it.
    pub(super) fn search(
        &mut self,
        topology: &Topology,
        from: &[Vector3<f64>],
        to: &[Vector3<f64>],
        reach: Reach,
        limit: usize,
    ) -> bool {
        self.searches += 1;
        let distance = reach.dhat + reach.margin;
        let keep = |near: Near| {
            // Few of those whose boxes meet are near, and looking costs less than what a pair takes.
            let (kind, points) = topology.points_of(near)?;
            if !comes_within(kind, &points, from, to, distance) {
                return None;
            }
            let pair = topology.pair(near)?;
            let own = pair.barrier.dhat + reach.margin;
            comes_within(kind, &points, from, to, own).then_some(pair)
        };
        let motion = Motion { from, to };
        let Some(pairs) = near(topology, motion, distance, reach.own, limit, keep) else {
            return false;
        };
        self.pairs = pairs;
        self.from.clear();
        self.from.extend_from_slice(from);
        self.to.clear();
        self.to.extend_from_slice(to);
        true
    }

    /// Ends the way after this share of it, and drops what is not near before that.
    pub(super) fn shorten(&mut self, share: f64, margin: f64) {
        let ends = self.to.iter_mut().zip(&self.from);
        ends.for_each(|(to, from)| *to = from + (*to - from) * share);
        let (from, to) = (&self.from, &self.to);
        self.pairs.retain(|pair| {
            let barrier = &pair.barrier;
            comes_within(barrier.kind, &pair.points, from, to, barrier.dhat + margin)
        });
    }

    pub(super) fn bytes(&self) -> usize {
        size_of_val(&self.pairs[..]) + size_of_val(&self.from[..]) + size_of_val(&self.to[..])
    }
}

/// Whether four points may come nearer than `distance` on their way: their distance at the start, less how much each of the two moves.
fn comes_within(
    kind: Kind,
    points: &[u32; 4],
    from: &[Vector3<f64>],
    to: &[Vector3<f64>],
    distance: f64,
) -> bool {
    let at: Quad = points.map(|p| from[p as usize]);
    let ways = points.map(|p| to[p as usize] - from[p as usize]);
    let mean = (ways[0] + ways[1] + ways[2] + ways[3]) / 4.0;
    let moves = ways.map(|way| (way - mean).norm_squared());
    let (one, other) = moves.split_at(kind.first());
    let longest = |moves: &[f64]| moves.iter().fold(0.0, |a: f64, b| a.max(*b)).sqrt();
    let distance = distance + longest(one) + longest(other);
    !boxes_apart(kind, &at, distance) && squared_distance(kind, &at) < distance * distance
}

#[cfg(test)]
pub(super) mod tests;
