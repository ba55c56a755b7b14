//! What each vertex of the surface counts.

use crate::error::{Result, TrainerError};
use crate::scene::{LossPart, Scene};
use surface_mesh::Surface;

/// What each vertex counts: its share of the surface's area, times the weights of the scene's loss; they sum to 1. The same on every
/// grid: the margin of the scene's regions is that of its own element size.
///
/// # Errors
/// When the loss names parts that do not exist, or leaves no vertex any weight.
pub fn vertex_weights(surface: &Surface, scene: &Scene) -> Result<Vec<f64>> {
    let parts = &scene.loss.weights;
    let mut weights = surface.vertex_areas();
    for (i, part) in parts.iter().enumerate() {
        let wrong = |problem| TrainerError::LossPart {
            number: i + 1,
            problem,
        };
        let chosen = chosen(part, surface, scene.mesh.element_size).map_err(wrong)?;
        for (weight, chosen) in weights.iter_mut().zip(chosen) {
            if chosen {
                *weight *= part.weight;
            }
        }
    }
    let total: f64 = weights.iter().sum();
    if total == 0.0 {
        return Err(TrainerError::LossPart {
            number: parts.len(),
            problem: "leaves no vertex any weight".into(),
        });
    }
    weights.iter_mut().for_each(|w| *w /= total);
    Ok(weights)
}

/// Which vertices a part of the loss selects, one at least.
fn chosen(
    part: &LossPart,
    surface: &Surface,
    element_size: f64,
) -> std::result::Result<Vec<bool>, String> {
    if !(part.weight.is_finite() && part.weight >= 0.0) {
        return Err(format!(
            "has the weight {}: give a finite number, zero or more",
            part.weight
        ));
    }
    let vertices = surface.vertices();
    let count = vertices.len();
    let chosen = match (part.region, part.vertices) {
        (Some(region), None) => region
            .contains(vertices, element_size)
            .map_err(|error| error.to_string())?,
        (None, Some([first, last])) if first <= last && last < count => {
            (0..count).map(|v| (first..=last).contains(&v)).collect()
        }
        (None, Some([first, last])) => {
            return Err(format!(
                "names the vertices {first} to {last}, but the surface has 0 to {}",
                count - 1
            ));
        }
        _ => return Err("needs either `region` or `vertices`".into()),
    };
    match chosen.contains(&true) {
        true => Ok(chosen),
        false => Err("selects no vertex".into()),
    }
}
