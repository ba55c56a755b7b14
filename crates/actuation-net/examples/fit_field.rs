//! Fits two analytic actuation fields with one network: the descriptor chooses which.
//!
//! Run with `cargo run --release -p actuation-net --example fit_field`.

use actuation_net::{ActuationNet, Adam, AdamState, NetworkConfig, Output, OutputCotangent, Width};

const STEPS: u32 = 300;
const SHAPES: [[f32; 2]; 2] = [[1.0, 0.0], [0.0, 1.0]];

/// The field to learn for a shape: a contraction along x that varies in space, and a shear.
fn target(shape: usize, point: &[f32]) -> [f32; 6] {
    let [x, y, z] = [point[0], point[1], point[2]];
    let wave = if shape == 0 {
        (2.0 * x + y).sin()
    } else {
        (x - 3.0 * z).cos()
    };
    [-0.3 * wave, 0.1 * y * wave, 0.0, 0.15 * wave, 0.05 * z, 0.0]
}

/// Mean squared error over all entries and its derivative.
fn loss(shape: usize, points: &[f32], output: &Output) -> (f32, OutputCotangent) {
    let wanted = points.chunks_exact(3).flat_map(|p| target(shape, p));
    let difference = output.actuation.iter().zip(wanted).map(|(b, w)| b - w);
    let difference: Vec<f32> = difference.collect();
    let count = difference.len() as f32;
    let loss = difference.iter().map(|d| d * d).sum::<f32>() / count;
    let actuation = difference.iter().map(|d| 2.0 * d / count).collect();
    let joint = [0.0; 5];
    (loss, OutputCotangent { actuation, joint })
}

fn main() -> Result<(), actuation_net::Error> {
    let side = 12;
    let coordinate = |i: usize| 2.0 * i as f32 / (side - 1) as f32 - 1.0;
    let points: Vec<f32> = (0..side * side * side)
        .flat_map(|i| [i % side, i / side % side, i / (side * side)].map(coordinate))
        .collect();

    let mut net = ActuationNet::new(&NetworkConfig::new(2, Width::W64), 1)?;
    let mut state = AdamState::new(net.parameter_count());
    for step in 0..=STEPS {
        let mut losses = [0.0; 2];
        let mut gradient = vec![0.0; net.parameter_count()];
        for (shape, descriptor) in SHAPES.iter().enumerate() {
            let traced = net.trace(descriptor, &points)?;
            let (value, bar) = loss(shape, &points, traced.output());
            losses[shape] = value;
            let part = traced.backward(&bar.actuation, &bar.joint);
            gradient.iter_mut().zip(part).for_each(|(g, p)| *g += p);
        }
        if step % 50 == 0 {
            println!(
                "step {step:3}: mean squared errors {:.3e} and {:.3e}",
                losses[0], losses[1]
            );
        }
        let decay = 1.0 - f64::from(step) / f64::from(STEPS);
        let adam = Adam {
            lr: 2e-3 * decay,
            ..Adam::default()
        };
        adam.step(&mut state, net.parameters_mut(), &gradient)?;
    }
    Ok(())
}
