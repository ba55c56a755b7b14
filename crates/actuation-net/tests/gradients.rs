//! Gradients against central differences in f64, through every part of the network.

mod common;

use actuation_net::{ActuationNet, Error, OutputCotangent, PlainNet, ResolutionRange, Width};
use common::{cotangent, lively_net, relative_error, scatter, wide};

const DESCRIPTOR: usize = 7;
const POINTS: usize = 24;

struct Problem {
    net: PlainNet<f64>,
    descriptor: Vec<f64>,
    points: Vec<f64>,
    bar: OutputCotangent<f64>,
}

impl Problem {
    /// The loss `<bar, output>` at other parameters.
    fn loss(&mut self, parameters: &[f64]) -> f64 {
        self.net.set_parameters(parameters).unwrap();
        let output = self.net.evaluate(&self.descriptor, &self.points).unwrap();
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        dot(&output.actuation, &self.bar.actuation) + dot(&output.joint, &self.bar.joint)
    }

    /// Central difference of the loss along `direction`.
    fn slope(&mut self, parameters: &[f64], direction: &[f64]) -> f64 {
        let h = 1e-6;
        let mut at = |t: f64| {
            let moved = parameters.iter().zip(direction).map(|(p, d)| p + t * d);
            let moved: Vec<f64> = moved.collect();
            self.loss(&moved)
        };
        (at(h) - at(-h)) / (2.0 * h)
    }
}

#[test]
fn every_parameter_tensor_has_the_right_gradient() {
    check_gradient(&lively_net(Width::W64, DESCRIPTOR), None);
}

const RANGE: ResolutionRange = ResolutionRange {
    coarse: 0.1,
    fine: 0.04,
};

/// A network that knows the spacing, with a branch that matters.
fn resolved() -> ActuationNet {
    let net = lively_net(Width::W64, DESCRIPTOR);
    let mut net = net.with_resolution(RANGE, 5).unwrap();
    let last = net.parameter_layout().iter().rev().take(2);
    let range = last.map(|t| t.range.start).min().unwrap()..net.parameter_count();
    let values = scatter(range.len(), 6);
    net.parameters_mut()[range].copy_from_slice(&values);
    net
}

#[test]
fn the_branch_that_knows_the_spacing_has_the_right_gradient() {
    check_gradient(&resolved(), Some(0.07));
}

/// The fused path knows the spacing as the plain one does, and so does its reverse.
#[test]
fn fused_and_plain_agree_on_every_grid() {
    let net = resolved();
    let (descriptor, points) = (scatter(DESCRIPTOR, 2), scatter(3 * POINTS, 3));
    let bar = cotangent(POINTS);
    let mut plain = PlainNet::<f64>::from_net(&net);
    let wide_bar = OutputCotangent {
        actuation: wide(&bar.actuation),
        joint: bar.joint.map(f64::from),
    };
    let mut seen = Vec::new();
    for spacing in [None, Some(0.1), Some(0.05), Some(0.04)] {
        plain.set_spacing(spacing);
        let (own, gradient) = plain
            .evaluate_vjp(&wide(&descriptor), &wide(&points), |_| wide_bar.clone())
            .unwrap();
        let traced = net.trace_at(&descriptor, &points, spacing).unwrap();
        let output = net.evaluate_at(&descriptor, &points, spacing).unwrap();
        assert_eq!(*traced.output(), output);
        assert!(relative_error(&output.actuation, &own.actuation) < 2e-5);
        let found = traced.backward(&bar.actuation, &bar.joint);
        assert!(relative_error(&found, &gradient) < 2e-5);
        seen.push(output);
    }
    // No spacing is the coarsest; another grid has another field, and the same jaw.
    assert_eq!(seen[0], seen[1]);
    assert_ne!(seen[1].actuation, seen[2].actuation);
    assert_ne!(seen[2].actuation, seen[3].actuation);
    assert!(seen.iter().all(|output| output.joint == seen[0].joint));
}

#[test]
fn a_new_branch_makes_no_difference_and_keeps_the_parameters() {
    let net = lively_net(Width::W64, DESCRIPTOR);
    let with = net.with_resolution(RANGE, 5).unwrap();
    let (descriptor, points) = (scatter(DESCRIPTOR, 2), scatter(3 * POINTS, 3));
    let own = net.evaluate(&descriptor, &points).unwrap();
    for spacing in [0.1, 0.06, 0.04] {
        let found = with.evaluate_at(&descriptor, &points, Some(spacing));
        assert_eq!(found.unwrap(), own);
        let without = net.evaluate_at(&descriptor, &points, Some(spacing));
        assert_eq!(without.unwrap(), own);
    }
    assert_eq!(with.parameters()[..net.parameter_count()], net.parameters());
    // What a branch has learnt does not stay in a new one.
    assert_eq!(resolved().with_resolution(RANGE, 5).unwrap(), with);
}

#[test]
fn spacings_that_are_none_are_refused() {
    let net = lively_net(Width::W64, DESCRIPTOR);
    let (descriptor, points) = (scatter(DESCRIPTOR, 2), scatter(3 * POINTS, 3));
    for spacing in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        let error = net.evaluate_at(&descriptor, &points, Some(spacing));
        assert!(matches!(error, Err(Error::Spacing { .. })));
    }
    let (infinite, nan) = (f32::INFINITY, f32::NAN);
    for (coarse, fine) in [
        (0.1, 0.1),
        (0.1, 0.2),
        (0.1, 0.0),
        (nan, 0.1),
        (infinite, 0.1),
    ] {
        let error = net.with_resolution(ResolutionRange { coarse, fine }, 1);
        assert!(
            matches!(error, Err(Error::Resolution { .. })),
            "{coarse} {fine}"
        );
    }
}

fn check_gradient(net: &ActuationNet, spacing: Option<f32>) {
    let layout = net.parameter_layout().to_vec();
    let single = cotangent(POINTS);
    let mut problem = Problem {
        net: PlainNet::from_net(net),
        descriptor: wide(&scatter(DESCRIPTOR, 2)),
        points: wide(&scatter(3 * POINTS, 3)),
        bar: OutputCotangent {
            actuation: wide(&single.actuation),
            joint: single.joint.map(f64::from),
        },
    };
    problem.net.set_spacing(spacing);
    let parameters = problem.net.parameters().to_vec();
    let bar = problem.bar.clone();
    let (_, gradient) = problem
        .net
        .evaluate_vjp(&problem.descriptor, &problem.points, |_| bar)
        .unwrap();

    let mut worst: f64 = 0.0;
    for (index, tensor) in layout.iter().enumerate() {
        let part = &gradient[tensor.range.clone()];
        let norm = part.iter().map(|g| g * g).sum::<f64>().sqrt();
        assert!(norm > 1e-6, "{} has no influence: {norm:e}", tensor.name);

        // A random direction sees every entry at once; the largest entry catches a transposed tensor.
        let mut direction = vec![0.0; parameters.len()];
        let random = wide(&scatter(part.len(), 100 + index as u64));
        direction[tensor.range.clone()].copy_from_slice(&random);
        let largest = (0..part.len())
            .max_by(|a, b| part[*a].abs().total_cmp(&part[*b].abs()))
            .unwrap();
        let mut unit = vec![0.0; parameters.len()];
        unit[tensor.range.start + largest] = 1.0;
        for direction in [direction, unit] {
            let exact: f64 = gradient.iter().zip(&direction).map(|(g, d)| g * d).sum();
            let found = problem.slope(&parameters, &direction);
            let error = (found - exact).abs() / norm;
            worst = worst.max(error);
            assert!(error < 1e-6, "{}: {found:e} for {exact:e}", tensor.name);
        }
    }
    println!("largest relative error against central differences: {worst:.1e}");
}

#[test]
fn the_latent_code_has_the_right_gradient() {
    let net = lively_net(Width::W64, DESCRIPTOR);
    let plain = PlainNet::<f64>::from_net(&net);
    let (points, bar) = (scatter(3 * POINTS, 3), cotangent(POINTS));
    let wide_points = wide(&points);
    // A code that is no descriptor's.
    let latent = scatter(net.config().latent, 8);
    let loss = |latent: &[f64]| {
        let output = plain.evaluate_latent(latent, &wide_points).unwrap();
        let pairs = output.actuation.iter().zip(&bar.actuation);
        let joint = output.joint.iter().zip(&bar.joint);
        pairs
            .chain(joint)
            .map(|(a, b)| a * f64::from(*b))
            .sum::<f64>()
    };
    let h = 1e-6;
    let slopes: Vec<f64> = (0..latent.len())
        .map(|k| {
            let at = |t: f64| {
                let mut moved = wide(&latent);
                moved[k] += t;
                loss(&moved)
            };
            (at(h) - at(-h)) / (2.0 * h)
        })
        .collect();
    let norm = slopes.iter().map(|s| s * s).sum::<f64>().sqrt();
    assert!(norm > 1e-3, "the code has no influence: {norm:e}");
    let traced = net.trace_latent(&latent, &points).unwrap();
    let gradient = traced.backward(&bar.actuation, &bar.joint);
    let error = relative_error(&gradient, &slopes);
    println!("latent gradient in f32 against central differences in f64: {error:.1e}");
    assert!(error < 2e-5, "{error:e}");
}

#[test]
fn a_descriptor_and_its_latent_code_say_the_same() {
    let net = lively_net(Width::W64, DESCRIPTOR);
    let (descriptor, points) = (scatter(DESCRIPTOR, 2), scatter(3 * POINTS, 3));
    let latent = net.latent(&descriptor).unwrap();
    let own = net.evaluate(&descriptor, &points).unwrap();
    assert_eq!(net.evaluate_latent(&latent, &points).unwrap(), own);
    let traced = net.trace_latent(&latent, &points).unwrap();
    assert_eq!(*traced.output(), own);
}

#[test]
fn latent_codes_that_do_not_fit_are_refused() {
    let net = lively_net(Width::W64, DESCRIPTOR);
    let size = net.config().latent;
    let points = scatter(3 * POINTS, 3);
    let expected = Error::LatentLength {
        expected: size,
        found: size + 1,
    };
    let long = vec![0.0; size + 1];
    assert_eq!(
        net.evaluate_latent(&long, &points).unwrap_err().to_string(),
        expected.to_string()
    );
    let mut bad = vec![0.0; size];
    bad[3] = f32::NAN;
    let message = net.trace_latent(&bad, &points).err().unwrap().to_string();
    assert!(
        message.contains("number 3 of the latent code is NaN"),
        "{message}"
    );
    assert!(net.trace_latent(&bad[..3], &points).is_err());
}
