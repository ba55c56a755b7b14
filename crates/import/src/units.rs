//! Expression units as sparse morph targets.

use nalgebra::Vector3;
use surface_mesh::MorphTarget;

/// The deltas of a unit over a closed surface: those shorter than `threshold` become zero, so that a file need not hold them, and the
/// `added` vertices behind stay where they are. `None` for a unit that moves nothing.
pub fn unit_target(
    name: &str,
    deltas: impl Iterator<Item = Vector3<f64>>,
    threshold: f64,
    added: usize,
) -> Option<MorphTarget> {
    let kept = deltas.map(|delta| {
        if delta.norm() < threshold {
            Vector3::zeros()
        } else {
            delta
        }
    });
    let mut deltas: Vec<Vector3<f64>> = kept.collect();
    deltas.resize(deltas.len() + added, Vector3::zeros());
    let moves = deltas.iter().any(|delta| *delta != Vector3::zeros());
    moves.then(|| MorphTarget {
        name: name.into(),
        deltas,
    })
}
