//! The explicit decoder: its gradient against central differences in f64, its start, its file, and what it refuses.

mod common;

use actuation_net::{DecoderConfig, ExplicitDecoder, NetworkConfig, TensorFile, Width};
use common::{relative_error, scatter, wide};

const CONFIG: DecoderConfig = DecoderConfig {
    descriptor: 5,
    latent: 6,
    // No multiple of the lanes that the head sums in.
    width: 13,
    elements: 7,
};

/// A decoder whose head and joint do not start small: every part matters.
fn lively() -> ExplicitDecoder {
    let decoder = ExplicitDecoder::new(&CONFIG, 3).unwrap();
    let mut parameters = decoder.parameters().to_vec();
    for tensor in decoder.parameter_layout() {
        if tensor.name.contains("head") || tensor.name.contains("joint.2") {
            let values = scatter(tensor.range.len(), tensor.range.start as u64);
            parameters[tensor.range.clone()].copy_from_slice(&values);
        }
    }
    ExplicitDecoder::from_parameters(&CONFIG, parameters).unwrap()
}

#[test]
fn every_parameter_tensor_has_the_right_gradient() {
    let single = lively();
    let bar = scatter(6 * CONFIG.elements, 5);
    let joint_bar = [0.3_f32, -0.2, 0.5, 0.7, -0.4];
    let descriptor = scatter(CONFIG.descriptor, 2);
    let parameters = wide(single.parameters());
    let loss = |parameters: &[f64]| {
        let decoder = ExplicitDecoder::from_parameters(&CONFIG, parameters.to_vec()).unwrap();
        let output = decoder.evaluate(&wide(&descriptor)).unwrap();
        let terms = output.actuation.iter().zip(&bar);
        let of_joint = output.joint.iter().zip(&joint_bar);
        let sum = |s: f64, (a, b): (&f64, &f32)| s + a * f64::from(*b);
        terms.chain(of_joint).fold(0.0, sum)
    };
    let twin = ExplicitDecoder::from_parameters(&CONFIG, parameters.clone()).unwrap();
    let traced = twin.trace(&wide(&descriptor)).unwrap();
    let gradient = traced.backward(&wide(&bar), &joint_bar.map(f64::from));
    assert_eq!(gradient.len(), parameters.len());
    for tensor in twin.parameter_layout() {
        let direction = wide(&scatter(tensor.range.len(), 9));
        // The loss is piecewise linear in one tensor: a longer step costs nothing but corners.
        let h = 1e-5;
        let at = |step: f64| {
            let mut moved = parameters.clone();
            for (p, d) in moved[tensor.range.clone()].iter_mut().zip(&direction) {
                *p += step * d;
            }
            loss(&moved)
        };
        let slope = (at(h) - at(-h)) / (2.0 * h);
        let part = &gradient[tensor.range.clone()];
        let exact: f64 = part.iter().zip(&direction).map(|(g, d)| g * d).sum();
        assert!(
            (slope - exact).abs() < 1e-6 * exact.abs().max(1e-3),
            "{}: {slope} {exact}",
            tensor.name
        );
        assert!(exact != 0.0, "{} does not matter", tensor.name);
    }
    // What trains is the same in single precision.
    let traced = single.trace(&descriptor).unwrap();
    let trained = traced.backward(&bar, &joint_bar);
    assert!(relative_error(&trained, &gradient) < 1e-5);
}

#[test]
fn a_new_decoder_leaves_the_body_nearly_at_rest() {
    let decoder = ExplicitDecoder::new(&CONFIG, 1).unwrap();
    let output = decoder.evaluate(&[1.0, 0.0, 0.5, 0.0, 1.0]).unwrap();
    assert_eq!(output.actuation.len(), 6 * CONFIG.elements);
    let largest = |values: &[f32]| values.iter().fold(0.0_f32, |m, x| m.max(x.abs()));
    assert!(largest(&output.actuation) < 0.1 && largest(&output.joint) < 0.1);
    assert!(output.actuation.iter().all(|&b| b != 0.0));
    assert_eq!(decoder, ExplicitDecoder::new(&CONFIG, 1).unwrap());
    assert_ne!(decoder, ExplicitDecoder::new(&CONFIG, 2).unwrap());
}

#[test]
fn its_encoder_and_joint_are_those_of_the_field() {
    let field = NetworkConfig {
        latent: CONFIG.latent,
        ..NetworkConfig::new(CONFIG.descriptor, Width::W64)
    };
    let shapes = |layout: Vec<actuation_net::ParameterTensor>| -> Vec<_> {
        let shared = |name: &str| name.starts_with("encoder") || name.starts_with("joint");
        let shared = layout.into_iter().filter(|t| shared(&t.name));
        shared.map(|t| (t.name, t.shape)).collect()
    };
    let of_decoder = shapes(CONFIG.parameter_layout());
    assert_eq!(of_decoder, shapes(field.parameter_layout()));
    assert_eq!(of_decoder.len(), 12);
}

#[test]
fn a_file_gives_the_decoder_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("decoder.safetensors");
    let decoder = lively();
    let mut file = TensorFile::new();
    decoder.insert_into(&mut file, "decoder.");
    file.write(&path).unwrap();
    let read = TensorFile::read(&path).unwrap();
    assert_eq!(
        ExplicitDecoder::from_file(&read, "decoder.").unwrap(),
        decoder
    );
    let other = ExplicitDecoder::from_file(&read, "field.").unwrap_err();
    assert!(other.to_string().contains("field.config"), "{other}");
}

#[test]
fn bad_sizes_and_inputs_are_refused() {
    let refused = |config: DecoderConfig, part: &str| {
        let message = ExplicitDecoder::new(&config, 1).unwrap_err().to_string();
        assert!(message.contains(part), "{message}");
    };
    refused(DecoderConfig { width: 0, ..CONFIG }, "1 to 4096");
    let wide = DecoderConfig {
        width: 5000,
        ..CONFIG
    };
    refused(wide, "decoder width 5000");
    let empty = DecoderConfig {
        elements: 0,
        ..CONFIG
    };
    refused(empty, "0 elements");
    let large = DecoderConfig {
        descriptor: 65,
        ..CONFIG
    };
    refused(large, "1 to 64");
    let decoder = lively();
    let message = |descriptor: &[f32]| decoder.evaluate(descriptor).unwrap_err().to_string();
    assert!(message(&[1.0]).contains("has 1 basis weights"));
    assert!(message(&[f32::NAN; 5]).contains("basis weight 0"));
    let few = ExplicitDecoder::from_parameters(&CONFIG, vec![0.0_f32; 3]);
    assert!(few.unwrap_err().to_string().contains("3 parameters"));
}
