//! Opens a jaw, finds its motion again from moved points, and reads the weights of a mixed expression.
//!
//! ```text
//! cargo run --release -p face-rig --example jaw_and_smile
//! ```

use face_rig::{BlendBasis, Bounds, Joint, RigError};
use nalgebra::Vector3;

fn main() -> Result<(), RigError> {
    let joint = Joint::new(Vector3::new(0.0, 1.0, -2.0));
    let teeth: Vec<_> = (-3..=3)
        .map(|side| {
            let across = f64::from(side);
            Vector3::new(across, -3.0, 9.0 - 0.3 * across * across)
        })
        .collect();
    let opened = joint.positions([0.25, 0.02, 0.0, 0.0, 0.3], &teeth);
    let fit = joint.fit(&teeth, &opened)?;
    println!(
        "jaw: {:.6?}, left over {:.1e} cm",
        fit.parameters, fit.residual_max
    );

    let pull = vec![-Vector3::y(); teeth.len()];
    println!(
        "pulling down turns it by {:.3?}",
        joint.vjp(fit.parameters, &teeth, &pull)
    );

    let smile: Vec<_> = teeth
        .iter()
        .map(|p| Vector3::new(0.2 * p.x, 0.1 * p.x.abs(), 0.0))
        .collect();
    let pucker: Vec<_> = teeth
        .iter()
        .map(|p| Vector3::new(-0.1 * p.x, 0.0, 0.5))
        .collect();
    let mixed: Vec<_> = smile
        .iter()
        .zip(&pucker)
        .map(|(a, b)| a * 0.7 + b * 0.2)
        .collect();
    let basis = BlendBasis::new(vec![smile, pucker])?;
    let blend = basis.fit(&mixed, &Bounds::uniform(2, 0.0, 1.0), 0.0)?;
    println!(
        "smile {:.6}, pucker {:.6}, left over {:.1e} cm",
        blend.weights[0], blend.weights[1], blend.residual_max
    );
    Ok(())
}
