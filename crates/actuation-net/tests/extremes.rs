//! Inputs and weights far beyond all that training makes: numbers stay finite, or are refused with their place.

mod common;

use actuation_net::{
    ACTUATION_SIZE, ActuationNet, Adam, AdamState, Error, NetworkConfig, Output, TensorFile, Width,
};
use common::{cotangent, lively_net, scatter};

#[track_caller]
fn assert_finite(output: &Output, gradient: &[f32]) {
    let all = output.actuation.iter().chain(&output.joint).chain(gradient);
    assert!(all.clone().all(|x| x.is_finite()));
}

#[test]
fn a_latent_code_of_ten_thousand_gives_finite_answers_and_gradients() {
    let net = lively_net(Width::W64, 3);
    let n = 300;
    let (points, bar) = (scatter(3 * n, 3), cotangent(n));
    for size in [1e4, -1e4] {
        let latent: Vec<f32> = scatter(net.config().latent, 7)
            .iter()
            .map(|z| size * z.signum())
            .collect();
        let traced = net.trace_latent(&latent, &points).unwrap();
        assert_eq!(
            *traced.output(),
            net.evaluate_latent(&latent, &points).unwrap()
        );
        let output = traced.output().clone();
        let gradient = traced.backward(&bar.actuation, &bar.joint);
        assert_finite(&output, &gradient);
        // Sines are bounded, and so is the field, whatever the code: no more than the head's weights and bias add up to.
        let largest = output.actuation.iter().fold(0.0f32, |m, x| m.max(x.abs()));
        assert!(largest < 0.3 * 65.0, "{largest}");
    }
    // The same by way of the descriptor.
    let (output, gradient) = net
        .evaluate_vjp(&[1e4, -1e4, 1e4], &points, |_| bar.clone())
        .unwrap();
    assert_finite(&output, &gradient);
}

#[test]
fn points_a_million_diagonals_away_give_finite_answers_and_gradients() {
    let net = lively_net(Width::W64, 3);
    let n = 300;
    // The diagonal of the body is at most 2 sqrt(3).
    let points: Vec<f32> = scatter(3 * n, 3).iter().map(|x| 3.5e6 * x).collect();
    let bar = cotangent(n);
    let (output, gradient) = net
        .evaluate_vjp(&[0.3, 0.6, 0.1], &points, |_| bar.clone())
        .unwrap();
    assert_finite(&output, &gradient);
    let largest = output.actuation.iter().fold(0.0f32, |m, x| m.max(x.abs()));
    assert!(largest < 0.3 * 65.0, "{largest}");
    // Neighbours change how a product is cut into blocks, so the order of its sums, and nothing else.
    let near = net.evaluate(&[0.3, 0.6, 0.1], &points[..3]).unwrap();
    for (alone, among) in near
        .actuation
        .iter()
        .zip(&output.actuation[..ACTUATION_SIZE])
    {
        assert!((alone - among).abs() < 1e-5, "{alone} {among}");
    }
}

#[test]
fn weights_of_zero_answer_with_rest_and_learn_the_bias_first() {
    let config = NetworkConfig::new(3, Width::W64);
    let fresh = ActuationNet::new(&config, 1).unwrap();
    let mut net =
        ActuationNet::from_parameters(&config, vec![0.0; fresh.parameter_count()]).unwrap();
    let n = 300;
    let (points, bar) = (scatter(3 * n, 3), cotangent(n));
    let (output, gradient) = net
        .evaluate_vjp(&[0.3, 0.6, 0.1], &points, |_| bar.clone())
        .unwrap();
    assert!(
        output
            .actuation
            .iter()
            .chain(&output.joint)
            .all(|&x| x == 0.0)
    );
    // Nothing but the last biases is reached.
    for tensor in net.parameter_layout() {
        let part = &gradient[tensor.range.clone()];
        let is_reached = part.iter().any(|&g| g != 0.0);
        let is_last = ["head.bias", "joint.2.bias"].contains(&tensor.name.as_str());
        assert_eq!(is_reached, is_last, "{}", tensor.name);
    }
    let mut state = AdamState::new(gradient.len());
    let adam = Adam::default();
    adam.step(&mut state, net.parameters_mut(), &gradient)
        .unwrap();
    let after = net.evaluate(&[0.3, 0.6, 0.1], &points).unwrap();
    let loss = |output: &Output| -> f32 {
        let pairs = output.actuation.iter().zip(&bar.actuation);
        pairs.map(|(x, b)| x * b).sum()
    };
    assert!(loss(&after) < loss(&output));
}

#[test]
fn one_weight_that_is_no_number_is_refused_at_load_with_its_tensor_and_index() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.safetensors");
    let net = lively_net(Width::W64, 3);
    for tensor in net.parameter_layout() {
        for bad in [f32::NAN, f32::INFINITY] {
            let mut values = net.parameters()[tensor.range.clone()].to_vec();
            let index = values.len() / 2;
            values[index] = bad;
            let mut file = TensorFile::new();
            net.insert_into(&mut file, "");
            file.insert_f32(&tensor.name, &tensor.shape, &values);
            file.write(&path).unwrap();
            let message = ActuationNet::load(&path).unwrap_err().to_string();
            let place = format!("entry {index} of tensor `{}` is {bad}", tensor.name);
            assert!(message.contains(&place), "{message}");
            assert!(message.contains("model.safetensors"), "{message}");
            assert!(message.contains("earlier checkpoint"), "{message}");
        }
    }
}

/// Steps of a thousand: either a step is taken and all stays finite, or it is refused and nothing changes.
#[test]
fn a_learning_rate_of_a_thousand_never_leaves_a_number_that_is_none() {
    let mut net = lively_net(Width::W64, 3);
    let n = 300;
    let (points, bar) = (scatter(3 * n, 3), cotangent(n));
    let mut state = AdamState::new(net.parameter_count());
    let adam = Adam {
        lr: 1e3,
        ..Adam::default()
    };
    let mut refused = 0;
    for _ in 0..40 {
        let before = (net.clone(), state.clone());
        let asked = net.evaluate_vjp(&[0.3, 0.6, 0.1], &points, |_| bar.clone());
        let stepped = asked.and_then(|(_, gradient)| {
            let parameters = net.parameters_mut();
            adam.step(&mut state, parameters, &gradient)
        });
        if stepped.is_err() {
            refused += 1;
            assert!(
                (&net, &state) == (&before.0, &before.1),
                "something changed"
            );
        }
        let numbers = net.parameters().into_iter();
        assert!(
            numbers
                .chain(state.m.clone())
                .chain(state.v.clone())
                .all(f32::is_finite)
        );
    }
    println!("{refused} of 40 steps were refused");
}

/// A finite gradient and a finite rate took a parameter to infinity, and only the next load told.
#[test]
fn a_step_out_of_the_range_of_f32_is_refused() {
    let adam = Adam {
        lr: 1e39,
        ..Adam::default()
    };
    let (mut state, mut x) = (AdamState::new(2), vec![1.0f32, 2.0]);
    let before = (state.clone(), x.clone());
    let found = adam.step(&mut state, &mut x, &[0.0, 0.5]);
    assert!(
        matches!(found, Err(Error::NonFiniteStep { index: 1, value: 2.0, lr }) if lr == 1e39),
        "{found:?}"
    );
    assert!(found.unwrap_err().to_string().contains("learning rate"));
    assert_eq!((state, x), before);
}
