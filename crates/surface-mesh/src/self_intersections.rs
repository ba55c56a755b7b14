//! Where a surface passes through itself.

use nalgebra::Vector3;

/// All pairs of triangles that pass through each other and share no vertex; the lower index first, pairs by rising index.
///
/// An edge of one passes through the inside of the other. What only touches, lies in one plane, or folds over around a common vertex
/// is not counted. Triangles are sorted along the longest side of the bounding box and those that overlap there are compared.
///
/// # Panics
/// When a triangle names a vertex that does not exist.
pub fn self_intersections(vertices: &[Vector3<f64>], triangles: &[[u32; 3]]) -> Vec<[u32; 2]> {
    let corners = |t: u32| triangles[t as usize].map(|v| vertices[v as usize]);
    let mut pairs = Vec::new();
    for_overlapping(vertices, triangles, |one, other| {
        let (ta, tb) = (triangles[one as usize], triangles[other as usize]);
        if ta.iter().any(|v| tb.contains(v)) {
            return;
        }
        let (a, b) = (corners(one), corners(other));
        if pierces(&a, &b) || pierces(&b, &a) {
            pairs.push([one.min(other), one.max(other)]);
        }
    });
    pairs.sort_unstable();
    pairs
}

/// Calls `visit` with all pairs of triangles whose boxes meet, each pair once.
pub(crate) fn for_overlapping(
    vertices: &[Vector3<f64>],
    triangles: &[[u32; 3]],
    mut visit: impl FnMut(u32, u32),
) {
    let boxes: Vec<[Vector3<f64>; 2]> = triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(|v| vertices[v as usize]);
            [a.inf(&b).inf(&c), a.sup(&b).sup(&c)]
        })
        .collect();
    let joined =
        |[low, high]: [Vector3<f64>; 2], [l, h]: [Vector3<f64>; 2]| [low.inf(&l), high.sup(&h)];
    let Some(whole) = boxes.iter().copied().reduce(joined) else {
        return;
    };
    let axis = (whole[1] - whole[0]).imax();
    let mut order: Vec<u32> = (0..triangles.len() as u32).collect();
    let start = |t: u32| boxes[t as usize][0][axis];
    order.sort_unstable_by(|&a, &b| start(a).total_cmp(&start(b)).then(a.cmp(&b)));
    for (i, &one) in order.iter().enumerate() {
        let [low, high] = boxes[one as usize];
        let later = order[i + 1..].iter().copied();
        for other in later.take_while(|&t| start(t) <= high[axis]) {
            let [l, h] = boxes[other as usize];
            if (0..3).all(|k| h[k] >= low[k] && high[k] >= l[k]) {
                visit(one, other);
            }
        }
    }
}

/// Whether an edge of `a` passes through the inside of `b`.
fn pierces(a: &[Vector3<f64>; 3], b: &[Vector3<f64>; 3]) -> bool {
    (0..3).any(|i| edge_pierces(&[a[i], a[(i + 1) % 3]], b))
}

/// Whether an edge passes through the inside of a triangle.
pub(crate) fn edge_pierces(edge: &[Vector3<f64>; 2], triangle: &[Vector3<f64>; 3]) -> bool {
    let [a, b, c] = triangle;
    let side = edge.map(|p| volume(a, b, c, &p));
    if side[0] * side[1] >= 0.0 {
        return false;
    }
    let around: [f64; 3] =
        std::array::from_fn(|k| volume(&edge[0], &edge[1], &triangle[k], &triangle[(k + 1) % 3]));
    around.iter().all(|&v| v > 0.0) || around.iter().all(|&v| v < 0.0)
}

/// Six times the signed volume of a tetrahedron.
fn volume(a: &Vector3<f64>, b: &Vector3<f64>, c: &Vector3<f64>, d: &Vector3<f64>) -> f64 {
    (b - a).cross(&(c - a)).dot(&(d - a))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::primitives::{icosphere, torus};

    fn points(flat: &[[f64; 3]]) -> Vec<Vector3<f64>> {
        flat.iter().map(|&p| p.into()).collect()
    }

    #[test]
    fn a_triangle_through_another_is_found_and_one_beside_it_is_not() {
        let flat = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]];
        let triangles = [[3, 4, 5], [0, 1, 2]];
        for (x, expected) in [(0.5, vec![[0, 1]]), (1.5, vec![]), (-0.1, vec![])] {
            let upright = [[x, 0.9, -1.0], [x, 0.9, 1.0], [x, 5.0, 0.5]];
            let vertices = points(&[flat, upright].concat());
            assert_eq!(self_intersections(&vertices, &triangles), expected, "{x}");
        }
        // It stands on the other without passing through.
        let standing = [[0.5, 0.5, 0.0], [0.5, 0.5, 1.0], [0.5, 5.0, 0.5]];
        let vertices = points(&[flat, standing].concat());
        assert!(self_intersections(&vertices, &triangles).is_empty());
        assert!(self_intersections(&vertices, &[]).is_empty());
    }

    #[test]
    fn closed_surfaces_meet_themselves_only_where_they_are_pushed_through() {
        for surface in [icosphere(3, 1.0), torus(2.0, 0.5, 24, 12)] {
            let found = self_intersections(surface.vertices(), surface.triangles());
            assert!(found.is_empty());
        }
        // One vertex of a ball is pushed out through the opposite side: each of the triangles around it passes through there.
        let ball = icosphere(2, 1.0);
        let mut vertices = ball.vertices().to_vec();
        let through = -1.5 * vertices[0] + Vector3::new(0.01, 0.02, 0.03);
        vertices[0] = through;
        let found = self_intersections(&vertices, ball.triangles());
        let around = |t: u32| ball.triangles()[t as usize].contains(&0);
        assert!(found.len() >= 5);
        assert!(found.iter().all(|p| around(p[0]) != around(p[1])));
        assert!(found.is_sorted());
    }
}
