//! Poses as joint angles.

use std::collections::BTreeMap;

use nalgebra::{Rotation3, Vector3};
use serde::Deserialize;

/// Poses, and the bones that take part in them.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PoseSet {
    /// How the angles are meant, for people.
    pub convention: String,
    /// Bones that are written to the skeleton, by their names in the rig. Every other bone goes with the nearest of these among its
    /// ancestors.
    pub bones: Vec<String>,
    /// The poses, in the order of the morph targets.
    pub poses: Vec<Pose>,
}

/// One pose.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pose {
    /// Its name.
    pub name: String,
    /// Turns per bone; the others keep their place on their parent.
    pub turns: BTreeMap<String, Vec<Turn>>,
}

/// A turn about an axis of the neutral body, carried along by the parent.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Turn {
    /// The axis.
    pub axis: Axis,
    /// The angle in degrees.
    pub degrees: f64,
}

/// An axis of the neutral body: x to its left, y up, z forward.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Axis {
    /// To the left.
    X,
    /// Up.
    Y,
    /// Forward.
    Z,
}

impl PoseSet {
    /// The poses of this project: twelve, with angles written by hand.
    pub fn project() -> Self {
        serde_json::from_str(include_str!("../../data/poses.json")).expect("the file is tested")
    }
}

impl Pose {
    /// The rotation of a bone relative to its parent: its turns, one after another.
    pub fn rotation(&self, bone: &str) -> Rotation3<f64> {
        let turns = self.turns.get(bone).into_iter().flatten();
        turns.fold(Rotation3::identity(), |before, turn| {
            let axis = match turn.axis {
                Axis::X => Vector3::x_axis(),
                Axis::Y => Vector3::y_axis(),
                Axis::Z => Vector3::z_axis(),
            };
            Rotation3::from_axis_angle(&axis, turn.degrees.to_radians()) * before
        })
    }
}
