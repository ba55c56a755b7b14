use super::super::distance::tests::Numbers;
use super::*;

fn points(count: usize, seed: u64, size: f64) -> Vec<Vector3<f64>> {
    let mut numbers = Numbers(seed);
    let mut at = || Vector3::from_fn(|_, _| size * numbers.next());
    (0..count).map(|_| at()).collect()
}

/// Whether the moving boxes share a point at one of many moments.
fn meet_at_some_moment(a: &Moving, b: &Moving) -> bool {
    (0..=200).map(|k| f64::from(k) / 200.0).any(|t| {
        let at = |m: &Moving| [0, 1].map(|k| m.start[k] * (1.0 - t) + m.end[k] * t);
        let ([al, ah], [bl, bh]) = (at(a), at(b));
        (0..3).all(|k| al[k] <= bh[k] && bl[k] <= ah[k])
    })
}

#[test]
fn moving_boxes_meet_where_they_do_at_a_moment() {
    let (from, to) = (points(4000, 1, 1.0), points(4000, 50_000, 1.0));
    let motion = Motion {
        from: &from,
        to: &to,
    };
    let (mut met, mut missed) = (0, 0);
    for k in (0..4000).step_by(4) {
        let k = k as u32;
        let one = motion.around(&[k, k + 1], 0.05);
        let other = motion.around(&[k + 2, k + 3], 0.0);
        let meets = one.meets(&other);
        // Moments between those looked at may be missed, never the other way round.
        if meet_at_some_moment(&one, &other) {
            assert!(meets);
            met += 1;
        } else if !meets {
            missed += 1;
        }
    }
    assert!(
        met > 200 && missed > 150 && met + missed > 980,
        "{met} {missed}"
    );
}

/// Boxes with a side in common share points: all the time, before they part, and when one comes.
#[test]
fn boxes_that_touch_meet() {
    let from = [0.0, 1.0, 1.0, 2.0, 1.5].map(|x| Vector3::new(x, 0.0, 0.0));
    let to = [0.0, 1.0, 1.5, 2.0, 1.0].map(|x| Vector3::new(x, 0.0, 0.0));
    let still = Motion::at(&from);
    assert!(
        still
            .around(&[0, 1], 0.0)
            .meets(&still.around(&[2, 3], 0.0))
    );
    let moving = Motion {
        from: &from,
        to: &to,
    };
    let one = moving.around(&[0, 1], 0.0);
    for other in [[2, 3], [4, 3]] {
        let other = moving.around(&other, 0.0);
        assert!(one.meets(&other) && other.meets(&one));
    }
    assert!(!one.meets(&moving.around(&[3], 0.0)));
}

#[test]
fn a_tree_gives_what_a_loop_over_all_gives() {
    for count in [0, 1, 2, 3, 7, 300] {
        let (from, to) = (points(count + 2, 7, 1.0), points(count + 2, 9000, 0.4));
        let edges: Vec<[u32; 2]> = (0..count as u32).map(|e| [e, e + 2]).collect();
        let first = count / 3;
        let tree = Tree::new(&edges, first..count, &from);
        for motion in [
            Motion::at(&to),
            Motion {
                from: &from,
                to: &to,
            },
        ] {
            let fitted = tree.fit(&edges, &motion);
            for e in 0..count {
                let around = motion.around(&edges[e], 0.02);
                let mut found = Vec::new();
                fitted.after(0, &around, |leaf| found.push(leaf as usize));
                found.sort_unstable();
                let meets = |f: &usize| motion.around(&edges[*f], 0.0).meets(&around);
                let expected: Vec<usize> = (first..count).filter(meets).collect();
                assert_eq!(found, expected);
            }
        }
    }
}

#[test]
fn each_two_parts_are_met_once_from_one_of_them_on() {
    let x = points(202, 3, 1.0);
    let edges: Vec<[u32; 2]> = (0..200).map(|e| [e, e + 2]).collect();
    let tree = Tree::new(&edges, 0..200, &x);
    let motion = Motion::at(&x);
    let fitted = tree.fit(&edges, &motion);
    let mut found = Vec::new();
    for (place, e) in tree.leaves() {
        let around = motion.around(&edges[e as usize], 0.0);
        fitted.after(place + 1, &around, |f| found.push((e.min(f), e.max(f))));
    }
    found.sort_unstable();
    let boxes: Vec<Moving> = edges.iter().map(|e| motion.around(e, 0.0)).collect();
    let pairs = (0..200u32).flat_map(|e| (e + 1..200).map(move |f| (e, f)));
    let meet = |(e, f): &(u32, u32)| boxes[*e as usize].meets(&boxes[*f as usize]);
    let expected: Vec<(u32, u32)> = pairs.filter(meet).collect();
    assert!(expected.len() > 200);
    assert_eq!(found, expected);
}
