//! GLB out with an animation: every morph target is a frame, and the weights say when it shows.

use std::path::Path;

use serde_json::json;

use super::write::{Content, Storage, document, save};
use crate::{MorphedSurface, SurfaceError};

/// When each morph target of a surface shows.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameAnimation {
    /// Name of the animation.
    pub name: String,
    /// Seconds from the start at which each target shows alone, in the order of the targets; they rise strictly from 0 or later.
    pub times: Vec<f64>,
    /// What shows between two times: the blend of both targets if true, the earlier one if false.
    pub smooth: bool,
}

/// Why an animation cannot be written.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AnimationProblem {
    /// No morph targets to show.
    #[error("has no frames; give one morph target at least")]
    NoFrames,
    /// Not one time per target.
    #[error("has {times} times for {targets} morph targets; give one for each")]
    TimeCount {
        /// Times given.
        times: usize,
        /// Morph targets.
        targets: usize,
    },
    /// A time is negative, not finite, or not after the one before it.
    #[error(
        "shows frame {frame} at {time} s; times need be finite and 0 or more, and rise by enough for 32-bit floats"
    )]
    Time {
        /// Index of the frame, from 0.
        frame: usize,
        /// Its time, in seconds.
        time: f64,
    },
}

/// Writes a GLB file of one mesh whose morph targets show one after another, as an animation of their weights.
///
/// At `times[i]` target i has weight 1 and every other one 0; in between the weights go over linearly (glTF's `LINEAR`), or jump
/// at the next time (`STEP`). Before the first time the first target shows, after the last time the last one. Positions, deltas
/// and times are rounded to 32-bit floats. A target is kept sparse where that is smaller, so [`crate::read_gltf`] gives the same
/// surface and targets back as it does after [`crate::write_glb`].
///
/// The layout is that of glTF 2.0, sections 3.7.2.2 (morph targets) and 3.11 (animations): one sampler whose output holds a weight
/// for each target at each time, time by time.
///
/// # Errors
/// [`SurfaceError::Animation`] when times and targets do not fit, and all errors of [`crate::write_glb`]; then nothing has changed
/// under `path`.
pub fn write_animated_glb(
    path: impl AsRef<Path>,
    morphed: &MorphedSurface,
    animation: &FrameAnimation,
) -> Result<(), SurfaceError> {
    let path = path.as_ref();
    morphed.check_targets()?;
    let times = checked_times(morphed, animation).map_err(|problem| SurfaceError::Animation {
        path: path.into(),
        name: animation.name.clone(),
        problem,
    })?;
    let mut content = Content::default();
    let primitive = content.primitive(path, morphed, Storage::Smaller)?;
    let count = times.len();
    let input = content.scalars(&times, Some([times[0], times[count - 1]]));
    let mut weights = vec![0.0; count * count];
    weights.iter_mut().step_by(count + 1).for_each(|w| *w = 1.0);
    let output = content.scalars(&weights, None);
    let mut json = document(&content, primitive, morphed);
    let interpolation = if animation.smooth { "LINEAR" } else { "STEP" };
    json["animations"] = json!([{
        "name": animation.name,
        "samplers": [{ "input": input, "output": output, "interpolation": interpolation }],
        "channels": [{ "sampler": 0, "target": { "node": 0, "path": "weights" } }],
    }]);
    save(path, &json, content.bytes)
}

/// The times as 32-bit floats.
fn checked_times(
    morphed: &MorphedSurface,
    animation: &FrameAnimation,
) -> Result<Vec<f32>, AnimationProblem> {
    let (times, targets) = (animation.times.len(), morphed.targets.len());
    if targets == 0 {
        return Err(AnimationProblem::NoFrames);
    }
    if times != targets {
        return Err(AnimationProblem::TimeCount { times, targets });
    }
    let rounded: Vec<f32> = animation.times.iter().map(|&t| t as f32).collect();
    for (frame, &time) in rounded.iter().enumerate() {
        let rises = frame == 0 || time > rounded[frame - 1];
        if !(time.is_finite() && time >= 0.0 && rises) {
            return Err(AnimationProblem::Time {
                frame,
                time: animation.times[frame],
            });
        }
    }
    Ok(rounded)
}
