use super::super::distance::Nearest;
use super::super::distance::tests::{Numbers, distance_at};
use super::*;

/// The first of many times at which a pair is nearer than a share of its distance at the start.
fn sampled(kind: Kind, x: &Quad, p: &Quad, kept: f64) -> Option<f64> {
    let distance = |t: f64| distance_at(kind, x, t, p);
    let start = distance(0.0);
    let times = (0..=20_000).map(|i| f64::from(i) / 20_000.0);
    times.into_iter().find(|&t| distance(t) < kept * start)
}

#[test]
fn shares_are_free_and_not_much_less_than_sampled() {
    let mut numbers = Numbers(77);
    let (mut meets, mut free) = (0, 0);
    for case in 0..600 {
        let kind = [Kind::VertexTriangle, Kind::EdgeEdge][case % 2];
        let x = numbers.quad();
        let mut p = numbers.quad();
        // Some that aim at each other.
        if case % 3 == 0 {
            let q = Nearest::of(kind, &x).q;
            p[0] -= q * 3.0;
            if kind == Kind::EdgeEdge {
                p[1] -= q * 3.0;
            }
        }
        let share = free_share(kind, &x, &p, 1.0);
        // Never beyond where the distance falls below what is kept.
        if let Some(t) = sampled(kind, &x, &p, 0.0999) {
            meets += 1;
            assert!(share <= t, "{kind:?}: {share} beyond {t}");
        }
        // And no less than where it still has a third.
        match sampled(kind, &x, &p, 0.3) {
            Some(t) => assert!(share >= 0.5 * t, "{kind:?}: {share} against {t}"),
            None => {
                free += 1;
                assert!(share > 0.99, "{kind:?}: {share}");
            }
        }
    }
    assert!(meets > 20 && free > 100, "{meets} {free}");
}

#[test]
fn what_does_not_move_against_each_other_is_free() {
    let mut numbers = Numbers(8);
    for kind in [Kind::VertexTriangle, Kind::EdgeEdge] {
        let x = numbers.quad();
        let p = [nalgebra::Vector3::new(5.0, 6.0, 7.0); 4];
        assert_eq!(free_share(kind, &x, &p, 1.0), 1.0);
    }
}

/// Only how things move against each other counts, not where they go together.
#[test]
fn a_motion_as_a_whole_changes_no_share() {
    let mut numbers = Numbers(41);
    let whole = nalgebra::Vector3::new(50.0, -30.0, 20.0);
    let mut limited = 0;
    for case in 0..60 {
        let kind = [Kind::VertexTriangle, Kind::EdgeEdge][case % 2];
        let x = numbers.quad();
        let mut p = numbers.quad();
        let q = Nearest::of(kind, &x).q;
        p[..kind.first()].iter_mut().for_each(|p| *p -= q * 3.0);
        let share = free_share(kind, &x, &p, 1.0);
        limited += usize::from(share < 1.0);
        let carried = free_share(kind, &x, &p.map(|p| p + whole), 1.0);
        assert!(
            (share - carried).abs() < 1e-6,
            "{kind:?}: {share} {carried}"
        );
    }
    assert!(limited > 20, "{limited}");
}

/// In whatever order pairs are seen, and however much one of them spares the others.
#[test]
fn the_least_share_is_that_of_the_pair_that_has_it() {
    let mut numbers = Numbers(5);
    let draw = |case: usize| {
        let kind = [Kind::VertexTriangle, Kind::EdgeEdge][case % 2];
        let (x, mut p) = (numbers.quad(), numbers.quad());
        let q = Nearest::of(kind, &x).q;
        p[..kind.first()].iter_mut().for_each(|p| *p -= q * 3.0);
        (kind, x, p)
    };
    let pairs: Vec<(Kind, Quad, Quad)> = (0..40).map(draw).collect();
    let shares = pairs
        .iter()
        .map(|(kind, x, p)| free_share(*kind, x, p, 1.0));
    let smallest = shares.fold(1.0, f64::min);
    assert!(smallest > 0.0 && smallest < 0.9);
    let see = |least: &Least, pair: &(Kind, Quad, Quad)| least.see(pair.0, &pair.1, &pair.2);
    let (forward, backward) = (Least::new(1.0), Least::new(1.0));
    pairs.iter().for_each(|pair| see(&forward, pair));
    pairs.iter().rev().for_each(|pair| see(&backward, pair));
    assert_eq!([forward.share(), backward.share()], [smallest; 2]);
    let limited = Least::new(0.5 * smallest);
    pairs.iter().for_each(|pair| see(&limited, pair));
    assert_eq!(limited.share(), 0.5 * smallest);
}
