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

/// A limit cuts a share, and changes nothing else.
#[test]
fn a_share_within_a_limit_is_the_smaller_of_both() {
    let mut numbers = Numbers(63);
    let (mut below, mut above) = (0, 0);
    for case in 0..400 {
        let kind = [Kind::VertexTriangle, Kind::EdgeEdge][case % 2];
        let (x, mut p) = (numbers.quad(), numbers.quad());
        let q = Nearest::of(kind, &x).q;
        p[..kind.first()].iter_mut().for_each(|p| *p -= q * 3.0);
        let share = free_share(kind, &x, &p, 1.0);
        for limit in [0.0, 0.1, 0.3, 0.6] {
            assert_eq!(free_share(kind, &x, &p, limit), share.min(limit));
            below += usize::from(share < limit);
            above += usize::from(share > limit);
        }
    }
    assert!(below > 50 && above > 50, "{below} {above}");
}

/// A vertex straight above a triangle by a half, that falls by one and a half, stops where a tenth is left; and so do edges.
#[test]
fn what_falls_straight_stops_at_a_tenth() {
    let vector = nalgebra::Vector3::new;
    let down = vector(0.0, 0.0, -1.5);
    let still = nalgebra::Vector3::zeros();
    let corners = [
        vector(0.0, 0.0, 0.0),
        vector(1.0, 0.0, 0.0),
        vector(0.0, 1.0, 0.0),
    ];
    let face = [vector(0.2, 0.3, 0.5), corners[0], corners[1], corners[2]];
    let lines = [
        vector(0.3, -1.0, 0.5),
        vector(0.3, 1.0, 0.5),
        corners[0],
        corners[1],
    ];
    let share = |kind, x: &Quad, p: &Quad| free_share(kind, x, p, 1.0);
    let of_face = share(Kind::VertexTriangle, &face, &[down, still, still, still]);
    let of_lines = share(Kind::EdgeEdge, &lines, &[down, down, still, still]);
    assert!((of_face - 0.3).abs() < 1e-12 && (of_lines - 0.3).abs() < 1e-12);
}

/// Where the distance is next to nothing its roundoff is no guide: a pair that is so near hardly moves, even along each other.
#[test]
fn what_all_but_touches_hardly_moves() {
    let vector = nalgebra::Vector3::new;
    let corners = [
        vector(0.0, 0.0, 0.0),
        vector(4.0, 0.0, 4.0),
        vector(0.0, 4.0, 0.0),
    ];
    let along = vector(1.0, 0.0, 1.0);
    let still = nalgebra::Vector3::zeros();
    let above = |distance: f64| {
        let vertex = vector(1.0 - distance, 1.0, 1.0 + distance);
        let x = [vertex, corners[0], corners[1], corners[2]];
        free_share(Kind::VertexTriangle, &x, &[along, still, still, still], 1.0)
    };
    assert!(above(1e-13) > 0.0 && above(1e-13) < 5e-13);
    assert!(above(0.3) > 0.99);
}

/// Boxes around two ways, of which one is above, below or beside the other.
#[test]
fn boxes_of_ways_are_apart_by_the_largest_gap() {
    let mut numbers = Numbers(29);
    let mut sides = [[0; 2]; 3];
    for case in 0..3000 {
        let kind = [Kind::VertexTriangle, Kind::EdgeEdge][case % 2];
        let (x, p) = (numbers.quad(), numbers.quad().map(|p| p * 0.5));
        let (mut gap, mut side) = (f64::NEG_INFINITY, (0, 0));
        for axis in 0..3 {
            let ends = |i: usize| [x[i][axis], x[i][axis] + p[i][axis]];
            let all = |from: usize, to: usize| (from..to).flat_map(ends).collect::<Vec<f64>>();
            let (one, other) = (all(0, kind.first()), all(kind.first(), 4));
            let low = |all: &[f64]| all.iter().copied().fold(f64::INFINITY, f64::min);
            let high = |all: &[f64]| all.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            for (k, apart) in [low(&one) - high(&other), low(&other) - high(&one)]
                .into_iter()
                .enumerate()
            {
                if apart > gap {
                    (gap, side) = (apart, (axis, k));
                }
            }
        }
        assert!(!apart(kind, &x, &p, gap.abs() * 1.001));
        if gap > 0.0 {
            sides[side.0][side.1] += 1;
            assert!(apart(kind, &x, &p, gap * 0.999));
        } else {
            assert!(!apart(kind, &x, &p, 0.0));
        }
    }
    assert!(sides.iter().flatten().all(|n| *n > 20), "{sides:?}");
}
