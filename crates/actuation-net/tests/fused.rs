//! The fused f32 path: against plain f64, for every number of points, and the same bits for every number of threads.

mod common;

use actuation_net::{ActuationNet, Error, NetworkConfig, PlainNet, Width};
use common::{cotangent, lively_net, relative_error, scatter, wide};
use proptest::prelude::*;

/// Largest output error and largest relative gradient error per parameter tensor against plain f64.
fn errors(width: Width, n: usize) -> (f64, f64) {
    let net = lively_net(width, 5);
    let (descriptor, points, bar) = (scatter(5, 2), scatter(3 * n, 3), cotangent(n));
    let (output, gradient) = net
        .evaluate_vjp(&descriptor, &points, |_| bar.clone())
        .unwrap();
    let plain = PlainNet::<f64>::from_net(&net);
    let (exact, exact_gradient) = plain
        .evaluate_vjp(&wide(&descriptor), &wide(&points), |_| {
            actuation_net::OutputCotangent {
                actuation: wide(&bar.actuation),
                joint: bar.joint.map(f64::from),
            }
        })
        .unwrap();
    let pairs = output.actuation.iter().zip(&exact.actuation);
    let value = pairs.map(|(a, b)| (f64::from(*a) - b).abs());
    let slopes = net.parameter_layout().iter().map(|tensor| {
        let range = tensor.range.clone();
        relative_error(&gradient[range.clone()], &exact_gradient[range])
    });
    (value.fold(0.0, f64::max), slopes.fold(0.0, f64::max))
}

#[test]
fn fused_f32_is_close_to_plain_f64() {
    // 1300 points: several whole chunks and a part of one.
    for (width, value_bound, gradient_bound) in [
        (Width::W64, 3e-5, 1.5e-5),
        (Width::W128, 3e-5, 1.5e-5),
        (Width::W256, 3e-5, 1.5e-5),
    ] {
        let (value, gradient) = errors(width, 1300);
        println!("{width:?}: output {value:.1e}, gradient {gradient:.1e}");
        assert!(value < value_bound, "{width:?}: {value:e}");
        assert!(gradient < gradient_bound, "{width:?}: {gradient:e}");
    }
}

#[test]
fn bits_do_not_depend_on_the_number_of_threads() {
    check_bits(Width::W64, 20_557);
    check_bits(Width::W256, 3_001);
}

fn check_bits(width: Width, n: usize) {
    let net = lively_net(width, 4);
    let (descriptor, points, bar) = (scatter(4, 2), scatter(3 * n, 3), cotangent(n));
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        pool.build().unwrap().install(|| {
            net.evaluate_vjp(&descriptor, &points, |_| bar.clone())
                .unwrap()
        })
    };
    let (output, gradient) = run(1);
    for threads in [2, 3, 5, 8] {
        let (other_output, other_gradient) = run(threads);
        assert!(output == other_output, "output with {threads} threads");
        assert!(
            gradient == other_gradient,
            "gradient with {threads} threads"
        );
    }
}

#[test]
fn split_and_joined_forms_agree() {
    let net = lively_net(Width::W64, 4);
    let (descriptor, points) = (scatter(4, 2), scatter(3 * 600, 3));
    let bar = cotangent(600);
    let (output, gradient) = net
        .evaluate_vjp(&descriptor, &points, |_| bar.clone())
        .unwrap();
    let traced = net.trace(&descriptor, &points).unwrap();
    assert_eq!(traced.output(), &output);
    assert_eq!(net.evaluate(&descriptor, &points).unwrap(), output);
    assert_eq!(traced.backward(&bar.actuation, &bar.joint), gradient);
}

#[test]
fn no_points_leave_the_joint() {
    let net = lively_net(Width::W64, 4);
    let traced = net.trace(&scatter(4, 2), &[]).unwrap();
    assert!(traced.output().actuation.is_empty());
    assert!(traced.output().joint.iter().all(|v| *v != 0.0));
    let gradient = traced.backward(&[], &[1.0; 5]);
    for tensor in net.parameter_layout() {
        let moved = gradient[tensor.range.clone()].iter().any(|g| *g != 0.0);
        let of_field = tensor.name.starts_with("sine") || tensor.name.starts_with("head");
        assert_eq!(moved, !of_field, "{}", tensor.name);
    }
}

#[test]
fn one_latent_serves_all_points() {
    let net = lively_net(Width::W64, 4);
    let points = scatter(3 * 1100, 3);
    let together = net.evaluate(&scatter(4, 2), &points).unwrap();
    for p in [0, 255, 256, 1099] {
        let alone = net
            .evaluate(&scatter(4, 2), &points[3 * p..3 * p + 3])
            .unwrap();
        for i in 0..6 {
            let difference = alone.actuation[i] - together.actuation[6 * p + i];
            assert!(difference.abs() < 1e-4);
        }
    }
}

#[test]
fn bad_input_is_refused_with_its_place() {
    let net = lively_net(Width::W64, 2);
    let points = [0.0; 9];
    let found = net.evaluate(&[1.0], &points);
    assert!(matches!(
        found,
        Err(Error::DescriptorLength {
            expected: 2,
            found: 1
        })
    ));
    let found = net.latent(&[1.0, f32::NAN]);
    assert!(matches!(
        found,
        Err(Error::NonFiniteDescriptor { index: 1, .. })
    ));
    let found = net.evaluate(&[1.0, 0.0], &points[..8]);
    assert!(matches!(found, Err(Error::PointsLength { found: 8 })));
    let mut bad = points;
    bad[7] = f32::INFINITY;
    let found = net.evaluate(&[1.0, 0.0], &bad);
    assert!(matches!(
        found,
        Err(Error::NonFinitePoint {
            point: 2,
            axis: 1,
            ..
        })
    ));
}

#[test]
fn overflowing_weights_are_reported() {
    let net = lively_net(Width::W64, 2);
    let huge: Vec<f32> = net.parameters().iter().map(|p| p * 1e30).collect();
    let net = ActuationNet::from_parameters(net.config(), huge).unwrap();
    let found = net.evaluate(&[1.0, 0.5], &[0.1, 0.2, 0.3]);
    assert!(
        matches!(found, Err(Error::NonFiniteOutput { .. })),
        "{found:?}"
    );
}

#[test]
#[should_panic(expected = "6 entries per point")]
fn a_cotangent_of_the_wrong_length_panics() {
    let net = ActuationNet::new(&NetworkConfig::new(1, Width::W64), 0).unwrap();
    let traced = net.trace(&[0.0], &[0.0; 3]).unwrap();
    traced.backward(&[0.0; 5], &[0.0; 5]);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    /// The reverse pass is linear in the cotangent and sums over points: a batch equals its two parts.
    #[test]
    fn gradients_add_up_over_points(n in 2usize..1500, cut in 0.0f64..1.0, seed in 0u64..1000) {
        let net = lively_net(Width::W64, 3);
        let descriptor = scatter(3, seed);
        let points = scatter(3 * n, seed + 1);
        let bar = cotangent(n);
        let cut = ((n as f64 * cut) as usize).min(n);
        let gradient = |range: std::ops::Range<usize>, joint: [f32; 5]| {
            let traced = net.trace(&descriptor, &points[3 * range.start..3 * range.end]).unwrap();
            traced.backward(&bar.actuation[6 * range.start..6 * range.end], &joint)
        };
        let whole = gradient(0..n, bar.joint);
        let first = gradient(0..cut, bar.joint);
        let second = gradient(cut..n, [0.0; 5]);
        let sum: Vec<f64> = first
            .iter()
            .zip(&second)
            .map(|(a, b)| f64::from(*a) + f64::from(*b))
            .collect();
        prop_assert!(relative_error(&whole, &sum) < 1e-5);
    }
}
