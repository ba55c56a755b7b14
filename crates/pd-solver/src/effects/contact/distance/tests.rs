use super::*;

/// Reproducible numbers in [-1, 1) (SplitMix64).
pub(crate) struct Numbers(pub(crate) u64);

impl Numbers {
    pub(crate) fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    pub(crate) fn quad(&mut self) -> Quad {
        std::array::from_fn(|_| Vector3::from_fn(|_, _| self.next()))
    }
}

pub(crate) fn shifted(x: &Quad, t: f64, d: &Quad) -> Quad {
    std::array::from_fn(|i| x[i] + d[i] * t)
}

/// The distance of a pair once it has moved by `t` times `d`.
pub(crate) fn distance_at(kind: Kind, x: &Quad, t: f64, d: &Quad) -> f64 {
    Nearest::of(kind, &shifted(x, t, d)).squared().sqrt()
}

pub(crate) fn flat(x: &Quad) -> Gradient {
    Gradient::from_fn(|i, _| x[i / 3][i % 3])
}

/// Fourth-order central difference at zero.
pub(crate) fn slope(step: f64, mut f: impl FnMut(f64) -> f64) -> f64 {
    (8.0 * (f(step) - f(-step)) - (f(2.0 * step) - f(-2.0 * step))) / (12.0 * step)
}

/// Places in which each number of parameters is inside its range.
fn places(kind: Kind) -> Vec<Quad> {
    let mut numbers = Numbers(3);
    let (mut found, mut counts) = (Vec::new(), [0; 3]);
    for _ in 0..400 {
        let x = numbers.quad();
        let free = Nearest::of(kind, &x).free;
        if counts[free] < 5 {
            counts[free] += 1;
            found.push(x);
        }
    }
    assert_eq!(counts, [5; 3], "{kind:?}: vertices, edges and insides");
    found
}

/// The least distance over many places on both.
fn sampled(kind: Kind, x: &Quad) -> f64 {
    let steps = 60;
    let at = |i: usize| f64::from(i as u32) / f64::from(steps);
    let mut least = f64::INFINITY;
    for i in 0..=steps as usize {
        for j in 0..=steps as usize {
            let (s, t) = (at(i), at(j));
            let q = match kind {
                Kind::VertexTriangle => {
                    let (s, t) = (s, t * (1.0 - s));
                    x[0] - x[1] * (1.0 - s - t) - x[2] * s - x[3] * t
                }
                Kind::EdgeEdge => x[0] * (1.0 - s) + x[1] * s - x[2] * (1.0 - t) - x[3] * t,
            };
            least = least.min(q.norm());
        }
    }
    least
}

#[test]
fn distances_are_the_least() {
    for kind in [Kind::VertexTriangle, Kind::EdgeEdge] {
        for x in places(kind) {
            let (exact, sampled) = (Nearest::of(kind, &x).squared().sqrt(), sampled(kind, &x));
            assert!(exact <= sampled + 1e-12, "{kind:?}: {exact} {sampled}");
            assert!(sampled - exact < 0.05, "{kind:?}: {exact} {sampled}");
            let alone = squared_distance(kind, &x).sqrt();
            assert!((alone - exact).abs() <= 1e-12, "{kind:?}: {exact} {alone}");
        }
    }
}

#[test]
fn gradients_and_hessians_are_slopes() {
    let mut numbers = Numbers(11);
    for kind in [Kind::VertexTriangle, Kind::EdgeEdge] {
        for x in places(kind) {
            let (a, b) = (numbers.quad(), numbers.quad());
            let at = |t: f64, d: &Quad| Nearest::of(kind, &shifted(&x, t, d));
            let here = Nearest::of(kind, &x);
            let (exact, by_difference) = (
                here.gradient().dot(&flat(&a)),
                slope(1e-4, |t| at(t, &a).squared()),
            );
            assert!(
                (exact - by_difference).abs() < 1e-8,
                "{exact} {by_difference}"
            );
            let exact = flat(&b).dot(&(here.hessian(&x) * flat(&a)));
            let by_difference = slope(1e-4, |t| at(t, &a).gradient().dot(&flat(&b)));
            let error = (exact - by_difference).abs() / exact.abs().max(1.0);
            assert!(
                error < 1e-6,
                "{kind:?} {}: {exact} {by_difference}",
                here.free
            );
        }
    }
}

#[test]
fn the_crossing_has_its_derivatives() {
    let mut numbers = Numbers(5);
    for _ in 0..10 {
        let (x, a, b) = (numbers.quad(), numbers.quad(), numbers.quad());
        let exact = crossing_gradient(&x).dot(&flat(&a));
        let by_difference = slope(1e-3, |t| crossing(&shifted(&x, t, &a)));
        assert!((exact - by_difference).abs() < 1e-9);
        let exact = flat(&b).dot(&(crossing_hessian(&x) * flat(&a)));
        let of = |t| crossing_gradient(&shifted(&x, t, &a)).dot(&flat(&b));
        assert!((exact - slope(1e-3, of)).abs() < 1e-9);
    }
}

#[test]
fn flat_things_have_distances_too() {
    let at = |x: f64, y: f64, z: f64| Vector3::new(x, y, z);
    let point = [at(1.0, 1.0, 0.5); 4];
    let squared = |kind: Kind, x: &Quad| {
        let squared = Nearest::of(kind, x).squared();
        assert_eq!(squared_distance(kind, x), squared);
        squared
    };
    assert_eq!(squared(Kind::VertexTriangle, &point), 0.0);
    assert_eq!(squared(Kind::EdgeEdge, &point), 0.0);
    let line = [
        at(0.0, 2.0, 0.0),
        at(-1.0, 0.0, 0.0),
        at(0.5, 0.0, 0.0),
        at(1.0, 0.0, 0.0),
    ];
    assert_eq!(squared(Kind::VertexTriangle, &line), 4.0);
    let parallel = [
        at(0.0, 0.0, 0.0),
        at(1.0, 0.0, 0.0),
        at(0.5, 0.0, 3.0),
        at(2.0, 0.0, 3.0),
    ];
    assert_eq!(squared(Kind::EdgeEdge, &parallel), 9.0);
}

/// Shares of the nearest points sum to one on the first thing and to minus one on the second: the vector leads from the second to the first.
#[test]
fn nearest_points_are_means_of_corners() {
    for kind in [Kind::VertexTriangle, Kind::EdgeEdge] {
        for x in places(kind) {
            let nearest = Nearest::of(kind, &x);
            let (one, other) = nearest.beta.split_at(kind.first());
            assert!((one.iter().sum::<f64>() - 1.0).abs() < 1e-13, "{one:?}");
            assert!((other.iter().sum::<f64>() + 1.0).abs() < 1e-13, "{other:?}");
            assert!(one.iter().all(|b| *b >= 0.0) && other.iter().all(|b| *b <= 0.0));
            assert!((combine(&x, &nearest.beta) - nearest.q).norm() < 1e-10);
        }
    }
}

/// What leads across a plane, or from edge to edge, is along the common normal to the last digits, however near both sides are.
#[test]
fn the_way_across_is_along_the_normal() {
    let mut numbers = Numbers(17);
    let mut seen = [0; 2];
    for _ in 0..200 {
        let x = numbers.quad();
        // The same triangle with a point just above its middle; edges that cross in theirs, just apart.
        let normal = (x[2] - x[1]).cross(&(x[3] - x[1])).normalize();
        let middle = (x[1] + x[2] + x[3]) / 3.0;
        let above = [middle + normal * 1e-9, x[1], x[2], x[3]];
        let (u, v) = (x[1] - x[0], x[3] - x[2]);
        let across = u.cross(&v).normalize();
        let from = (x[0] + x[1]) / 2.0 - v / 2.0 + across * 1e-9;
        let crossed = [x[0], x[1], from, from + v];
        let places = [
            (Kind::VertexTriangle, above, normal),
            (Kind::EdgeEdge, crossed, across),
        ];
        for (seen, (kind, x, normal)) in seen.iter_mut().zip(places) {
            let nearest = Nearest::of(kind, &x);
            if nearest.free == 2 {
                *seen += 1;
                let aside = nearest.q.cross(&normal).norm() / nearest.q.norm();
                assert!(aside < 1e-12, "{kind:?}: {aside:e}");
            }
        }
    }
    assert!(seen.iter().all(|&count| count > 150), "{seen:?}");
}
