//! Whether files that should go together do: their units, and the order of their vertices.

use crate::error::{Result, TrainerError};
use crate::progress::note;
use crate::scene::UNNAMED_UNIT;
use crate::units::is_same_unit;
use std::path::Path;
use surface_mesh::{MorphedSurface, Surface};

/// Bounding boxes of one body in one unit differ by less than this factor, whatever its pose.
const SIZE_SLACK: f64 = 3.0;

/// How much longer the edges of a mesh become at most when its vertices take other places of the same body. In any other order
/// neighbours lie far apart, and edges are tens of times as long.
const EDGE_SLACK: f64 = 3.0;

/// Refuses a file whose own neutral shape cannot be the surface vertex for vertex: in another unit, or in another order.
///
/// # Errors
/// [`TrainerError::Unlike`]. The number of vertices must be equal.
pub fn check_same_mesh(path: &Path, file: &Surface, surface: &Surface) -> Result<()> {
    let wrong = |problem: String| {
        let path = path.to_path_buf();
        Err(TrainerError::Unlike { path, problem })
    };
    let (own, other) = (file.diagonal(), surface.diagonal());
    if !(own < SIZE_SLACK * other && other < SIZE_SLACK * own) {
        return wrong(format!(
            "its neutral shape is {own:.4} across, but the body's surface {other:.4}{}: bring both into one unit",
            likely_units(own / other)
        ));
    }
    let edges = |positions: &Surface| -> f64 {
        let x = positions.vertices();
        let corners = file
            .triangles()
            .iter()
            .flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]);
        corners
            .map(|(a, b)| (x[a as usize] - x[b as usize]).norm())
            .sum()
    };
    let ratio = edges(surface) / edges(file);
    if ratio > EDGE_SLACK {
        return wrong(format!(
            "its edges are {ratio:.0} times as long between the body's vertices of the same numbers: its vertices are in another order. \
             Export both from one mesh, without sorting or merging vertices"
        ));
    }
    Ok(())
}

/// Compares the unit that a file names with that of the scene. Only told, as coordinates decide.
pub fn check_unit(path: &Path, file: &MorphedSurface, unit: &str) {
    if let Some(own) = &file.unit
        && unit != UNNAMED_UNIT
        && !is_same_unit(own, unit)
    {
        note(&format!(
            "{} says that its unit is `{own}`, the scene that it is `{unit}`: the numbers are taken as they are, as `{unit}`",
            path.display()
        ));
    }
}

/// What a ratio of sizes looks like.
fn likely_units(ratio: f64) -> &'static str {
    let near = |factor: f64| (ratio / factor).ln().abs() < 2.0_f64.ln();
    match () {
        () if near(100.0) => " (centimetres against metres?)",
        () if near(0.01) => " (metres against centimetres?)",
        () if near(1000.0) => " (millimetres against metres?)",
        () if near(0.001) => " (metres against millimetres?)",
        () if near(10.0) => " (millimetres against centimetres?)",
        () if near(0.1) => " (centimetres against millimetres?)",
        () => "",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use surface_mesh::primitives::icosphere;

    fn message(file: &Surface) -> String {
        let checked = check_same_mesh(Path::new("units.glb"), file, &icosphere(2, 1.0));
        checked.err().map(|e| e.to_string()).unwrap_or_default()
    }

    #[test]
    fn another_pose_passes_and_other_units_and_orders_do_not() {
        let ball = icosphere(2, 1.0);
        let bent = ball
            .vertices()
            .iter()
            .map(|x| x * (1.0 + 0.5 * x.x) + x.yzx() * 0.3);
        assert_eq!(message(&ball.with_vertices(bent.collect()).unwrap()), "");
        let large = message(&icosphere(2, 100.0));
        assert!(
            large.starts_with("units.glb: ") && large.contains("centimetres against metres?"),
            "{large}"
        );
        assert!(message(&icosphere(2, 0.001)).contains("metres against millimetres?"));
        let count = ball.vertex_count() as u32;
        // Vertex i goes to place 5 i (162 places): every neighbour is elsewhere.
        let place = |i: u32| 5 * i % count;
        let mut vertices = ball.vertices().to_vec();
        (0..count).for_each(|i| vertices[place(i) as usize] = ball.vertices()[i as usize]);
        let triangles = ball.triangles().iter().map(|t| t.map(place)).collect();
        let shuffled = Surface::from_triangles(vertices, triangles).unwrap();
        let order = message(&shuffled);
        assert!(order.contains("in another order"), "{order}");
    }

    #[test]
    fn units_have_many_names() {
        assert!(is_same_unit("Meters", "m") && is_same_unit("cm", "centimetre"));
        assert!(!is_same_unit("m", "cm") && is_same_unit("furlong", "Furlong"));
    }
}
