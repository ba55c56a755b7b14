//! The head, cut from the body, with the Face Units.

use nalgebra::Vector3;
use serde_json::json;
use surface_mesh::Surface;

use super::assets::Assets;
use crate::close::close_holes;
use crate::error::Result;
use crate::jaw::{JawMotions, jaw_json, jaw_motion};
use crate::staging::Staging;
use crate::summary::FaceSummary;
use crate::units::unit_target;

/// Shorter deltas are noise: 5 micrometres, in metres. The source's own steps are twenty times as long.
const SHORTEST_DELTA: f64 = 5e-6;
/// Lower teeth that move less are at rest: 0.1 mm, in metres.
const JAW_AT_REST: f64 = 1e-4;

/// Writes the face into a folder.
///
/// # Errors
/// As [`super::import_makehuman`].
pub fn write(assets: &mut Assets, head_cut: f64, folder: &Staging) -> Result<FaceSummary> {
    let (head, ids) = above(&assets.part("body")?, head_cut)?;
    // The body begins somewhere in the base mesh, where the units count from.
    let start = assets.group("body")?.start;
    let closed = close_holes(&head, "the neutral head")?;
    let mut targets = Vec::new();
    let mut jaw = JawMotions::new();
    let mut still = Vec::new();
    let lower = assets.group("helper-lower-teeth")?;
    let teeth = assets.mesh.vertices()[lower.clone()].to_vec();
    for unit in assets.units()? {
        let deltas = assets.unit(&unit)?;
        let own = ids.iter().map(|&id| deltas[start + id]);
        match unit_target(&unit, own, SHORTEST_DELTA, closed.holes.len()) {
            Some(target) => targets.push(target),
            None => still.push(unit.clone()),
        }
        let pairs = teeth.iter().zip(&deltas[lower.clone()]);
        let moved: Vec<Vector3<f64>> = pairs.map(|(rest, delta)| rest + delta).collect();
        if let Some(fit) = jaw_motion(&teeth, &moved, JAW_AT_REST)? {
            jaw.insert(unit, fit);
        }
    }
    for (group, file) in [
        ("helper-upper-teeth", "teeth_upper.obj"),
        ("helper-lower-teeth", "teeth_lower.obj"),
        ("helper-tongue", "tongue.obj"),
        ("helper-l-eye", "eye_l.obj"),
        ("helper-r-eye", "eye_r.obj"),
    ] {
        folder.obj(file, &assets.part(group)?)?;
    }
    let summary = FaceSummary {
        folder: folder.destination().to_path_buf(),
        vertices: closed.surface.vertex_count(),
        polygons: closed.surface.polygon_count(),
        holes: closed.holes.iter().map(Vec::len).collect(),
        units: targets.len(),
        still,
        millimetres: 1000.0,
        jaw,
    };
    folder.obj("neutral_head.obj", &closed.surface)?;
    folder.glb("train_units.glb", &closed.surface, targets)?;
    folder.json("jaw_train.json", &jaw_json(&summary.jaw, "m"))?;
    folder.compact_json("head_vertex_ids.json", &json!({ "body_vertex_ids": ids }))?;
    Ok(summary)
}

/// The polygons that lie above a height with all corners, over their own vertices, and which of the body's vertices these are.
fn above(body: &Surface, height: f64) -> Result<(Surface, Vec<usize>)> {
    let high = |corner: &u32| body.vertices()[*corner as usize].y > height;
    let kept: Vec<&[u32]> = body.polygons().filter(|p| p.iter().all(high)).collect();
    let mut own = vec![None; body.vertex_count()];
    for &corner in kept.iter().copied().flatten() {
        own[corner as usize] = Some(0);
    }
    let mut ids = Vec::new();
    for (id, slot) in own
        .iter_mut()
        .enumerate()
        .filter(|(_, slot)| slot.is_some())
    {
        *slot = Some(ids.len() as u32);
        ids.push(id);
    }
    let vertices = ids.iter().map(|&id| body.vertices()[id]).collect();
    let renumbered = kept.iter().map(|polygon| {
        let corners = polygon.iter().map(|&corner| own[corner as usize]);
        corners
            .map(|c| c.expect("every corner was numbered"))
            .collect()
    });
    Ok((Surface::from_polygons(vertices, renumbered.collect())?, ids))
}
