//! Scene files: what a body is made of, which shapes it is to learn, and how.

mod effects;

use crate::error::{Result, TrainerError, file_error, suggestion};
use crate::generated::Solid;
use crate::motion::MotionSettings;
use crate::props::{ObstacleSettings, PaintSettings};
use crate::rig::{BoneSettings, JawSettings};
use crate::units::Length;
use actuation_net::Width;
pub use effects::{AddedEffects, Places, parse_effects};
use hex_mesh::NodeRegion;
use pd_solver::{EffectSpec, Method};
use scene_shapes::{StarfishPose, StarfishShape};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// A scene as its TOML file has it. Lengths are in the unit that the surface is given in.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// Name of the scene and of its default run folder.
    pub name: String,
    /// Name of the length unit, for tables and pictures.
    #[serde(default = "default_unit")]
    pub unit: String,
    /// Seed of everything that is drawn at random.
    #[serde(default)]
    pub seed: u64,
    /// How far any node may be from its place: sets the accuracy of all equilibria and the tolerance of the adjoint, instead of
    /// `stage2.accuracy`, `stage2.adjoint_tolerance` and `evaluation.accuracy`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub accuracy: Option<Length>,
    /// Seconds of training between checkpoints; 0 writes one after every step.
    #[serde(default = "default_checkpoint_seconds")]
    pub checkpoint_seconds: f64,
    /// The neutral surface.
    pub surface: SurfaceSource,
    /// The target shapes.
    #[serde(default)]
    pub shapes: ShapeList,
    /// Poses of a generated surface; each is a target shape.
    #[serde(default, rename = "pose")]
    pub poses: Vec<NamedPose>,
    /// Voxels and samples.
    pub mesh: MeshSettings,
    /// Bones: closed surfaces inside the body. The nodes that they hold are prescribed.
    #[serde(default, rename = "bone")]
    pub bones: Vec<BoneSettings>,
    /// The joint that moves bones which move.
    #[serde(default)]
    pub jaw: JawSettings,
    /// Bodies that contact keeps off, for effects that name them.
    #[serde(default, rename = "obstacle", skip_serializing_if = "Vec::is_empty")]
    pub obstacles: Vec<ObstacleSettings>,
    /// Paint on the skin, for effects that name it.
    #[serde(default, rename = "paint", skip_serializing_if = "Vec::is_empty")]
    pub paints: Vec<PaintSettings>,
    /// What acts on the body; what is not listed costs nothing.
    pub effects: Vec<EffectSpec>,
    /// File and line of each effect, for messages.
    #[serde(skip)]
    pub effect_places: Places,
    /// The network.
    #[serde(default)]
    pub network: NetworkSettings,
    /// The loss.
    #[serde(default)]
    pub loss: LossSettings,
    /// Pretraining on the actuation of pulled shapes.
    #[serde(default)]
    pub stage1: Stage1,
    /// Training through the simulator.
    #[serde(default)]
    pub stage2: Stage2,
    /// How shapes are simulated when a run is evaluated.
    #[serde(default)]
    pub evaluation: Evaluation,
    /// What `simulate` moves; training has no use for it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub motion: Option<MotionSettings>,
}

/// Where the neutral surface comes from: one of the two.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub enum SurfaceSource {
    /// An OBJ, glTF or GLB file, relative to the data folder.
    File(PathBuf),
    /// A generated starfish.
    Starfish(StarfishShape),
    /// A generated ball, box or hollow ball, to try effects on.
    Solid(Solid),
}

/// Which shapes there are and what they are for.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShapeList {
    /// A glTF or GLB file with target shapes as morph targets over the vertices of the surface, relative to the data folder.
    /// The surface's own file is used where this is not given.
    pub file: Option<PathBuf>,
    /// JSON or CSV file of frames, weights over the shapes of the file, relative to the data folder: each frame is a target shape too.
    pub frames: Option<PathBuf>,
    /// Names of the shapes that are held out of training.
    #[serde(default)]
    pub held_out: Vec<String>,
    /// Names of shapes of the file that are no targets, such as correctives that mean nothing alone.
    #[serde(default)]
    pub leave_out: Vec<String>,
    /// The shapes whose weights describe any shape to the network: their names, or how many are to be chosen from the training shapes
    /// of the file, the farthest first; all training shapes where not given.
    pub basis: Option<Basis>,
}

/// The shapes that describe all others.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(
    untagged,
    expecting = "`shapes.basis` is a number of shapes or a list of their names"
)]
pub enum Basis {
    /// So many, chosen by [`BasisChoice::farthest_first`](face_rig::BasisChoice::farthest_first).
    Count(usize),
    /// These.
    Names(Vec<String>),
}

/// A named pose of a generated surface.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NamedPose {
    /// Name of the shape.
    pub name: String,
    /// The pose, one entry per arm.
    pub arms: Vec<scene_shapes::ArmPose>,
}

impl NamedPose {
    /// The pose without its name.
    pub fn pose(&self) -> StarfishPose {
        StarfishPose {
            arms: self.arms.clone(),
        }
    }
}

/// Voxels and samples.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeshSettings {
    /// Edge length of an element.
    pub element_size: f64,
    /// Samples per element: 1, 8 or 27.
    #[serde(default = "default_samples")]
    pub samples: usize,
    /// Where the network is asked.
    #[serde(default)]
    pub actuation: ActuationPer,
    /// Whether parts thinner than an element, such as fingers, get elements too; their skin hangs on flesh nearby otherwise.
    #[serde(default)]
    pub cover_thin: bool,
    /// Whether the neutral surface is moved apart where it passes through itself a little, as faces do in the corners of the mouth:
    /// contact leaves those places out otherwise. See [`surface_mesh::separate`].
    #[serde(default)]
    pub separate: bool,
}

/// What has an actuation of its own.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ActuationPer {
    /// Every sample of an element: the field as fine as the energy sees it.
    #[default]
    Sample,
    /// An element: all its samples have the actuation of its middle, and the network is asked that many times less.
    Element,
}

impl MeshSettings {
    /// Elements of another size.
    #[must_use]
    pub fn resized(&self, element_size: f64) -> Self {
        Self {
            element_size,
            ..self.clone()
        }
    }
}

/// The network.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NetworkSettings {
    /// Features of the sine layers: 64, 128 or 256.
    pub width: Width,
    /// Size of the latent code.
    #[serde(default = "default_latent")]
    pub latent: usize,
    /// Frequency of the sine layers.
    #[serde(default = "default_omega")]
    pub omega: f32,
}

impl Default for NetworkSettings {
    fn default() -> Self {
        Self {
            width: Width::W128,
            latent: default_latent(),
            omega: default_omega(),
        }
    }
}

/// The loss: mean over the surface of the squared distance, in hundredths of the bounding-box diagonal, plus `normal_weight` times the
/// squared difference of unit normals.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LossSettings {
    /// alpha of the paper: 0 for bodies, 1 for faces.
    #[serde(default)]
    pub normal_weight: f64,
    /// Weight of the mandible beside the surface, where its motion is known: of the mean squared distance of the nodes that hang on the
    /// joint from where they should be, in the unit of the surface's. The surface alone would let the jaw make up for what the flesh
    /// does not do yet.
    #[serde(default = "default_jaw_weight")]
    pub jaw_weight: f64,
    /// Weight of material squeezed to less than a tenth of its volume or turned inside out: of its volume, in cubes of the unit of the
    /// surface's distances, times the square of how far its share of volume is below a tenth. 0 lets it be.
    #[serde(default)]
    pub inversion_weight: f64,
    /// How much more than its area a vertex counts that is far off its target: its squared distance d^2 is counted
    /// 1 + far_weight d^2 / (d^2 + far^2) times. A few vertices of small area, such as a lip's edge, would else be left behind.
    #[serde(default)]
    pub far_weight: f64,
    /// The distance from which on a vertex is far off, as a share of the bounding-box diagonal.
    #[serde(default = "default_far")]
    pub far: f64,
    /// Parts of the surface that count less or more than their area, or not at all. A vertex of several takes their product.
    #[serde(default)]
    pub weights: Vec<LossPart>,
}

impl Default for LossSettings {
    fn default() -> Self {
        Self {
            normal_weight: 0.0,
            jaw_weight: default_jaw_weight(),
            inversion_weight: 0.0,
            far_weight: 0.0,
            far: default_far(),
            weights: Vec::new(),
        }
    }
}

/// A part of the surface and what it counts: one of the two selections.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LossPart {
    /// The vertices in a region of the neutral shape.
    pub region: Option<NodeRegion>,
    /// The first and the last vertex of a range.
    pub vertices: Option<[usize; 2]>,
    /// Factor on the area: 0 for what the simulation cannot see.
    pub weight: f64,
}

/// Stage 1: pull the passive body onto every target with springs, then fit the network to the stretch found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Stage1 {
    /// Stiffness of the springs per surface area, in units of elasticity per element size: large follows the target closely,
    /// small keeps the actuation smooth.
    pub spring_stiffness: f64,
    /// Passes over all shapes.
    pub epochs: usize,
    /// Shapes per step.
    pub batch: usize,
    /// Sample points drawn per shape and step.
    pub points: usize,
    /// Share of the points drawn where the shapes stretch the body most, in [0, 1); see [`crate::focus::Focus`].
    pub focus: f64,
    /// How much more shapes count that stretch the body little, from 0, where absolute errors count alike, to 1, where relative ones do;
    /// see [`crate::balance::Balance`].
    pub balance: f64,
    /// Superpositions of basis shapes drawn per step, so that the codes between training shapes mean something too.
    pub blends: usize,
    /// First learning rate; it decays to 0.
    pub learning_rate: f64,
}

impl Default for Stage1 {
    fn default() -> Self {
        Self {
            spring_stiffness: 20.0,
            epochs: 300,
            batch: 4,
            points: 1024,
            focus: 0.0,
            balance: 0.0,
            blends: 0,
            learning_rate: 1e-3,
        }
    }
}

/// Stage 2: train through the simulator.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Stage2 {
    /// Passes over all training shapes.
    pub epochs: usize,
    /// First learning rate; it decays to 0.
    pub learning_rate: f64,
    /// Accuracy of the equilibria, as a share of the bounding-box diagonal.
    pub accuracy: f64,
    /// Relative residual of the adjoint.
    pub adjoint_tolerance: f64,
    /// Points that a step's gradient goes through, drawn where it is large so that it is that of all points in the mean; 0 for all of
    /// them. The network costs three times as much on the way back as on the way there.
    pub points: usize,
    /// How much more shapes count that move the surface little, from 0 to 1 as in stage 1.
    pub balance: f64,
    /// Weight of the superpositions' actuation loss (that of stage 1) beside the loss on the surface: keeps what the codes between the
    /// training shapes mean. 0 leaves them alone.
    pub blend_weight: f64,
}

impl Default for Stage2 {
    fn default() -> Self {
        Self {
            epochs: 30,
            learning_rate: 1e-4,
            accuracy: 1e-4,
            points: 0,
            balance: 0.0,
            adjoint_tolerance: 1e-2,
            blend_weight: 0.0,
        }
    }
}

/// How shapes are simulated when a run is evaluated.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Evaluation {
    /// Accuracy of the equilibria, as a share of the bounding-box diagonal.
    pub accuracy: f64,
    /// Method of the solver.
    pub method: Method,
}

impl Default for Evaluation {
    fn default() -> Self {
        Self {
            accuracy: 1e-5,
            method: Method::default(),
        }
    }
}

/// The unit of a scene that names none.
pub(crate) const UNNAMED_UNIT: &str = "units";

fn default_unit() -> String {
    UNNAMED_UNIT.into()
}

fn default_checkpoint_seconds() -> f64 {
    10.0
}

fn default_samples() -> usize {
    8
}

fn default_latent() -> usize {
    32
}

fn default_jaw_weight() -> f64 {
    10.0
}

fn default_far() -> f64 {
    2e-3
}

fn default_omega() -> f32 {
    30.0
}

/// Larger files are refused: the parser of TOML takes up to 256 bytes of memory for each of the text. In bytes.
const LARGEST_SCENE: usize = 1 << 20;

impl Scene {
    /// Reads and checks a scene file. Returns its text too, to be kept with the run.
    ///
    /// # Errors
    /// When the file cannot be read, does not parse, has an unknown key (a near one is suggested), or a value makes no sense.
    pub fn read(path: &Path) -> Result<(Self, String)> {
        let text = std::fs::read_to_string(path).map_err(file_error("read the scene", path))?;
        Ok((Self::parse(&text, path)?, text))
    }

    /// As [`Scene::read`], from a text; `path` is named in errors.
    ///
    /// # Errors
    /// As [`Scene::read`].
    pub fn parse(text: &str, path: &Path) -> Result<Self> {
        let mut scene: Self = parse_toml(text, path)?;
        scene.effect_places = Places::of(text, path);
        scene.check(path)?;
        Ok(scene)
    }

    fn check(&self, path: &Path) -> Result<()> {
        let wrong = |key, value: String, mend| {
            Err(TrainerError::SceneValue {
                path: path.to_path_buf(),
                key,
                value,
                mend,
            })
        };
        if let Some(accuracy) = &self.accuracy
            && accuracy.in_unit(&self.unit).is_err()
        {
            let mend =
                "give a bare number, in the scene's unit, or name a unit of length by `unit`";
            return wrong("accuracy", accuracy.to_string(), mend);
        }
        let positive = [
            ("mesh.element_size", self.mesh.element_size),
            ("loss.far", self.loss.far),
            ("stage1.spring_stiffness", self.stage1.spring_stiffness),
            ("stage2.accuracy", self.stage2.accuracy),
            ("stage2.adjoint_tolerance", self.stage2.adjoint_tolerance),
            ("evaluation.accuracy", self.evaluation.accuracy),
        ];
        for (key, value) in positive {
            if !(value.is_finite() && value > 0.0) {
                return wrong(key, value.to_string(), "give a finite number above zero");
            }
        }
        let not_negative = [
            ("loss.normal_weight", self.loss.normal_weight),
            ("loss.jaw_weight", self.loss.jaw_weight),
            ("loss.inversion_weight", self.loss.inversion_weight),
            ("loss.far_weight", self.loss.far_weight),
            ("stage1.learning_rate", self.stage1.learning_rate),
            ("stage2.blend_weight", self.stage2.blend_weight),
            ("stage2.learning_rate", self.stage2.learning_rate),
            ("checkpoint_seconds", self.checkpoint_seconds),
        ];
        for (key, value) in not_negative {
            if !(value.is_finite() && value >= 0.0) {
                return wrong(key, value.to_string(), "give a finite number, zero or more");
            }
        }
        for bone in &self.bones {
            if !(bone.reach.is_finite() && bone.reach >= 0.0) {
                let mend = "give a length, zero or more";
                return wrong("bone.reach", bone.reach.to_string(), mend);
            }
        }
        for (key, value) in [
            ("stage1.balance", self.stage1.balance),
            ("stage2.balance", self.stage2.balance),
        ] {
            if !(0.0..=1.0).contains(&value) {
                return wrong(key, value.to_string(), "give a number from 0 to 1");
            }
        }
        if !(0.0..1.0).contains(&self.stage1.focus) {
            let mend = "give a number from 0 to below 1";
            return wrong("stage1.focus", self.stage1.focus.to_string(), mend);
        }
        if ![1, 8, 27].contains(&self.mesh.samples) {
            let value = self.mesh.samples.to_string();
            return wrong("mesh.samples", value, "give 1, 8 or 27");
        }
        for (key, value) in [
            ("stage1.batch", self.stage1.batch),
            ("stage1.points", self.stage1.points),
        ] {
            if value == 0 {
                return wrong(key, "0".into(), "give at least 1");
            }
        }
        let is_file_name = !self.name.is_empty()
            && (self.name.chars()).all(|c| c.is_alphanumeric() || "-_. ".contains(c));
        if !is_file_name || self.name.starts_with('.') {
            let mend = "use letters, digits, spaces, `-`, `_` and `.`: it names the run folder";
            return wrong("name", format!("`{}`", self.name), mend);
        }
        if self.unit.chars().any(char::is_control) {
            let mend = "name a unit of length, such as mm: it stands in tables, plots and pages";
            return wrong("unit", format!("{:?}", self.unit), mend);
        }
        for (i, pose) in self.poses.iter().enumerate() {
            if self.poses[..i].iter().any(|p| p.name == pose.name) {
                let value = format!("named `{}` twice", pose.name);
                return wrong("pose", value, "give every pose a name of its own");
            }
        }
        if let SurfaceSource::Solid(solid) = &self.surface
            && let Some((key, value, mend)) = solid.problem()
        {
            return wrong(key, value, mend);
        }
        if let Some(motion) = &self.motion
            && let Some((key, value, mend)) = motion.problem(&self.effects)
        {
            return wrong(key, value, mend);
        }
        let generated = !matches!(self.surface, SurfaceSource::File(_));
        if !matches!(self.surface, SurfaceSource::Starfish(_)) && !self.poses.is_empty() {
            let mend =
                "poses are for a generated starfish; list the shapes of a file under [shapes]";
            return wrong("pose", format!("{} poses", self.poses.len()), mend);
        }
        if generated && self.shapes.file.is_some() {
            let mend = "a generated surface takes its shapes from [[pose]]";
            return wrong("shapes.file", "a file".into(), mend);
        }
        Ok(())
    }
}

/// What a TOML text of a sensible size holds.
fn parse_toml<T: DeserializeOwned>(text: &str, path: &Path) -> Result<T> {
    if text.len() > LARGEST_SCENE {
        return Err(TrainerError::SceneSyntax {
            path: path.to_path_buf(),
            line: 1,
            message: format!(
                "{} bytes are no scene: a scene has a few thousand",
                text.len()
            ),
        });
    }
    toml::from_str(text).map_err(|error| syntax_error(text, path, &error))
}

/// toml's own message, shortened to its first line, with the line number and the nearest known key.
fn syntax_error(text: &str, path: &Path, error: &toml::de::Error) -> TrainerError {
    let start = error.span().map_or(0, |span| span.start).min(text.len());
    let line = text[..start].matches('\n').count() + 1;
    let message = error.message();
    let mut parts = message.splitn(2, ", expected ");
    let unknown = parts.next().unwrap_or_default();
    let hint = match (unknown.split('`').nth(1), parts.next()) {
        (Some(name), Some(known)) => {
            let known: Vec<&str> = known.split('`').skip(1).step_by(2).collect();
            suggestion(name, &known.join(", "))
        }
        _ => String::new(),
    };
    TrainerError::SceneSyntax {
        path: path.to_path_buf(),
        line: if unknown.starts_with("unknown") {
            unknown
                .split('`')
                .nth(1)
                .and_then(|name| line_of_key(text, name, line))
                .unwrap_or(line)
        } else {
            line
        },
        message: format!("{message}{hint}"),
    }
}

/// The line of a key at or after the start of its table: errors inside tagged tables only tell where the table starts.
fn line_of_key(text: &str, name: &str, from: usize) -> Option<usize> {
    let holds = |line: &str| {
        line.split(['{', ',', '['])
            .any(|part| part.trim_start().trim_start_matches('"').starts_with(name))
    };
    let lines = text.lines().enumerate().skip(from - 1);
    lines.filter(|(_, l)| holds(l)).map(|(i, _)| i + 1).next()
}

#[cfg(test)]
mod tests;
