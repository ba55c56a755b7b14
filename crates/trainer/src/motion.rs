//! What moves in a scene that is simulated without a network: keys in time for muscles, shapes, what is held, what is touched, and loads.

use crate::generated::Problem;
use hex_mesh::NodeRegion;
use nalgebra::{Rotation3, Vector3};
use pd_solver::EffectSpec;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The motion of a scene, its table `motion`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MotionSettings {
    /// Frames, the first at time zero.
    pub frames: usize,
    /// Frames per second.
    #[serde(default = "default_rate")]
    pub rate: f64,
    /// Whether a body with inertia begins at rest under its loads, and not in the shape of the surface.
    #[serde(default)]
    pub settled: bool,
    /// Kinds of effects that the picture is drawn without, too.
    #[serde(default)]
    pub without: Vec<String>,
    /// Muscles, moved by their names like shapes.
    #[serde(default, rename = "muscle")]
    pub muscles: Vec<Muscle>,
    /// What there is at some frames; linear between them, constant before the first and behind the last.
    #[serde(default, rename = "key")]
    pub keys: Vec<Key>,
    /// Where the picture looks: along this direction, with y up. Chosen by the body where not given.
    pub view: Option<[f64; 3]>,
    /// What the picture shows, by vertices of the surface; all where not given.
    pub shown: Option<NodeRegion>,
}

/// Flesh that stretches or contracts alike.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Muscle {
    /// Its name.
    pub name: String,
    /// The samples that belong to it; all where not given.
    pub region: Option<NodeRegion>,
    /// Actuation b at weight 1: entries 11, 12, 13, 22, 23, 33 of A - I.
    pub b: [f64; 6],
}

/// What there is at a frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Key {
    /// The frame, from 1.
    pub frame: usize,
    /// Weights of muscles and shapes; what is not named weighs 0.
    #[serde(default)]
    pub weights: BTreeMap<String, f64>,
    /// How what is held is moved.
    #[serde(default)]
    pub held: Placement,
    /// How the surfaces that may be touched are moved.
    #[serde(default)]
    pub obstacles: Placement,
    /// Factors on the loads by kinds of effects (gravity, force, wind, pressure); 1 for what is not named.
    #[serde(default)]
    pub loads: BTreeMap<String, f64>,
}

/// A rigid motion.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Placement {
    /// Rotation vector in degrees: axis times angle.
    pub turn: [f64; 3],
    /// The point that it turns about.
    pub about: [f64; 3],
    /// Shift after that, in the scene's unit.
    pub shift: [f64; 3],
}

impl Placement {
    /// Where it takes a point.
    pub fn apply(&self, x: &Vector3<f64>) -> Vector3<f64> {
        if *self == Self::default() {
            return *x;
        }
        let about = Vector3::from(self.about);
        let turn = Rotation3::new(Vector3::from(self.turn).map(f64::to_radians));
        turn * (x - about) + about + Vector3::from(self.shift)
    }

    fn between(&self, to: &Self, t: f64) -> Self {
        let mix = |a: [f64; 3], b: [f64; 3]| std::array::from_fn(|i| a[i] + t * (b[i] - a[i]));
        Self {
            turn: mix(self.turn, to.turn),
            about: mix(self.about, to.about),
            shift: mix(self.shift, to.shift),
        }
    }
}

/// Kinds of effects that have loads.
const LOADS: [&str; 4] = ["gravity", "force", "wind", "pressure"];

impl MotionSettings {
    /// What is wrong with them, for a scene of these effects.
    pub(crate) fn problem(&self, effects: &[EffectSpec]) -> Option<Problem> {
        if self.frames == 0 || self.frames > 10_000 {
            return Some(("motion.frames", self.frames.to_string(), "give 1 to 10000"));
        }
        if !(0.01..=1000.0).contains(&self.rate) {
            return Some((
                "motion.rate",
                self.rate.to_string(),
                "give 0.01 to 1000 frames per second",
            ));
        }
        if let Some(kind) = self
            .without
            .iter()
            .find(|kind| !effects.iter().any(|e| e.kind() == *kind))
        {
            let mend = "name kinds of effects that the scene lists";
            return Some(("motion.without", format!("`{kind}`"), mend));
        }
        if self.without.iter().any(|kind| kind == "elasticity") {
            let mend = "nothing holds together without it: name another effect";
            return Some(("motion.without", "`elasticity`".into(), mend));
        }
        let frames: Vec<usize> = self.keys.iter().map(|k| k.frame).collect();
        if frames.windows(2).any(|w| w[0] >= w[1]) || frames.contains(&0) {
            return Some((
                "motion.key.frame",
                format!("{frames:?}"),
                "give rising frames from 1",
            ));
        }
        for key in &self.keys {
            let places = [key.held, key.obstacles].into_iter();
            let numbers = places.flat_map(|p| [p.turn, p.about, p.shift].concat());
            let others = key.weights.values().chain(key.loads.values()).copied();
            if let Some(value) = numbers.chain(others).find(|x| !x.is_finite()) {
                return Some(("motion.key", value.to_string(), "give finite numbers"));
            }
            if let Some(kind) = key.loads.keys().find(|k| !LOADS.contains(&k.as_str())) {
                let mend = "loads are those of gravity, force, wind and pressure";
                return Some(("motion.key.loads", format!("`{kind}`"), mend));
            }
        }
        for (i, muscle) in self.muscles.iter().enumerate() {
            if self.muscles[..i].iter().any(|m| m.name == muscle.name) {
                let mend = "give every muscle a name of its own";
                return Some((
                    "motion.muscle.name",
                    format!("`{}` twice", muscle.name),
                    mend,
                ));
            }
            if let Some(value) = muscle.b.iter().find(|b| !b.is_finite()) {
                return Some(("motion.muscle.b", value.to_string(), "give finite numbers"));
            }
        }
        None
    }

    /// All names that keys weigh.
    pub(crate) fn weighed(&self) -> Vec<&str> {
        let mut names: Vec<&str> = Vec::new();
        for name in self.keys.iter().flat_map(|k| k.weights.keys()) {
            if !names.contains(&name.as_str()) {
                names.push(name);
            }
        }
        names
    }

    /// What there is at a frame, from 1.
    pub(crate) fn at(&self, frame: usize) -> Key {
        let after = self.keys.partition_point(|k| k.frame <= frame);
        let none = Key {
            frame,
            weights: BTreeMap::new(),
            held: Placement::default(),
            obstacles: Placement::default(),
            loads: BTreeMap::new(),
        };
        match (
            after.checked_sub(1).map(|i| &self.keys[i]),
            self.keys.get(after),
        ) {
            (None, None) => none,
            (Some(key), None) | (None, Some(key)) => Key {
                frame,
                ..key.clone()
            },
            (Some(a), Some(b)) => {
                let t = (frame - a.frame) as f64 / (b.frame - a.frame) as f64;
                let mix = |a: &BTreeMap<String, f64>, b: &BTreeMap<String, f64>, missing: f64| {
                    let names = a.keys().chain(b.keys());
                    let value = |map: &BTreeMap<String, f64>, name| {
                        map.get(name).copied().unwrap_or(missing)
                    };
                    names
                        .map(|n| (n.clone(), (1.0 - t) * value(a, n) + t * value(b, n)))
                        .collect()
                };
                Key {
                    frame,
                    weights: mix(&a.weights, &b.weights, 0.0),
                    held: a.held.between(&b.held, t),
                    obstacles: a.obstacles.between(&b.obstacles, t),
                    loads: mix(&a.loads, &b.loads, 1.0),
                }
            }
        }
    }
}

fn default_rate() -> f64 {
    24.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn motion(text: &str) -> MotionSettings {
        toml::from_str(text).unwrap()
    }

    #[test]
    fn keys_are_linear_between_and_constant_outside() {
        let motion = motion(
            "frames = 9\n[[key]]\nframe = 3\nweights = { a = 1 }\n\
             [[key]]\nframe = 7\nweights = { b = 1 }\nheld = { shift = [2, 0, 0] }\nloads = { wind = 3 }",
        );
        assert_eq!(motion.problem(&[]), None);
        let (first, middle, last) = (motion.at(1), motion.at(5), motion.at(9));
        assert_eq!((first.weights["a"], last.weights["b"]), (1.0, 1.0));
        assert_eq!((middle.weights["a"], middle.weights["b"]), (0.5, 0.5));
        assert_eq!(middle.held.shift, [1.0, 0.0, 0.0]);
        assert_eq!(middle.loads["wind"], 2.0);
        assert_eq!(motion.weighed(), ["a", "b"]);
    }

    #[test]
    fn senseless_motions_are_told() {
        for (text, key) in [
            ("frames = 0", "motion.frames"),
            ("frames = 2\nrate = 0", "motion.rate"),
            ("frames = 2\nwithout = [\"wind\"]", "motion.without"),
            ("frames = 2\n[[key]]\nframe = 0", "motion.key.frame"),
            (
                "frames = 2\n[[key]]\nframe = 1\nloads = { springs = 2 }",
                "motion.key.loads",
            ),
            (
                "frames = 2\n[[key]]\nframe = 1\nweights = { a = nan }",
                "motion.key",
            ),
        ] {
            assert_eq!(motion(text).problem(&[]).unwrap().0, key);
        }
    }

    #[test]
    fn a_placement_turns_about_a_point() {
        let turn = Placement {
            turn: [0.0, 0.0, 90.0],
            about: [1.0, 0.0, 0.0],
            shift: [0.0, 0.0, 1.0],
        };
        let x = turn.apply(&Vector3::new(2.0, 0.0, 0.0));
        assert!((x - Vector3::new(1.0, 1.0, 1.0)).norm() < 1e-12);
    }
}
