//! The effects of a scene: where they stand, which are left out, and more of them from a file.

use super::{Scene, parse_toml};
use crate::error::{Result, TrainerError, file_error};
use crate::motion::MotionSettings;
use crate::props::{ObstacleSettings, PaintSettings, Props};
use pd_solver::{EffectSpec, SolverError};
use serde::Deserialize;
use std::path::Path;

/// Where the effects of a scene stand, by file and line. A scene is the same wherever it stands: all of these are equal.
#[derive(Debug, Clone, Default)]
pub struct Places(Vec<String>);

impl PartialEq for Places {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl Places {
    /// Those of the effects in a text.
    pub(super) fn of(text: &str, path: &Path) -> Self {
        let lines = text.lines().enumerate();
        let effects = lines.filter(|(_, line)| {
            let compact: String = line.chars().filter(|c| !c.is_whitespace()).collect();
            compact.starts_with("[[effects]]")
        });
        Self(
            effects
                .map(|(i, _)| format!("{}:{}", path.display(), i + 1))
                .collect(),
        )
    }
}

/// What a file of effects holds.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AddedEffects {
    #[serde(default)]
    effects: Vec<EffectSpec>,
    motion: Option<MotionSettings>,
    #[serde(default, rename = "obstacle")]
    obstacles: Vec<ObstacleSettings>,
    #[serde(default, rename = "paint")]
    paints: Vec<PaintSettings>,
}

/// Reads the text of a file of effects; `path` is named in errors.
///
/// # Errors
/// When it does not parse or has an unknown key (a near one is suggested).
pub fn parse_effects(text: &str, path: &Path) -> Result<AddedEffects> {
    parse_toml(text, path)
}

impl Scene {
    /// What the solver says of an effect, with the place of the effect where it is known.
    pub(crate) fn effect_error(&self, source: SolverError) -> TrainerError {
        let place = source
            .effect()
            .and_then(|index| self.effect_places.0.get(index));
        match place {
            Some(place) => TrainerError::Effect {
                place: place.clone(),
                source,
            },
            None => source.into(),
        }
    }

    /// Where an effect stands.
    pub(crate) fn effect_place(&self, index: usize) -> String {
        let place = self.effect_places.0.get(index).cloned();
        place.unwrap_or_else(|| format!("effect {index}"))
    }

    /// The same scene without the effects of some kinds.
    #[must_use]
    pub fn without(&self, kinds: &[String]) -> Self {
        let mut scene = self.clone();
        let keep: Vec<bool> = { self.effects.iter() }
            .map(|e| !kinds.iter().any(|kind| kind == e.kind()))
            .collect();
        let mut kept = keep.iter();
        scene.effects.retain(|_| *kept.next().unwrap_or(&true));
        let mut kept = keep.iter();
        scene
            .effect_places
            .0
            .retain(|_| *kept.next().unwrap_or(&true));
        scene
    }

    /// The same scene at rest in every frame: without inertia and damping.
    #[must_use]
    pub fn still(&self) -> Self {
        self.without(&["inertia".into(), "damping".into()])
    }

    /// Adds the effects of a file, and takes the keys of its motion where it has some; the file holds nothing else but what its effects
    /// name, which is returned. Its files are relative to its folder.
    ///
    /// # Errors
    /// When the file or one that it names cannot be read or does not parse, or its motion makes no sense.
    pub fn add_effects(&mut self, path: &Path) -> Result<Props> {
        let text = std::fs::read_to_string(path).map_err(file_error("read the effects", path))?;
        let more = parse_effects(&text, path)?;
        self.effects.extend(more.effects);
        self.effect_places.0.extend(Places::of(&text, path).0);
        if let Some(motion) = more.motion {
            if let Some((key, value, mend)) = motion.problem(&self.effects) {
                return Err(TrainerError::SceneValue {
                    path: path.to_path_buf(),
                    key,
                    value,
                    mend,
                });
            }
            self.motion = Some(motion);
        }
        let folder = path.parent().unwrap_or(Path::new(""));
        Props::load(&more.obstacles, &more.paints, &self.unit, folder)
    }
}
