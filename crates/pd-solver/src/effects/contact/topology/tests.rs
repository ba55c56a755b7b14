//! What pairs stand for, on triangles whose areas and lengths are whole numbers.

use super::*;

const STIFFNESS: f64 = 0.7;

/// Two triangles of the body with sides 3, 4 and 5, one above the other by 1, and below both one of an obstacle of twice the size.
fn stack(dhat: f64) -> Topology {
    let corners = |size: f64, z: f64| {
        let corners = [[0.0, 0.0], [3.0, 0.0], [0.0, 4.0]];
        corners.map(|[x, y]| Vector3::new(size * x, size * y, z))
    };
    let rest = [corners(1.0, 0.0), corners(1.0, 1.0), corners(2.0, -0.2)].concat();
    let triangles = vec![[0, 1, 2], [3, 4, 5], [6, 7, 8]];
    Topology::new(rest, 6, triangles, 2, (dhat, STIFFNESS))
}

fn edge(topology: &Topology, ends: [u32; 2]) -> u32 {
    let found = topology.edges.iter().position(|e| *e == ends);
    found.expect("an edge of a triangle") as u32
}

/// A third of a triangle for each corner and each side: 2 of the body's 6, 8 of the obstacle's 24.
#[test]
fn a_pair_stands_for_the_smaller_of_its_areas() {
    let t = stack(0.5);
    let strength = |near| t.pair(near).expect("a pair").barrier.strength / STIFFNESS;
    let is = |near, area: f64| assert!((strength(near) - area).abs() < 1e-14, "{near:?}");
    is(Near::VertexTriangle(0, 2), 2.0);
    is(Near::VertexTriangle(6, 0), 8.0);
    is(Near::VertexTriangle(3, 0), 2.0 / 3.0);
    let (own, above, other) = (edge(&t, [1, 2]), edge(&t, [3, 4]), edge(&t, [6, 8]));
    is(Near::EdgeEdge(own, other), 1.0);
    is(Near::EdgeEdge(own, above), 1.0 / 3.0);
    assert_eq!(t.strength(4), 2.0 * STIFFNESS);
    assert_eq!((t.own_edges, t.mean_edge()), (6, 4.0));
}

/// A vertex that belongs to a triangle much smaller than the other stands for no more than twice that.
#[test]
fn a_vertex_of_a_large_triangle_feels_a_small_one_by_twice_its_area() {
    let small = [[0.1, 0.1], [0.4, 0.1], [0.1, 0.5]].map(|[x, y]| Vector3::new(x, y, 1.0));
    let mut rest = stack(0.5).rest[..3].to_vec();
    rest.extend(small);
    let t = Topology::new(rest, 3, vec![[0, 1, 2], [3, 4, 5]], 1, (0.5, STIFFNESS));
    let pair = t.pair(Near::VertexTriangle(0, 1)).unwrap();
    assert!((pair.barrier.strength - STIFFNESS * 2.0 * 0.06).abs() < 1e-14);
}

#[test]
fn edges_are_nearly_parallel_by_a_share_of_their_lengths() {
    let t = stack(0.5);
    let near = Near::EdgeEdge(edge(&t, [1, 2]), edge(&t, [6, 8]));
    let barrier = t.pair(near).unwrap().barrier;
    assert!((barrier.parallel / (1e-3 * 25.0 * 64.0) - 1.0).abs() < 1e-14);
    assert_eq!(
        t.pair(Near::VertexTriangle(0, 2)).unwrap().barrier.parallel,
        0.0
    );
}

/// What the surface has of itself begins at half its distance at rest where that is less; what lies on it at rest is one with it.
#[test]
fn barriers_of_the_surface_with_itself_begin_below_rest() {
    for (dhat, begins) in [(0.5, 0.5), (1.0, 1.0), (1.5, 0.5), (1e5, 0.5)] {
        let t = stack(dhat);
        let edges = Near::EdgeEdge(edge(&t, [0, 1]), edge(&t, [3, 5]));
        for near in [Near::VertexTriangle(4, 0), edges] {
            assert_eq!(t.pair(near).unwrap().barrier.dhat, begins);
        }
        // Obstacles have no rest.
        let obstacle = t.pair(Near::VertexTriangle(0, 2)).unwrap();
        assert_eq!(obstacle.barrier.dhat, dhat);
    }
    // Next to nothing at rest, in shares of the barrier's distance.
    assert_eq!(stack(1e7).pair(Near::VertexTriangle(4, 0)), None);
}

#[test]
fn what_shares_a_place_or_is_left_out_does_not_touch() {
    let mut t = stack(0.5);
    assert!(t.may_touch(&[0], &[3, 4, 5]) && t.may_touch(&[6], &[0, 1, 2]));
    assert!(!t.may_touch(&[0], &[0, 1, 2]));
    assert!(!t.may_touch(&[6, 7], &[7, 8]) && !t.may_touch(&[6], &[6, 7, 8]));
    t.left_out[4] = true;
    assert!(!t.may_touch(&[0], &[3, 4, 5]) && !t.may_touch(&[4, 3], &[0, 1]));
    assert!(t.may_touch(&[4], &[6, 7, 8]) && t.may_touch(&[0], &[6, 7, 8]));
    // Doubled vertices of a seam, one of them with the other zero.
    let mut rest = stack(0.5).rest;
    rest[3] = Vector3::new(-0.0, 0.0, -0.0);
    let seam = Topology::new(rest, 6, vec![[0, 1, 2], [3, 4, 5]], 2, (0.5, STIFFNESS));
    assert!(!seam.may_touch(&[0], &[3, 4, 5]) && seam.may_touch(&[1], &[3, 4, 5]));
}

/// A triangle without area stands for a thousandth of the mean, a point of no triangle for nothing.
#[test]
fn triangles_without_area_count_for_little() {
    let mut rest = stack(0.5).rest;
    rest[5] = 0.5 * (rest[3] + rest[4]);
    rest.push(Vector3::new(0.2, 0.2, 0.4));
    let triangles = vec![[0, 1, 2], [3, 4, 5]];
    let t = Topology::new(rest, 10, triangles, 2, (0.5, STIFFNESS));
    let least = 1e-3 * 3.0;
    assert!((t.strength(5) / (STIFFNESS * least / 3.0) - 1.0).abs() < 1e-12);
    assert!((t.strength(1) / (STIFFNESS * 2.0) - 1.0).abs() < 1e-12);
    assert_eq!(t.pair(Near::VertexTriangle(9, 0)), None);
}

/// An edge without length counts as one whose square is a thousandth of the area that the pair stands for.
#[test]
fn an_edge_without_length_is_not_parallel_to_everything() {
    let mut rest = stack(0.5).rest;
    rest[5] = rest[3];
    let t = Topology::new(rest, 9, vec![[0, 1, 2], [3, 4, 5]], 2, (0.5, STIFFNESS));
    let near = Near::EdgeEdge(edge(&t, [0, 1]), edge(&t, [3, 5]));
    // Of the triangle without area, a thousandth of the mean of 3, a third.
    let area = 1e-3;
    let expected = 1e-3 * 9.0 * (1e-3 * area);
    let found = t.pair(near).unwrap().barrier.parallel;
    assert!((found / expected - 1.0).abs() < 1e-12, "{found}");
}
