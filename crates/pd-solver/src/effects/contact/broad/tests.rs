//! What searches find, against a look at everything there is.

use super::super::list::tests::scattered;
use super::*;

/// What the boxes of a motion say of all there is, each two once.
fn all_near(t: &Topology, motion: &Motion, reach: f64, own: bool) -> Vec<Near> {
    let meet = |a: &[u32], b: &[u32]| motion.around(a, reach).meets(&motion.around(b, 0.0));
    let is_own = |points: &[u32]| t.is_own(points[0]);
    let is_asked = |a: &[u32], b: &[u32]| match (is_own(a), is_own(b)) {
        (true, true) => own,
        (false, false) => false,
        _ => true,
    };
    let mut all = Vec::new();
    for v in 0..t.rest.len() as u32 {
        for (f, corners) in (0..).zip(&t.triangles) {
            if is_asked(&[v], corners) && meet(&[v], corners) {
                all.push(Near::VertexTriangle(v, f));
            }
        }
    }
    for (e, ends) in (0..).zip(&t.edges) {
        for (f, others) in (0..).zip(&t.edges).skip(e as usize + 1) {
            if is_asked(ends, others) && meet(ends, others) {
                all.push(Near::EdgeEdge(e, f));
            }
        }
    }
    all
}

fn key(near: &Near) -> (u8, u32, u32) {
    match *near {
        Near::VertexTriangle(v, t) => (0, v, t),
        Near::EdgeEdge(e, f) => (1, e, f),
    }
}

/// Up to as many boxes as are allowed, of which each counts, whether it is kept or not.
#[test]
fn a_search_finds_all_whose_boxes_meet() {
    let with = scattered();
    let own = with.own_triangles;
    let corners = with.triangles[..own].to_vec();
    let points = with.rest[..with.own_points].to_vec();
    let without = Topology::new(points, with.own_points, corners, own, (0.3, 1.0));
    let mut counts = Vec::new();
    for t in [&with, &without] {
        let from: &Vec<Vector3<f64>> = &t.rest.iter().map(|x| x * 0.2).collect();
        let ways = from.iter().enumerate();
        let to: Vec<Vector3<f64>> = ways.map(|(i, x)| x * (1.0 - 0.01 * i as f64)).collect();
        for motion in [Motion::at(from), Motion { from, to: &to }] {
            for is_own in [true, false] {
                let expected = all_near(t, &motion, 0.1, is_own);
                let ask = |limit| near(t, motion, 0.1, is_own, limit, Some);
                let mut found = ask(usize::MAX).unwrap();
                found.sort_by_key(key);
                assert_eq!(found, expected);
                let count = expected.len();
                assert_eq!(ask(count).map(|all| all.len()), Some(count));
                if count > 0 {
                    assert!(ask(count - 1).is_none());
                    let none = |_| None::<()>;
                    assert!(near(t, motion, 0.1, is_own, count - 1, none).is_none());
                }
                counts.push(count);
            }
        }
    }
    // Without obstacles there is nothing but what the surface has of itself.
    assert_eq!([counts[5], counts[7]], [0; 2]);
    let others = [0, 1, 2, 3, 4, 6].map(|i| counts[i]);
    assert!(others.iter().all(|n| *n > 20), "{counts:?}");
}

#[test]
fn all_edges_that_pass_through_triangles_are_found() {
    let mut t = scattered();
    // Triangles as they are, all around one place.
    let fours = t.rest.chunks(4);
    let pulled = fours.flat_map(|four| {
        let place = four.iter().sum::<Vector3<f64>>() / 4.0;
        four.iter().map(move |x| x - 0.95 * place)
    });
    let x: Vec<Vector3<f64>> = pulled.collect();
    for left_out in [0, 4] {
        t.left_out[..left_out].fill(true);
        for own in [true, false] {
            let mut expected = Vec::new();
            for (e, ends) in (0..).zip(&t.edges) {
                for (f, corners) in (0..).zip(&t.triangles) {
                    let both = t.is_own(ends[0]) && t.is_own(corners[0]);
                    let asked = t.may_touch(ends, corners) && (own || !both);
                    let ([p, q], [a, b, c]) =
                        (ends.map(|p| x[p as usize]), corners.map(|p| x[p as usize]));
                    if asked && pierce(&[p, q], &[a, b, c]) {
                        expected.push((e, f));
                    }
                }
            }
            let mut found = piercings(&t, &x, own);
            found.sort_unstable();
            assert!(found.len() > 5, "{}", found.len());
            assert_eq!(found, expected);
        }
    }
}

/// The triangle of the unit vectors along x and y, and what goes through it or by it.
#[test]
fn a_segment_goes_through_a_triangle_or_by_it() {
    let corners = |size: f64| [[0.0, 0.0], [size, 0.0], [0.0, size]];
    let corners = |size| corners(size).map(|[x, y]| Vector3::new(x, y, 0.0));
    let along = |size, x: f64, y: f64, z: [f64; 2]| {
        pierce(&z.map(|z| Vector3::new(x, y, z)), &corners(size))
    };
    assert!(along(1.0, 0.25, 0.25, [-1.0, 1.0]) && along(1.0, 0.25, 0.25, [0.3, -2.0]));
    assert!(along(1.0, 0.499, 0.499, [-1.0, 1.0]) && along(1.0, 0.001, 0.5, [-1.0, 1.0]));
    // Beside it, above it, below it, and with an end on it.
    assert!(!along(1.0, 0.501, 0.501, [-1.0, 1.0]) && !along(1.0, -0.001, 0.5, [-1.0, 1.0]));
    for z in [
        [0.1, 1.0],
        [-0.1, -1.0],
        [0.0, 1.0],
        [-1.0, 0.0],
        [0.0, 0.0],
    ] {
        assert!(!along(1.0, 0.25, 0.25, z), "{z:?}");
    }
    // Slanting: where it crosses is what counts, a third of the way.
    let slanting = |x: f64| [Vector3::new(x, 0.2, -1.0), Vector3::new(x + 3.0, 0.2, 2.0)];
    assert!(pierce(&slanting(-0.9), &corners(1.0)) && pierce(&slanting(-0.3), &corners(1.0)));
    assert!(!pierce(&slanting(-1.1), &corners(1.0)) && !pierce(&slanting(0.1), &corners(1.0)));
}

/// Past the border by less than what positions of this size are rounded to counts as through it: by the larger of triangle and segment.
#[test]
fn the_border_of_a_triangle_is_as_wide_as_roundoff() {
    for (size, length) in [(1.0, 1.0), (1000.0, 1.0), (1.0, 1000.0), (1e-3, 1e-3)] {
        let corner = Vector3::new(0.3 * size, -0.3 * size, 0.0);
        for triangle in [
            [
                Vector3::zeros(),
                Vector3::x() * size,
                Vector3::y() * 0.01 * size,
            ],
            [
                Vector3::zeros(),
                Vector3::y() * size,
                Vector3::x() * 0.01 * size,
            ],
        ] {
            let width = 1e-12 * f64::max(size, length);
            // Off the corner that lies at the origin.
            let past = |by: f64| {
                let at = -by * corner.map(f64::abs).normalize();
                let end = Vector3::z() * 0.5 * length;
                // Wherever both are.
                let place = Vector3::new(7.0, -5.0, 3.0) * size;
                let ends = [at - end, at + end].map(|x| x + place);
                pierce(&ends, &triangle.map(|x| x + place))
            };
            assert!(past(0.5 * width) && !past(2.0 * width), "{size} {length}");
        }
    }
}
