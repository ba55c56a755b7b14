//! Networks and inputs shared by the tests.
#![allow(dead_code)]

use actuation_net::{ActuationNet, NetworkConfig, OutputCotangent, Width};

/// Numbers in `[-1, 1)` that look random and never change.
pub fn scatter(count: usize, seed: u64) -> Vec<f32> {
    let mut state = seed;
    let mut next = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        ((state >> 40) as f32) / 8_388_608.0 - 1.0
    };
    (0..count).map(|_| next()).collect()
}

/// A network in which every part matters: what starts small or zero is drawn anew and larger.
pub fn lively_net(width: Width, descriptor: usize) -> ActuationNet {
    let net = ActuationNet::new(&NetworkConfig::new(descriptor, width), 11).unwrap();
    let mut parameters = net.parameters();
    for (index, tensor) in net.parameter_layout().iter().enumerate() {
        let values = &mut parameters[tensor.range.clone()];
        let small = ["modulation", "head", "joint.2"];
        if small.iter().any(|part| tensor.name.contains(part)) {
            let bound = if tensor.name.contains("modulation") {
                0.08
            } else {
                0.3
            };
            let fresh = scatter(values.len(), index as u64);
            for (value, fresh) in values.iter_mut().zip(fresh) {
                *value = bound * fresh;
            }
        }
    }
    ActuationNet::from_parameters(net.config(), parameters).unwrap()
}

/// A cotangent with entries of both signs, of the size of a mean over `n` points.
pub fn cotangent(n: usize) -> OutputCotangent {
    let scale = 1.0 / n.max(1) as f32;
    OutputCotangent {
        actuation: scatter(6 * n, 5).into_iter().map(|v| scale * v).collect(),
        joint: [0.3, -0.2, 0.5, 0.7, -0.4],
    }
}

/// `|a - b| / |b|` in the Euclidean norm.
pub fn relative_error(a: &[f32], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    let difference: f64 = a
        .iter()
        .zip(b)
        .map(|(a, b)| (f64::from(*a) - b).powi(2))
        .sum();
    let norm: f64 = b.iter().map(|b| b * b).sum();
    (difference / norm).sqrt()
}

/// The same numbers in f64.
pub fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().map(|v| f64::from(*v)).collect()
}
