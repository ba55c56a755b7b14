//! Adam against its definition, and an exact resume through a file.

mod common;

use actuation_net::{
    ActuationNet, Adam, AdamState, Error, NetworkConfig, OutputCotangent, TensorFile, Width,
};
use common::scatter;
use proptest::prelude::*;

#[test]
fn steps_follow_the_paper() {
    // Kingma & Ba 2015, algorithm 1, for one parameter and three gradients.
    let adam = Adam {
        lr: 0.1,
        beta1: 0.5,
        beta2: 0.75,
        eps: 1e-8,
    };
    let (mut state, mut parameter) = (AdamState::new(1), [1.0f32]);
    let (mut m, mut v, mut exact) = (0.0f64, 0.0f64, 1.0f64);
    for (t, g) in [(1, 2.0f64), (2, -1.0), (3, 0.5)] {
        m = 0.5 * m + 0.5 * g;
        v = 0.75 * v + 0.25 * g * g;
        let (m_hat, v_hat) = (m / (1.0 - 0.5f64.powi(t)), v / (1.0 - 0.75f64.powi(t)));
        exact -= 0.1 * m_hat / (v_hat.sqrt() + 1e-8);
        adam.step(&mut state, &mut parameter, &[g as f32]).unwrap();
        assert!((f64::from(parameter[0]) - exact).abs() < 2e-7);
    }
    assert_eq!(state.step, 3);
}

#[test]
fn a_quadratic_is_minimised() {
    let target = scatter(50, 3);
    let (mut state, mut x) = (AdamState::new(50), vec![0.0f32; 50]);
    for step in 0..2000 {
        let adam = Adam {
            lr: 0.05 * (1.0 - f64::from(step) / 2000.0),
            ..Adam::default()
        };
        let gradient: Vec<f32> = x.iter().zip(&target).map(|(x, t)| 2.0 * (x - t)).collect();
        adam.step(&mut state, &mut x, &gradient).unwrap();
    }
    for (x, t) in x.iter().zip(&target) {
        assert!((x - t).abs() < 1e-5, "{x} for {t}");
    }
}

#[test]
fn refused_steps_change_nothing() {
    let adam = Adam::default();
    let (mut state, mut x) = (AdamState::new(3), vec![1.0f32, 2.0, 3.0]);
    adam.step(&mut state, &mut x, &[0.1, -0.2, 0.3]).unwrap();
    let before = (state.clone(), x.clone());
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e20] {
        let found = adam.step(&mut state, &mut x, &[0.1, bad, 0.3]);
        assert!(matches!(
            found,
            Err(Error::NonFiniteGradient { index: 1, .. })
        ));
    }
    let found = adam.step(&mut state, &mut x, &[0.1]);
    assert!(matches!(found, Err(Error::AdamLength { gradient: 1, .. })));
    let wrong = Adam { beta2: 1.0, ..adam };
    let found = wrong.step(&mut state, &mut x, &[0.1; 3]);
    assert!(matches!(
        found,
        Err(Error::AdamSetting { name: "beta2", .. })
    ));
    let wrong = Adam {
        lr: f64::NAN,
        ..adam
    };
    let found = wrong.step(&mut state, &mut x, &[0.1; 3]);
    assert!(matches!(found, Err(Error::AdamSetting { name: "lr", .. })));
    assert_eq!((state, x), before);
}

/// Network and optimiser on their way.
struct Run {
    net: ActuationNet,
    state: AdamState,
}

impl Run {
    fn steps(&mut self, steps: std::ops::Range<u32>) {
        let points = scatter(3 * 700, 3);
        for step in steps {
            let adam = Adam {
                lr: 1e-3 * (1.0 - f64::from(step) / 10.0),
                ..Adam::default()
            };
            let cotangent = |output: &actuation_net::Output| OutputCotangent {
                actuation: output.actuation.iter().map(|b| b - 0.1).collect(),
                joint: output.joint.map(|v| v - 0.2),
            };
            let (_, gradient) = self
                .net
                .evaluate_vjp(&[0.3, -0.6], &points, cotangent)
                .unwrap();
            adam.step(&mut self.state, self.net.parameters_mut(), &gradient)
                .unwrap();
        }
    }
}

#[test]
fn resuming_from_a_file_continues_bit_for_bit() {
    let start = || {
        let net = ActuationNet::new(&NetworkConfig::new(2, Width::W64), 4).unwrap();
        let state = AdamState::new(net.parameter_count());
        Run { net, state }
    };
    let mut straight = start();
    straight.steps(0..10);

    let mut broken = start();
    broken.steps(0..5);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint.safetensors");
    let mut file = TensorFile::new();
    broken.net.insert_into(&mut file, "net.");
    broken.state.insert_into(&mut file, "adam.");
    file.write(&path).unwrap();
    drop(broken);

    let file = TensorFile::read(&path).unwrap();
    let net = ActuationNet::from_file(&file, "net.").unwrap();
    let state = AdamState::from_file(&file, "adam.", net.parameter_count()).unwrap();
    let mut resumed = Run { net, state };
    resumed.steps(5..10);

    let bits = |values: &[f32]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
    assert_eq!(
        bits(&resumed.net.parameters()),
        bits(&straight.net.parameters())
    );
    assert_eq!(resumed.state, straight.state);
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// Without curvature in its history a step is at most the learning rate, whatever the gradient's size.
    #[test]
    fn the_first_step_is_the_learning_rate(g in prop::num::f32::NORMAL, lr in 1e-6f64..1e-1) {
        prop_assume!(g.abs() > 1e-4 && g.abs() < 1e18);
        let adam = Adam { lr, ..Adam::default() };
        let (mut state, mut x) = (AdamState::new(1), [0.0f32]);
        adam.step(&mut state, &mut x, &[g]).unwrap();
        prop_assert!((f64::from(x[0]) + lr * f64::from(g.signum())).abs() < 2e-4 * lr);
    }
}
