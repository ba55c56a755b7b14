//! How many polygons meet at each edge, and which way they run.

use super::Edge;
use crate::Surface;

/// The edges something is wrong with, by rising vertex indices.
#[derive(Default)]
pub(super) struct Edges {
    pub open: Vec<Edge>,
    pub non_manifold: Vec<Edge>,
    pub inconsistent: Vec<Edge>,
}

/// One polygon side, filed under its lower vertex.
#[derive(Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
struct Side {
    upper: u32,
    /// Whether it runs from the upper to the lower vertex.
    down: bool,
}

pub(super) fn examine(surface: &Surface) -> Edges {
    let (mut sides, starts) = sides_by_lower_vertex(surface);
    let mut edges = Edges::default();
    for (lower, ends) in starts.windows(2).enumerate() {
        let around = &mut sides[ends[0]..ends[1]];
        around.sort_unstable();
        for same in around.chunk_by(|a, b| a.upper == b.upper) {
            classify(surface, lower as u32, same, &mut edges);
        }
    }
    edges
}

fn classify(surface: &Surface, lower: u32, sides: &[Side], edges: &mut Edges) {
    let uses = sides.len();
    let inconsistent = uses == 2 && sides[0].down == sides[1].down;
    if uses == 2 && !inconsistent {
        return;
    }
    let vertices = [lower, sides[0].upper];
    let edge = Edge {
        vertices,
        positions: vertices.map(|vertex| surface.vertices()[vertex as usize]),
        uses,
    };
    if uses % 2 == 1 {
        edges.open.push(edge);
    }
    if uses > 2 {
        edges.non_manifold.push(edge);
    }
    if inconsistent {
        edges.inconsistent.push(edge);
    }
}

/// All polygon sides, those with lower vertex `v` at `starts[v]..starts[v + 1]`: a counting sort.
fn sides_by_lower_vertex(surface: &Surface) -> (Vec<Side>, Vec<usize>) {
    let mut starts = vec![0; surface.vertex_count() + 1];
    for_each_side(surface, |a, b| starts[a.min(b) as usize] += 1);
    let mut total = 0;
    for start in &mut starts {
        total += *start;
        *start = total;
    }
    // Filling each bucket from its end leaves `starts` at the bucket's beginning.
    let mut sides = vec![Side::default(); total];
    for_each_side(surface, |a, b| {
        let start = &mut starts[a.min(b) as usize];
        *start -= 1;
        sides[*start] = Side {
            upper: a.max(b),
            down: a > b,
        };
    });
    (sides, starts)
}

/// Visits the sides of every polygon. A side from a corner to itself is none, and a polygon folded onto a single edge has
/// none: it closes nothing and opens nothing.
fn for_each_side(surface: &Surface, mut visit: impl FnMut(u32, u32)) {
    for polygon in surface.polygons() {
        match *polygon {
            [a, b, c] if a != b && b != c && c != a => {
                visit(a, b);
                visit(b, c);
                visit(c, a);
            }
            _ => {
                let before = polygon.last().into_iter().chain(polygon);
                let sides = before.zip(polygon).filter(|(a, b)| a != b);
                if sides.clone().count() >= 3 {
                    sides.for_each(|(&a, &b)| visit(a, b));
                }
            }
        }
    }
}
