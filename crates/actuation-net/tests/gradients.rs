//! Gradients against central differences in f64, through every part of the network.

mod common;

use actuation_net::{Error, OutputCotangent, PlainNet, Width};
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
    let net = lively_net(Width::W64, DESCRIPTOR);
    let layout = net.parameter_layout().to_vec();
    let single = cotangent(POINTS);
    let mut problem = Problem {
        net: PlainNet::from_net(&net),
        descriptor: wide(&scatter(DESCRIPTOR, 2)),
        points: wide(&scatter(3 * POINTS, 3)),
        bar: OutputCotangent {
            actuation: wide(&single.actuation),
            joint: single.joint.map(f64::from),
        },
    };
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
