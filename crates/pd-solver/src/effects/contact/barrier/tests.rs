use super::super::distance::tests::{Numbers, flat, shifted, slope};
use super::super::distance::{Gradient, Nearest, Quad};
use super::*;
use nalgebra::Vector3;

#[test]
fn phi_has_its_derivatives() {
    for t in [0.01, 0.1, 0.5, 0.9, 0.999] {
        let h = 1e-3 * t;
        let [_, first, second] = phi(t);
        let by_difference = slope(h.min(1e-4), |s| phi(t + s)[0]);
        assert!(
            (first - by_difference).abs() < 1e-6 * first.abs().max(1e-3),
            "{t}"
        );
        let by_difference = slope(h.min(1e-4), |s| phi(t + s)[1]);
        assert!(
            (second - by_difference).abs() < 1e-6 * second.abs().max(1e-3),
            "{t}"
        );
    }
    assert_eq!(phi(1.0), [0.0; 3]);
    assert!(phi(0.0)[0].is_infinite());
}

#[test]
fn pressures_are_as_documented() {
    for (t, pressure) in [(0.7, 0.34), (0.5, 1.19), (0.1, 12.2)] {
        assert!(
            (-phi(t)[1] / pressure - 1.0).abs() < 0.01,
            "{t}: {}",
            -phi(t)[1]
        );
    }
}

/// Pairs at random, and edges that are nearly parallel.
fn cases() -> Vec<(Barrier, Quad)> {
    let mut numbers = Numbers(21);
    let mut cases = Vec::new();
    for kind in [Kind::VertexTriangle, Kind::EdgeEdge] {
        for _ in 0..20 {
            let barrier = Barrier {
                kind,
                strength: 0.7,
                dhat: 2.0,
                parallel: 1e-3,
            };
            cases.push((barrier, numbers.quad()));
        }
    }
    for tilt in [0.003, 0.01, 0.02] {
        let barrier = Barrier {
            kind: Kind::EdgeEdge,
            strength: 0.7,
            dhat: 0.5,
            parallel: 1e-3,
        };
        let at = |x, y, z| Vector3::new(x, y, z);
        let x = [
            at(0.0, 0.0, 0.0),
            at(1.0, 0.0, 0.0),
            at(0.1, -0.5 * tilt, 0.2),
            at(0.9, 0.8 * tilt, 0.21),
        ];
        assert!(barrier.mollifier(&x).is_some());
        cases.push((barrier, x));
    }
    cases
}

#[test]
fn pairs_have_their_derivatives() {
    let mut numbers = Numbers(31);
    let mut felt = 0;
    for (barrier, x) in cases() {
        let (a, b) = (numbers.quad(), numbers.quad());
        let Some((_, gradient)) = barrier.energy_gradient(&x) else {
            continue;
        };
        felt += 1;
        let step = 1e-5;
        let at = |t: f64, d| barrier.energy_gradient(&shifted(&x, t, d)).expect("near");
        let (exact, by_difference) = (gradient.dot(&flat(&a)), slope(step, |t| at(t, &a).0));
        let error = (exact - by_difference).abs() / exact.abs().max(1.0);
        assert!(error < 1e-7, "{barrier:?}: {exact} {by_difference}");
        let hessian = barrier.hessian(&x).expect("near");
        let exact = flat(&b).dot(&(hessian * flat(&a)));
        let by_difference = slope(step, |t| at(t, &a).1.dot(&flat(&b)));
        let error = (exact - by_difference).abs() / exact.abs().max(1.0);
        assert!(error < 1e-6, "{barrier:?}: {exact} {by_difference}");
        assert!((hessian - hessian.transpose()).norm() <= 1e-12 * hessian.norm());
    }
    assert!(felt > 30, "{felt}");
}

/// A point above the middle of a triangle, and two edges that cross, at a distance.
fn apart(kind: Kind, distance: f64) -> Quad {
    let at = |x, y, z| Vector3::new(x, y, z);
    match kind {
        Kind::VertexTriangle => [
            at(0.3, 0.3, distance),
            at(0.0, 0.0, 0.0),
            at(1.0, 0.0, 0.0),
            at(0.0, 1.0, 0.0),
        ],
        Kind::EdgeEdge => [
            at(-0.5, 0.0, distance),
            at(0.5, 0.0, distance),
            at(0.0, -0.3, 0.0),
            at(0.0, 0.7, 0.0),
        ],
    }
}

#[test]
fn a_pair_is_felt_up_to_its_distance_and_no_farther() {
    for kind in [Kind::VertexTriangle, Kind::EdgeEdge] {
        for dhat in [0.1, 0.5, 1.0, 3.0, 40.0] {
            let barrier = Barrier {
                kind,
                strength: 0.7,
                dhat,
                parallel: 1e-3,
            };
            let near = apart(kind, 0.99 * dhat);
            assert!(barrier.energy_gradient(&near).is_some_and(|(e, _)| e > 0.0));
            assert!(barrier.hessian(&near).is_some() && barrier.stiffest(&near).is_some());
            // With boxes that overlap, too.
            let mut tilted = apart(kind, 1.01 * dhat);
            for straight in [true, false] {
                assert!(barrier.energy_gradient(&tilted).is_none());
                assert!(barrier.hessian(&tilted).is_none());
                assert!(barrier.stiffest(&tilted).is_none());
                if straight {
                    let turn = nalgebra::Rotation3::from_euler_angles(0.6, 0.5, 0.3);
                    tilted = tilted.map(|x| turn * x);
                }
            }
        }
        let touching = Barrier {
            kind,
            strength: 0.7,
            dhat: 1.0,
            parallel: 1e-3,
        };
        assert!(touching.stiffest(&apart(kind, 0.0)).is_none());
    }
}

/// Moved apart as they are, two things have the second derivative that the stiffest form has, which is along the slope of their distance.
#[test]
fn the_stiffest_form_is_the_second_derivative_across_the_gap() {
    let mut felt = 0;
    for (barrier, x) in cases() {
        let Some(form) = barrier.stiffest(&x) else {
            assert!(barrier.energy_gradient(&x).is_none());
            continue;
        };
        felt += 1;
        let nearest = Nearest::of(barrier.kind, &x);
        let across = nearest.gradient().normalize();
        let along = form.dot(&across).abs();
        assert!((along / form.norm() - 1.0).abs() < 1e-12);
        let mut away = [Vector3::zeros(); 4];
        away[..barrier.kind.first()].fill(nearest.q.normalize());
        let force = |t: f64| -> Gradient {
            barrier
                .energy_gradient(&shifted(&x, t, &away))
                .expect("near")
                .1
        };
        let bend = slope(1e-5, |t| force(t).dot(&flat(&away)));
        let told = form.dot(&flat(&away)).powi(2);
        assert!(
            (told / bend - 1.0).abs() < 1e-6,
            "{barrier:?}: {told} {bend}"
        );
    }
    assert!(felt > 30, "{felt}");
}
