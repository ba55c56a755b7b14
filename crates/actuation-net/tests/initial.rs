//! Freshly drawn networks: their ranges, where they start and what the configuration says about them.

mod common;

use actuation_net::{ActuationNet, Error, NetworkConfig, Width};
use common::scatter;

fn new(descriptor: usize, width: Width, seed: u64) -> ActuationNet {
    ActuationNet::new(&NetworkConfig::new(descriptor, width), seed).unwrap()
}

/// Largest magnitude and root mean square of a tensor.
fn spread(net: &ActuationNet, name: &str) -> (f32, f32) {
    let tensor = net.parameter_layout().iter().find(|t| t.name == name);
    let values = &net.parameters()[tensor.unwrap().range.clone()];
    let largest = values.iter().fold(0.0f32, |m, v| m.max(v.abs()));
    let square: f32 = values.iter().map(|v| v * v).sum();
    (largest, (square / values.len() as f32).sqrt())
}

#[test]
fn layers_start_in_their_documented_ranges() {
    let net = new(23, Width::W128, 1);
    let he = |n: f32| (6.0 / n).sqrt();
    for (name, bound) in [
        ("encoder.0.weight", he(23.0)),
        ("encoder.1.weight", he(64.0)),
        ("encoder.1.bias", 1.0 / 8.0),
        ("sine.0.weight", 1.0 / 3.0),
        ("sine.0.bias", std::f32::consts::PI),
        ("sine.1.weight", he(128.0) / 30.0),
        ("sine.3.bias", 30.0 / 128f32.sqrt()),
        ("sine.2.modulation.weight", 0.01 * he(32.0)),
        ("head.weight", 0.01 * he(128.0)),
        ("joint.1.weight", he(32.0)),
        ("joint.2.weight", 0.01 * he(32.0)),
    ] {
        let (largest, rms) = spread(&net, name);
        assert!(largest <= bound, "{name}: {largest} above {bound}");
        let uniform = bound / 3f32.sqrt();
        assert!(
            (rms / uniform - 1.0).abs() < 0.2,
            "{name}: {rms} for {uniform}"
        );
    }
    for name in ["sine.1.modulation.bias", "head.bias"] {
        assert_eq!(spread(&net, name).0, 0.0);
    }
}

#[test]
fn the_first_layer_follows_the_descriptor_that_is_used() {
    for descriptor in [1, 7, 64] {
        let net = new(descriptor, Width::W64, 3);
        assert_eq!(net.parameter_layout()[0].shape, [64, descriptor]);
        let (largest, _) = spread(&net, "encoder.0.weight");
        let bound = (6.0 / descriptor as f32).sqrt();
        assert!(largest <= bound && largest > 0.8 * bound);
    }
}

#[test]
fn a_new_network_starts_near_the_passive_body() {
    for width in [Width::W64, Width::W128, Width::W256] {
        let net = new(23, width, 5);
        let output = net.evaluate(&scatter(23, 1), &scatter(3 * 500, 2)).unwrap();
        let largest = output.actuation.iter().fold(0.0f32, |m, v| m.max(v.abs()));
        assert!(largest < 0.1 && largest > 1e-3, "{width:?}: {largest}");
        assert!(output.joint.iter().all(|v| v.abs() < 0.1), "{output:?}");
    }
}

#[test]
fn the_seed_decides() {
    let (a, b, c) = (
        new(3, Width::W64, 1),
        new(3, Width::W64, 1),
        new(3, Width::W64, 2),
    );
    assert_eq!(a, b);
    assert_ne!(a.parameters(), c.parameters());
    assert!(a.parameters().iter().all(|p| p.is_finite()));
}

#[test]
fn the_layout_tiles_the_flat_vector() {
    let config = NetworkConfig::new(23, Width::W128);
    let layout = config.parameter_layout();
    let mut end = 0;
    for tensor in &layout {
        assert_eq!(tensor.range.start, end);
        assert_eq!(tensor.range.len(), tensor.shape.iter().product::<usize>());
        end = tensor.range.end;
    }
    assert_eq!(end, new(23, Width::W128, 0).parameter_count());
    let names: std::collections::BTreeSet<_> = layout.iter().map(|t| &t.name).collect();
    assert_eq!(names.len(), layout.len());
}

#[test]
fn configurations_read_and_refuse() {
    let config: NetworkConfig = serde_json::from_str(r#"{"descriptor":5,"width":128}"#).unwrap();
    assert_eq!(config, NetworkConfig::new(5, Width::W128));
    let text = serde_json::to_string(&config).unwrap();
    assert_eq!(
        serde_json::from_str::<NetworkConfig>(&text).unwrap(),
        config
    );
    let found = serde_json::from_str::<NetworkConfig>(r#"{"descriptor":5,"width":100}"#);
    assert!(found.unwrap_err().to_string().contains("64, 128 or 256"));
    let found = serde_json::from_str::<NetworkConfig>(r#"{"descriptor":5,"width":64,"omegga":1}"#);
    assert!(found.unwrap_err().to_string().contains("omegga"));

    let refused = |change: fn(&mut NetworkConfig)| {
        let mut config = NetworkConfig::new(5, Width::W64);
        change(&mut config);
        ActuationNet::new(&config, 0).unwrap_err()
    };
    assert!(matches!(
        refused(|c| c.descriptor = 65),
        Error::DescriptorSize { .. }
    ));
    assert!(matches!(
        refused(|c| c.descriptor = 0),
        Error::DescriptorSize { .. }
    ));
    assert!(matches!(
        refused(|c| c.latent = 0),
        Error::LatentSize { .. }
    ));
    assert!(matches!(
        refused(|c| c.omega = f32::NAN),
        Error::Omega { .. }
    ));
    assert!(matches!(refused(|c| c.omega = 0.0), Error::Omega { .. }));
}

#[test]
fn parameters_are_set_whole_or_not_at_all() {
    let mut net = new(2, Width::W64, 1);
    let before = net.clone();
    let found = net.set_parameters(&[0.0; 3]);
    assert!(matches!(found, Err(Error::ParameterCount { found: 3, .. })));
    let mut bad = net.parameters();
    let head = net
        .parameter_layout()
        .iter()
        .find(|t| t.name == "head.bias");
    bad[head.unwrap().range.start + 2] = f32::NAN;
    let found = net.set_parameters(&bad);
    assert!(
        matches!(&found, Err(Error::NonFiniteParameter { tensor, index: 2, .. }) if tensor == "head.bias"),
        "{found:?}"
    );
    assert_eq!(net, before);
}

#[test]
fn networks_move_between_threads() {
    fn shared<T: Send + Sync>() {}
    shared::<ActuationNet>();
    shared::<actuation_net::PlainNet<f64>>();
    shared::<actuation_net::Error>();
}
