//! Trees of boxes around parts that move along straight lines.
//!
//! What moves straight stays in the box that goes straight from that around its start to that around its end, and so do all parts under a node in
//! the node's. Two such boxes are compared at every moment at once: an arm that swings far meets what is in its way, not itself.

use nalgebra::Vector3;
use parry3d_f64::bounding_volume::Aabb;
use parry3d_f64::math::Vector;
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy, TraversalAction};
use rayon::prelude::*;
use std::ops::Range;

/// Boxes per task.
const CHUNK: usize = 256;
/// In place of a part, where a node has nodes below it.
const NO_LEAF: u32 = u32::MAX;

/// Points that move along straight lines.
#[derive(Clone, Copy)]
pub(super) struct Motion<'a> {
    pub(super) from: &'a [Vector3<f64>],
    pub(super) to: &'a [Vector3<f64>],
}

impl<'a> Motion<'a> {
    /// No motion.
    pub(super) fn at(x: &'a [Vector3<f64>]) -> Self {
        Self { from: x, to: x }
    }

    /// The moving box around some points, `grown` on all sides.
    pub(super) fn around(&self, points: &[u32], grown: f64) -> Moving {
        let around = |x: &[Vector3<f64>]| {
            let points = points.iter().map(|&p| &x[p as usize]);
            let start = [f64::INFINITY, f64::NEG_INFINITY].map(Vector3::repeat);
            let [low, high] = points.fold(start, |[low, high], x| [low.inf(x), high.sup(x)]);
            let grown = Vector3::repeat(grown);
            [low - grown, high + grown]
        };
        let start = around(self.from);
        let end = match std::ptr::eq(self.from, self.to) {
            true => start,
            false => around(self.to),
        };
        Moving { start, end }
    }
}

/// A box, by its lowest and its highest corner, that goes straight from one place and size to another.
#[derive(Clone, Copy)]
pub(super) struct Moving {
    start: [Vector3<f64>; 2],
    end: [Vector3<f64>; 2],
}

impl Moving {
    fn merged(&self, other: &Self) -> Self {
        let merge = |[a, b]: &[Vector3<f64>; 2], [c, d]: &[Vector3<f64>; 2]| [a.inf(c), b.sup(d)];
        Self {
            start: merge(&self.start, &other.start),
            end: merge(&self.end, &other.end),
        }
    }

    /// Whether both share a point at some moment.
    pub(super) fn meets(&self, other: &Self) -> bool {
        // Between these moments nothing yet seen keeps them apart.
        let (mut first, mut last) = (0.0_f64, 1.0_f64);
        for axis in 0..3 {
            for (one, other) in [(self, other), (other, self)] {
                // How far one is above the other: a line in time.
                let start = one.start[0][axis] - other.start[1][axis];
                let end = one.end[0][axis] - other.end[1][axis];
                match (start > 0.0, end > 0.0) {
                    (true, true) => return false,
                    (true, false) => first = first.max(start / (start - end)),
                    (false, true) => last = last.min(start / (start - end)),
                    (false, false) => {}
                }
            }
        }
        first <= last
    }
}

/// The shape of a tree over parts: nodes, each before those below it.
#[derive(Default)]
pub(super) struct Tree {
    nodes: Vec<Node>,
}

struct Node {
    /// The first node that is not below this one.
    end: u32,
    /// The part, or [`NO_LEAF`].
    leaf: u32,
}

impl Tree {
    /// A tree over the parts `range` of `all`, good where near parts stay near those that are near them at the positions `x`.
    pub(super) fn new<const N: usize>(
        all: &[[u32; N]],
        range: Range<usize>,
        x: &[Vector3<f64>],
    ) -> Self {
        let first = range.start as u32;
        let vector = |x: &Vector3<f64>| Vector::new(x.x, x.y, x.z);
        let boxes = all[range].iter().map(|part| {
            let [low, high] = Motion::at(x).around(part, 0.0).start;
            Aabb::new(vector(&low), vector(&high))
        });
        let boxes: Vec<Aabb> = boxes.collect();
        let bvh = Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes);
        // Children come in twos, and all below the first of the two before what is below the second.
        let mut visits = Vec::new();
        bvh.traverse(|node| {
            visits.push(node.leaf_data());
            TraversalAction::Continue
        });
        let mut nodes = Vec::with_capacity(visits.len());
        let mut next = visits.chunks(2);
        // Children whose turn is yet to come, and nodes whose end is.
        enum Open {
            Child(Option<u32>),
            End(usize),
        }
        let mut open = Vec::new();
        let children = |pair: Option<&[Option<u32>]>, open: &mut Vec<Open>| {
            let pair = pair.into_iter().flatten();
            open.extend(pair.rev().map(|child| Open::Child(*child)));
        };
        children(next.next(), &mut open);
        while let Some(entry) = open.pop() {
            let count = nodes.len();
            match entry {
                Open::Child(Some(leaf)) => nodes.push(Node {
                    end: count as u32 + 1,
                    leaf: first + leaf,
                }),
                Open::Child(None) => {
                    nodes.push(Node {
                        end: 0,
                        leaf: NO_LEAF,
                    });
                    open.push(Open::End(count));
                    children(next.next(), &mut open);
                }
                Open::End(node) => nodes[node].end = count as u32,
            }
        }
        Self { nodes }
    }

    /// The tree with boxes around its parts in a motion.
    pub(super) fn fit<const N: usize>(&self, all: &[[u32; N]], motion: &Motion) -> Fitted<'_> {
        let of = |node: &Node| match node.leaf {
            // To be replaced.
            NO_LEAF => motion.around(&[], 0.0),
            leaf => motion.around(&all[leaf as usize], 0.0),
        };
        let nodes = self.nodes.par_iter().with_min_len(CHUNK);
        let mut boxes: Vec<Moving> = nodes.map(of).collect();
        for (node, Node { end, leaf }) in self.nodes.iter().enumerate().rev() {
            if *leaf == NO_LEAF {
                // Two children: the second begins where the first ends.
                let one = node + 1;
                let other = self.nodes[one].end;
                boxes[node] = match other < *end {
                    true => boxes[one].merged(&boxes[other as usize]),
                    false => boxes[one],
                };
            }
        }
        Fitted { tree: self, boxes }
    }

    /// Places of the parts, for [`Fitted::after`].
    pub(super) fn leaves(&self) -> Vec<(usize, u32)> {
        let leaves = self.nodes.iter().map(|node| node.leaf).enumerate();
        leaves.filter(|(_, leaf)| *leaf != NO_LEAF).collect()
    }

    pub(super) fn bytes(&self) -> usize {
        size_of_val(&self.nodes[..])
    }
}

/// A tree with its boxes.
pub(super) struct Fitted<'a> {
    tree: &'a Tree,
    boxes: Vec<Moving>,
}

impl Fitted<'_> {
    /// Gives all parts from a place of the tree on (0: all there are) whose boxes meet one.
    pub(super) fn after(&self, place: usize, around: &Moving, mut found: impl FnMut(u32)) {
        let mut at = place;
        while let Some(node) = self.tree.nodes.get(at) {
            if !self.boxes[at].meets(around) {
                at = node.end as usize;
                continue;
            }
            if node.leaf != NO_LEAF {
                found(node.leaf);
            }
            at += 1;
        }
    }
}

/// The trees of a surface and of the obstacles after it.
pub(super) struct Trees {
    pub(super) own_triangles: Tree,
    pub(super) own_edges: Tree,
    pub(super) obstacle_triangles: Tree,
    pub(super) obstacle_edges: Tree,
}

impl Trees {
    /// `own` are the numbers of triangles and edges that are the surface's.
    pub(super) fn new(
        triangles: &[[u32; 3]],
        edges: &[[u32; 2]],
        own: [usize; 2],
        x: &[Vector3<f64>],
    ) -> Self {
        Self {
            own_triangles: Tree::new(triangles, 0..own[0], x),
            own_edges: Tree::new(edges, 0..own[1], x),
            obstacle_triangles: Tree::new(triangles, own[0]..triangles.len(), x),
            obstacle_edges: Tree::new(edges, own[1]..edges.len(), x),
        }
    }

    pub(super) fn bytes(&self) -> usize {
        let triangles = self.own_triangles.bytes() + self.obstacle_triangles.bytes();
        triangles + self.own_edges.bytes() + self.obstacle_edges.bytes()
    }
}

#[cfg(test)]
mod tests;
