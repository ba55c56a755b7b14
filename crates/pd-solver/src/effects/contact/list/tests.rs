//! For which positions a list serves, and what may come near on a way.

use super::super::distance::Nearest;
use super::super::distance::tests::{Numbers, distance_at, shifted};
use super::*;

/// Away from the origin, which nothing depends on.
fn along_x(x: f64, y: f64) -> Vector3<f64> {
    Vector3::new(x + 3.0, y - 2.0, 1.0)
}

/// A list for two points on their way by 4.
fn list() -> PairList {
    PairList {
        from: vec![along_x(0.0, 0.0), along_x(0.0, 10.0)],
        to: vec![along_x(4.0, 0.0), along_x(4.0, 10.0)],
        ..PairList::default()
    }
}

#[test]
fn a_list_serves_within_half_its_margin_of_a_moment_of_its_way() {
    let list = list();
    let serves = |x: [f64; 2], off: f64| {
        let x = [along_x(x[0], off), along_x(x[1], 10.0)];
        list.serves(&x, 1.0)
    };
    for at in [0.0, 1.0, 2.7, 4.0] {
        assert!(serves([at, at], 0.0) && serves([at, at], 0.49) && serves([at, at], -0.49));
        assert!(!serves([at, at], 0.51) && !serves([at, at], -0.51));
    }
    // Before the way, beyond it, and one point ahead of the other.
    assert!(serves([-0.49; 2], 0.0) && !serves([-0.51; 2], 0.0));
    assert!(serves([4.49; 2], 0.0) && !serves([4.51; 2], 0.0));
    assert!(serves([1.6, 2.5], 0.0) && !serves([1.4, 2.5], 0.0));
    assert!(!list.serves(&[along_x(1.0, 0.0)], 1.0));
}

#[test]
fn a_list_without_a_way_serves_around_its_place() {
    let here = vec![along_x(1.0, 2.0)];
    let list = PairList {
        from: here.clone(),
        to: here,
        ..PairList::default()
    };
    for (margin, off) in [(0.5, 0.17), (1.0, 0.35), (4.0, 1.41)] {
        assert!(list.serves(&[along_x(1.0 + off, 2.0 + off)], margin));
        assert!(!list.serves(&[along_x(1.0 + 1.05 * off, 2.0 - 1.05 * off)], margin));
    }
}

#[test]
fn a_list_that_is_shortened_or_forgotten_serves_for_less() {
    let mut list = list();
    list.shorten(0.25, 1.0);
    assert_eq!(list.to, [along_x(1.0, 0.0), along_x(1.0, 10.0)]);
    assert_eq!(list.from, [along_x(0.0, 0.0), along_x(0.0, 10.0)]);
    let at = |x| [along_x(x, 0.0), along_x(x, 10.0)];
    assert!(list.serves(&at(1.4), 1.0) && !list.serves(&at(1.6), 1.0));
    list.forget();
    assert!(!list.serves(&at(1.0), 1.0));
}

/// Nothing that comes nearer than a distance is overlooked; what moves as a whole does not come nearer; what is farther than all motions is out.
#[test]
fn what_comes_near_on_a_way_is_not_overlooked() {
    let mut numbers = Numbers(19);
    let (mut within, mut out) = (0, 0);
    for case in 0..400 {
        let kind = [Kind::VertexTriangle, Kind::EdgeEdge][case % 2];
        let (from, ways) = (numbers.quad(), numbers.quad());
        let ways = ways.map(|way| way * [0.0, 0.1, 0.5][case % 3]);
        let apart = |t: f64| distance_at(kind, &from, t, &ways);
        let times = (0..=50).map(|i| f64::from(i) / 50.0);
        let least = times.map(apart).fold(f64::INFINITY, f64::min);
        let to = shifted(&from, 1.0, &ways);
        let comes = |to: &Quad, distance| comes_within(kind, &[0, 1, 2, 3], &from, to, distance);
        assert!(comes(&to, least * 1.001));
        within += 1;
        let longest = ways.iter().map(|w| w.norm()).fold(0.0, f64::max);
        // Two things that move by at most this each, and their mean by no more.
        let far = apart(0.0) - 4.001 * longest;
        if far > 0.0 {
            assert!(!comes(&to, 0.999 * far));
            out += 1;
        }
        let whole = from.map(|x| x + Vector3::new(30.0, -20.0, 10.0));
        let start = apart(0.0);
        assert!(comes(&whole, 1.001 * start) && !comes(&whole, 0.999 * start));
    }
    assert!(within > 100 && out > 100, "{within} {out}");
}

/// While a list serves nothing is searched for, and positions that are not finite are no reason to.
#[test]
fn a_list_is_made_when_it_does_not_serve() {
    let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]].map(|[x, y]| Vector3::new(x, y, 0.0));
    let above = corners.map(|x| x + Vector3::new(0.2, 0.1, 0.3));
    let rest = [corners, above].concat();
    let triangles = vec![[0, 1, 2], [3, 4, 5]];
    let topology = Topology::new(rest.clone(), 3, triangles, 1, (0.4, 1.0));
    let reach = Reach {
        own: false,
        dhat: 0.4,
        margin: 0.1,
    };
    let mut list = PairList::default();
    let mut searches = |x: &[Vector3<f64>]| {
        list.prepare(&topology, x, reach);
        assert!(!list.pairs.is_empty());
        list.searches
    };
    let moved = |by| {
        rest.iter()
            .map(|x| x + Vector3::repeat(by))
            .collect::<Vec<_>>()
    };
    assert_eq!(searches(&rest), 1);
    assert_eq!(searches(&rest), 1);
    assert_eq!(searches(&moved(0.02)), 1);
    assert_eq!(searches(&moved(f64::NAN)), 1);
    assert_eq!(searches(&moved(f64::INFINITY)), 1);
    assert_eq!(searches(&moved(0.5)), 2);
    assert_eq!(searches(&moved(0.5)), 2);
}

/// Triangles of the body and of an obstacle, spread at random.
pub(crate) fn scattered() -> Topology {
    let mut numbers = Numbers(23);
    let corners = |_| {
        let place = numbers.quad()[0];
        numbers.quad().map(|x| place + x * 0.3)
    };
    let rest: Vec<Vector3<f64>> = (0..12).flat_map(corners).collect();
    let triangles = (0..12).map(|t| [4 * t, 4 * t + 1, 4 * t + 2]).collect();
    Topology::new(rest, 24, triangles, 6, (0.3, 1.0))
}

/// All pairs of body and obstacle that are nearer than barriers and margin.
fn nearer(topology: &Topology, x: &[Vector3<f64>], margin: f64) -> usize {
    let (points, triangles) = (topology.rest.len() as u32, topology.triangles.len() as u32);
    let edges = topology.edges.len() as u32;
    let faces = (0..points).flat_map(|v| (0..triangles).map(move |t| Near::VertexTriangle(v, t)));
    let lines = (0..edges).flat_map(|e| (e + 1..edges).map(move |f| Near::EdgeEdge(e, f)));
    let near = |pair: &Pair| {
        let distance = Nearest::of(pair.barrier.kind, &pair.gather(x))
            .squared()
            .sqrt();
        let own = pair.points.iter().all(|p| topology.is_own(*p));
        !own && distance < pair.barrier.dhat + margin
    };
    let pairs = faces.chain(lines).filter_map(|near| topology.pair(near));
    pairs.filter(near).count()
}

#[test]
fn a_list_holds_what_is_nearer_than_barriers_and_margin() {
    let topology = scattered();
    let x = &topology.rest;
    let mut last = 0;
    for margin in [0.0, 0.1, 0.4] {
        let reach = Reach {
            own: false,
            dhat: 0.3,
            margin,
        };
        let mut list = PairList::default();
        assert!(list.search(&topology, x, x, reach, usize::MAX));
        let expected = nearer(&topology, x, margin);
        assert_eq!(list.pairs.len(), expected);
        assert!(expected > last, "{expected}");
        last = expected;
        // On the way there is more; not if nothing is left of it.
        let to: Vec<_> = { x.iter().enumerate() }
            .map(|(i, x)| x * (1.0 + 0.02 * i as f64))
            .collect();
        assert!(list.search(&topology, x, &to, reach, usize::MAX));
        assert!(list.pairs.len() > expected);
        list.shorten(0.0, margin);
        assert_eq!(list.pairs.len(), expected);
        // Too many boxes to look at: the list is as it was.
        assert!(!list.search(&topology, &to, &to, reach, 3));
        assert!(list.pairs.len() == expected && list.from == *x);
    }
}
