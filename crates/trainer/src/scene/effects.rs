//! The effects of a scene: where they stand, which are left out, and more of them from a file.

use super::{Scene, syntax_error};
use crate::error::{Result, TrainerError, file_error};
use crate::motion::MotionSettings;
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

    /// Adds the effects of a file, and takes the keys of its motion where it has some; the file holds nothing else.
    ///
    /// # Errors
    /// When the file cannot be read, does not parse, or its motion makes no sense.
    pub fn add_effects(&mut self, path: &Path) -> Result<()> {
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Effects {
            #[serde(default)]
            effects: Vec<EffectSpec>,
            motion: Option<MotionSettings>,
        }
        let text = std::fs::read_to_string(path).map_err(file_error("read the effects", path))?;
        let more: Effects =
            toml::from_str(&text).map_err(|error| syntax_error(&text, path, &error))?;
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
        Ok(())
    }
}
