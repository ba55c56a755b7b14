//! The network against its formula, written out as loops over named parameters.

mod common;

use actuation_net::{ActuationNet, PlainNet, Width};
use common::{lively_net, scatter, wide};

/// Parameters by name, in f64.
struct Named<'a>(&'a ActuationNet, Vec<f64>);

impl Named<'_> {
    fn get(&self, name: &str) -> (&[f64], &[usize]) {
        let layout = self.0.parameter_layout();
        let tensor = layout.iter().find(|t| t.name == name).unwrap();
        (&self.1[tensor.range.clone()], &tensor.shape)
    }

    /// `W x + b` of the layer `name`, `W` scaled by `scale` column by column.
    fn affine(&self, name: &str, x: &[f64], scale: impl Fn(usize) -> f64) -> Vec<f64> {
        let (weight, shape) = self.get(&format!("{name}.weight"));
        let (bias, _) = self.get(&format!("{name}.bias"));
        assert_eq!(shape, [bias.len(), x.len()]);
        let row = |i: usize| &weight[i * x.len()..(i + 1) * x.len()];
        let dot = |i: usize| -> f64 {
            let terms = row(i).iter().zip(x).enumerate();
            terms.map(|(j, (w, x))| w * scale(j) * x).sum()
        };
        (0..bias.len()).map(|i| dot(i) + bias[i]).collect()
    }

    fn dense_stack(&self, name: &str, x: &[f64]) -> Vec<f64> {
        let leaky = |h: Vec<f64>| -> Vec<f64> {
            h.into_iter()
                .map(|v| if v < 0.0 { 0.01 * v } else { v })
                .collect()
        };
        let h = leaky(self.affine(&format!("{name}.0"), x, |_| 1.0));
        let h = leaky(self.affine(&format!("{name}.1"), &h, |_| 1.0));
        self.affine(&format!("{name}.2"), &h, |_| 1.0)
    }

    fn actuation(&self, latent: &[f64], point: &[f64]) -> Vec<f64> {
        let omega = f64::from(self.0.config().omega);
        let mut h = point.to_vec();
        for l in 0..4 {
            let a = self.affine(&format!("sine.{l}.modulation"), latent, |_| 1.0);
            let z = self.affine(&format!("sine.{l}"), &h, |j| omega * (1.0 + a[j]));
            h = z.into_iter().map(f64::sin).collect();
        }
        self.affine("head", &h, |_| 1.0)
    }
}

fn check(width: Width, descriptor_size: usize) {
    let net = lively_net(width, descriptor_size);
    let (descriptor, points) = (scatter(descriptor_size, 2), scatter(3 * 20, 3));
    let named = Named(&net, wide(&net.parameters()));
    let latent = named.dense_stack("encoder", &wide(&descriptor));
    let joint = named.dense_stack("joint", &latent);

    let plain = PlainNet::<f64>::from_net(&net);
    let exact = plain.evaluate(&wide(&descriptor), &wide(&points)).unwrap();
    let fused = net.evaluate(&descriptor, &points).unwrap();
    for (found, expected) in net.latent(&descriptor).unwrap().iter().zip(&latent) {
        assert!((f64::from(*found) - expected).abs() < 1e-5);
    }
    for (i, expected) in joint.iter().enumerate() {
        assert!((exact.joint[i] - expected).abs() < 1e-13);
        assert!((f64::from(fused.joint[i]) - expected).abs() < 1e-5);
    }
    for (p, point) in wide(&points).chunks(3).enumerate() {
        for (i, expected) in named.actuation(&latent, point).into_iter().enumerate() {
            let at = 6 * p + i;
            assert!((exact.actuation[at] - expected).abs() < 1e-11);
            assert!((f64::from(fused.actuation[at]) - expected).abs() < 1e-3);
        }
    }
}

#[test]
fn every_width_follows_the_formula() {
    check(Width::W64, 1);
    check(Width::W128, 23);
    check(Width::W256, 64);
}
