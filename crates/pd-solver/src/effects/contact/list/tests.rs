//! For which positions a list serves, and what may come near on a way.

use super::super::distance::tests::{Numbers, shifted};
use super::*;

fn along_x(x: f64, y: f64) -> Vector3<f64> {
    Vector3::new(x, y, 0.0)
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
    assert!(list.serves(&[along_x(1.2, 2.2)], 1.0));
    assert!(!list.serves(&[along_x(1.4, 2.4)], 1.0));
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
        let apart = |t: f64| {
            Nearest::of(kind, &shifted(&from, t, &ways))
                .squared()
                .sqrt()
        };
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
