//! The body in its poses.

use nalgebra::{Isometry3, Vector3};
use serde_json::{Map, Value, json};

use super::assets::Assets;
use super::poses::PoseSet;
use super::skeleton::Skeleton;
use crate::close::close_holes;
use crate::error::Result;
use crate::jaw::rounded;
use crate::staging::Staging;
use crate::summary::BodySummary;
use crate::units::unit_target;

/// Shorter deltas are rounding, in metres.
const SHORTEST_DELTA: f64 = 1e-9;

/// Writes the body into a folder.
///
/// # Errors
/// As [`super::import_makehuman`].
pub fn write(assets: &mut Assets, poses: &PoseSet, folder: &Staging) -> Result<BodySummary> {
    let skeleton = Skeleton::read(assets, poses)?;
    let body = assets.part("body")?;
    // The base mesh is closed already; another edition may not be.
    let closed = close_holes(&body, "the neutral body")?;
    let mut targets = Vec::new();
    let mut matrices = Map::new();
    for pose in &poses.poses {
        let motions = skeleton.motions(pose);
        let moved = skeleton.skin(&motions, body.vertices());
        let deltas = moved.iter().zip(body.vertices()).map(|(m, r)| m - r);
        targets.extend(unit_target(
            &pose.name,
            deltas,
            SHORTEST_DELTA,
            closed.holes.len(),
        ));
        let bones = skeleton.bones.iter().zip(&motions);
        let entries = bones.map(|(bone, motion)| (bone.name.clone(), rows(motion)));
        matrices.insert(pose.name.clone(), Value::Object(entries.collect()));
    }
    let summary = BodySummary {
        folder: folder.destination().to_path_buf(),
        vertices: closed.surface.vertex_count(),
        polygons: closed.surface.polygon_count(),
        poses: targets.len(),
    };
    folder.obj("neutral_body.obj", &closed.surface)?;
    folder.glb("train_poses.glb", &closed.surface, targets)?;
    let bones = skeleton.bones.iter().map(|bone| {
        let parent = bone.parent.map(|p| skeleton.bones[p].name.as_str());
        json!({
            "name": bone.name,
            "parent": parent.unwrap_or_default(),
            "head": numbers(&bone.head),
            "tail": numbers(&bone.tail),
        })
    });
    let skeleton = json!({
        "units": "m",
        "licence": "CC0-1.0",
        "bones": bones.collect::<Vec<_>>(),
        "convention": "per pose, 3x4 row-major matrix per bone: x_posed = M [x_rest;1]",
        "poses": matrices,
    });
    folder.compact_json("skeleton_train.json", &skeleton)?;
    Ok(summary)
}

fn numbers(v: &Vector3<f64>) -> Vec<f64> {
    v.iter().map(|&x| rounded(x)).collect()
}

/// The upper three rows of the matrix, row by row.
fn rows(motion: &Isometry3<f64>) -> Value {
    let matrix = motion.to_homogeneous();
    let rows = matrix.fixed_view::<3, 4>(0, 0).transpose();
    rows.iter().map(|&x| rounded(x)).collect()
}
