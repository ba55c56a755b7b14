//! The bones of a scene and the joint that moves the mandible, as they are read and as a run keeps them.

use crate::error::{Result, TrainerError, file_error};
use crate::files::{create_folder, read_json, write_json};
use crate::matching::check_unit;
use crate::props::Props;
use crate::scene::Scene;
use face_rig::{Joint, JointParameters};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use serde::de::{Error as _, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use surface_mesh::{MorphedSurface, Surface, read_surface, write_glb};

/// How far a matrix in a file of motions may be from a rotation.
const ROTATION_SLACK: f64 = 1e-3;

/// A bone as a scene lists it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoneSettings {
    /// Name of the bone.
    pub name: String,
    /// Its surface: OBJ, glTF or GLB, relative to the data folder. Closed, unless it has a reach.
    pub file: PathBuf,
    /// How far around it the bone holds flesh, besides what is inside it. With a reach the surface may be open, as that of teeth often
    /// is; then there is no inside.
    #[serde(default)]
    pub reach: f64,
    /// Whether the jaw joint moves it; it stays at rest otherwise.
    #[serde(default)]
    pub moves: bool,
}

/// The jaw joint as a scene describes it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JawSettings {
    /// JSON file of the rigid motions that the moved bones make in the target shapes, relative to the data folder. The pivot is fitted
    /// to them. Shapes that it does not name leave the jaw at rest.
    pub motions: Option<PathBuf>,
    /// Where the joint turns, instead of the fitted place.
    pub pivot: Option<[f64; 3]>,
}

/// A bone with its surface.
#[derive(Debug, Clone, PartialEq)]
pub struct Bone {
    /// Its name.
    pub name: String,
    /// Whether the joint moves it.
    pub moves: bool,
    /// How far around it the bone holds flesh.
    pub reach: f64,
    /// Its surface at rest.
    pub surface: Surface,
}

/// The joint and what it does in each shape.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Jaw {
    /// Where both rotations turn.
    pub pivot: [f64; 3],
    /// Joint parameters that come nearest to the motion of each shape that has one: two angles in radians, a translation.
    pub shapes: BTreeMap<String, JointParameters>,
    /// The largest angle, in radians, between a motion and what the joint makes of it: what two rotations cannot express.
    pub residual_angle: f64,
    /// The largest distance, over the vertices of the bones that move and all motions, between where the motion and where the joint
    /// carries a vertex.
    pub residual_max: f64,
}

/// All bones, what effects know by name, and the jaw where one of them moves.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Rig {
    /// The bones, in the order of the scene.
    pub bones: Vec<Bone>,
    /// The jaw; absent where no bone moves.
    pub jaw: Option<Jaw>,
    /// What effects know by name.
    pub props: Props,
}

/// What `rig.json` holds of the bones.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Kept {
    bones: Vec<KeptBone>,
    jaw: Option<Jaw>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct KeptBone {
    name: String,
    moves: bool,
    #[serde(default)]
    reach: f64,
}

impl Jaw {
    /// The joint itself.
    pub fn joint(&self) -> Joint {
        Joint::new(Vector3::from(self.pivot))
    }

    /// What the joint does in a shape: it rests where the motions do not name the shape. `None` without any motions, where the jaw has
    /// but a pivot.
    pub fn parameters(&self, shape: &str) -> Option<JointParameters> {
        let own = || self.shapes.get(shape).copied().unwrap_or(Joint::REST);
        (!self.shapes.is_empty()).then(own)
    }

    /// What the joint does in the shapes that a file of motions names, such as frames with jaw transforms.
    ///
    /// # Errors
    /// When the file cannot be read or a motion in it is not rigid.
    pub fn motions(&self, path: &Path, unit: &str) -> Result<BTreeMap<String, JointParameters>> {
        let joint = self.joint();
        let motions = read_motions(path, unit)?.into_iter();
        let fitted = motions.map(|(name, m)| Ok((name, joint.fit_motion(&m)?.parameters)));
        fitted.collect()
    }
}

impl Rig {
    /// Reads the bones of a scene and fits the joint.
    ///
    /// # Errors
    /// When a file cannot be read, a bone is open, a bone moves but nothing says how, or a motion is not rigid.
    pub fn load(scene: &Scene, data: &Path) -> Result<Self> {
        let bones = scene.bones.iter().map(|bone| {
            let path = data.join(&bone.file);
            let file = read_surface(&path)?;
            check_unit(&path, &file, &scene.unit);
            let surface = file.surface;
            if bone.reach == 0.0 {
                surface_mesh::report(&surface).require_closed(&bone.file.display().to_string())?;
            }
            Ok(Bone {
                name: bone.name.clone(),
                moves: bone.moves,
                reach: bone.reach,
                surface,
            })
        });
        let bones = bones.collect::<Result<Vec<_>>>()?;
        let props = Props::load(&scene.obstacles, &scene.paints, &scene.unit, data)?;
        let moving: Vec<&Surface> = { bones.iter().filter(|b| b.moves).map(|b| &b.surface) }
            .chain(props.moving().map(|o| &o.surface))
            .collect();
        let jaw = match (&scene.jaw.motions, scene.jaw.pivot) {
            _ if moving.is_empty() => None,
            (Some(file), pivot) => {
                let path = data.join(file);
                Some(fit(
                    &path,
                    &read_motions(&path, &scene.unit)?,
                    pivot,
                    &moving,
                )?)
            }
            (None, Some(pivot)) => Some(Jaw {
                pivot,
                shapes: BTreeMap::new(),
                residual_angle: 0.0,
                residual_max: 0.0,
            }),
            (None, None) => {
                let bone = bones.iter().find(|b| b.moves).map(|b| ("bone", &b.name));
                let obstacle = || props.moving().next().map(|o| ("obstacle", &o.name));
                let (what, name) = bone.or_else(obstacle).expect("something moves");
                let name = name.clone();
                return Err(TrainerError::JawMissing { what, name });
            }
        };
        Ok(Self { bones, jaw, props })
    }

    /// Writes everything into a folder, `rig.json` last; nothing where there is nothing.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<()> {
        if *self == Self::default() {
            return Ok(());
        }
        create_folder(folder)?;
        self.props.write(folder)?;
        let mut bones = Vec::new();
        for (i, bone) in self.bones.iter().enumerate() {
            let surface = MorphedSurface::new(bone.surface.clone(), Vec::new())?;
            write_glb(bone_path(folder, i), &surface)?;
            bones.push(KeptBone {
                name: bone.name.clone(),
                moves: bone.moves,
                reach: bone.reach,
            });
        }
        let jaw = self.jaw.clone();
        write_json(&folder.join("rig.json"), &Kept { bones, jaw })
    }

    /// Reads what [`Rig::write`] wrote; no bones where the folder does not exist.
    ///
    /// # Errors
    /// When a file cannot be read or is damaged.
    pub fn read(folder: &Path) -> Result<Self> {
        if !folder.exists() {
            return Ok(Self::default());
        }
        let kept: Kept = read_json(&folder.join("rig.json"))?;
        let bones = kept.bones.into_iter().enumerate().map(|(i, bone)| {
            Ok(Bone {
                name: bone.name,
                moves: bone.moves,
                reach: bone.reach,
                surface: read_surface(bone_path(folder, i))?.surface,
            })
        });
        Ok(Self {
            bones: bones.collect::<Result<_>>()?,
            jaw: kept.jaw,
            props: Props::read(folder)?,
        })
    }
}

fn bone_path(folder: &Path, index: usize) -> PathBuf {
    folder.join(format!("bone-{}.glb", index + 1))
}

/// A rigid motion `x -> R x + t` as files have it: R row by row, t in a length unit that its key names.
struct MotionEntry {
    rotation_rowmajor: [f64; 9],
    /// Numbers under every key that begins with `translation`; all other keys are somebody else's.
    translations: BTreeMap<String, Vec<f64>>,
}

// By hand, as what serde gathers for `flatten` takes many times the memory of the text.
impl<'de> Deserialize<'de> for MotionEntry {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        struct Entries;
        impl<'de> Visitor<'de> for Entries {
            type Value = MotionEntry;

            fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                f.write_str("a motion")
            }

            fn visit_map<A: MapAccess<'de>>(
                self,
                mut map: A,
            ) -> std::result::Result<MotionEntry, A::Error> {
                let mut rotation = None;
                let mut translations = BTreeMap::new();
                while let Some(key) = map.next_key::<String>()? {
                    if key == "rotation_rowmajor" {
                        rotation = Some(map.next_value()?);
                    } else if key.starts_with("translation") {
                        translations.insert(key, map.next_value()?);
                    } else {
                        map.next_value::<IgnoredAny>()?;
                    }
                }
                let missing = || A::Error::missing_field("rotation_rowmajor");
                Ok(MotionEntry {
                    rotation_rowmajor: rotation.ok_or_else(missing)?,
                    translations,
                })
            }
        }
        deserializer.deserialize_map(Entries)
    }
}

/// Motions per unit and per frame; other keys are somebody else's.
#[derive(Deserialize)]
struct MotionsFile {
    #[serde(default)]
    unit_jaw: BTreeMap<String, MotionEntry>,
    #[serde(default, deserialize_with = "frames_that_move")]
    frames: Vec<(String, MotionEntry)>,
}

/// Which of the two forms a file has.
#[derive(Deserialize)]
struct MotionsForm {
    unit_jaw: Option<IgnoredAny>,
    frames: Option<IgnoredAny>,
}

#[derive(Deserialize)]
struct FrameEntry {
    name: Option<String>,
    jaw: Option<MotionEntry>,
}

/// Frames with a name and a motion; the others take no memory.
fn frames_that_move<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> std::result::Result<Vec<(String, MotionEntry)>, D::Error> {
    struct Frames;
    impl<'de> Visitor<'de> for Frames {
        type Value = Vec<(String, MotionEntry)>;

        fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
            f.write_str("a list of frames")
        }

        fn visit_seq<A: SeqAccess<'de>>(
            self,
            mut seq: A,
        ) -> std::result::Result<Self::Value, A::Error> {
            let mut all = Vec::new();
            while let Some(frame) = seq.next_element::<FrameEntry>()? {
                all.extend(frame.name.zip(frame.jaw));
            }
            Ok(all)
        }
    }
    deserializer.deserialize_seq(Frames)
}

fn read_motions(path: &Path, unit: &str) -> Result<BTreeMap<String, Isometry3<f64>>> {
    let text = std::fs::read_to_string(path).map_err(file_error("read", path))?;
    parse_motions(&text, path, unit)
}

/// Rigid motions by name from a JSON text: either a table of motions by name, or units and frames apart. `path` is what errors call
/// it, `unit` the scene's unit of length.
///
/// # Errors
/// When it is no JSON of this form, a motion is not rigid, or its translation is in another unit.
pub fn parse_motions(
    text: &str,
    path: &Path,
    unit: &str,
) -> Result<BTreeMap<String, Isometry3<f64>>> {
    let wrong = |problem: String| TrainerError::Json {
        path: path.to_path_buf(),
        problem,
    };
    let shape = |error: serde_json::Error| {
        wrong(format!(
            "{error}: a motion is {{\"rotation_rowmajor\": [9 numbers], \"translation_{unit}\": [3 numbers]}}"
        ))
    };
    let form = serde_json::from_str::<MotionsForm>(text);
    let entries: BTreeMap<String, MotionEntry> =
        if form.is_ok_and(|form| form.unit_jaw.or(form.frames).is_some()) {
            let file: MotionsFile = serde_json::from_str(text).map_err(shape)?;
            file.unit_jaw.into_iter().chain(file.frames).collect()
        } else {
            serde_json::from_str(text).map_err(shape)?
        };
    let motions = entries.into_iter().map(|(name, entry)| {
        let motion = entry
            .motion(unit)
            .map_err(|problem| wrong(format!("`{name}` {problem}")))?;
        Ok((name, motion))
    });
    motions.collect()
}

impl MotionEntry {
    fn motion(&self, unit: &str) -> std::result::Result<Isometry3<f64>, String> {
        let key = format!("translation_{unit}");
        let all = &self.translations;
        let numbers = match (all.get(&key), all.get("translation")) {
            (Some(numbers), _) | (None, Some(numbers)) => numbers,
            (None, None) => {
                let other = all.keys().next();
                return Err(match other {
                    Some(other) => format!(
                        "has `{other}`, but the scene's unit is `{unit}`: convert the file, or set `unit`"
                    ),
                    None => format!("has no `{key}`"),
                });
            }
        };
        let t: [f64; 3] = (numbers.as_slice().try_into())
            .map_err(|_| "has a translation that is not three numbers".to_string())?;
        let r = Matrix3::from_row_slice(&self.rotation_rowmajor);
        let off = (r * r.transpose() - Matrix3::identity()).norm();
        let finite = t.iter().all(|x| x.is_finite());
        if !(off < ROTATION_SLACK && r.determinant() > 0.0 && finite) {
            return Err(format!(
                "is no rigid motion: R R^T is {off:.1e} off the identity"
            ));
        }
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix(&r));
        Ok(Isometry3::from_parts(
            Translation3::from(Vector3::from(t)),
            rotation,
        ))
    }
}

/// The joint that explains the motions best, and its parameters for each.
fn fit(
    path: &Path,
    motions: &BTreeMap<String, Isometry3<f64>>,
    pivot: Option<[f64; 3]>,
    moving: &[&Surface],
) -> Result<Jaw> {
    let vertices = || moving.iter().flat_map(|surface| surface.vertices());
    let near = vertices().sum::<Vector3<f64>>() / vertices().count() as f64;
    let all: Vec<Isometry3<f64>> = motions.values().copied().collect();
    let pivot = match pivot {
        Some(pivot) => Vector3::from(pivot),
        None if all.is_empty() => {
            return Err(TrainerError::Json {
                path: path.to_path_buf(),
                problem: "holds no motion: give `jaw.pivot` instead".into(),
            });
        }
        None => Joint::fit_pivot(&all, near)?.joint.pivot,
    };
    let joint = Joint::new(pivot);
    let (mut residual_angle, mut residual_max): (f64, f64) = (0.0, 0.0);
    let mut shapes = BTreeMap::new();
    for (name, motion) in motions {
        let fitted = joint.fit_motion(motion)?;
        residual_angle = residual_angle.max(fitted.residual_angle);
        for surface in moving {
            let rest = surface.vertices();
            let reached = joint.positions(fitted.parameters, rest);
            let left = rest.iter().zip(reached).map(|(x, y)| {
                let wanted = motion.rotation * x + motion.translation.vector;
                (wanted - y).norm()
            });
            residual_max = left.fold(residual_max, f64::max);
        }
        shapes.insert(name.clone(), fitted.parameters);
    }
    Ok(Jaw {
        pivot: pivot.into(),
        shapes,
        residual_angle,
        residual_max,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;
    use surface_mesh::primitives::icosphere;
    use surface_mesh::write_obj;

    const TURN: &str = "[1, 0, 0, 0, 0.8, -0.6, 0, 0.6, 0.8]";

    /// A scene with a moved bone, and a folder that holds the bone and these motions.
    fn load(motions: &str) -> Result<Rig> {
        let folder = tempfile::tempdir().unwrap();
        write_obj(folder.path().join("bone.obj"), &icosphere(1, 0.3)).unwrap();
        std::fs::write(folder.path().join("motions.json"), motions).unwrap();
        let scene = fixture::scene(
            "[[bone]]\nname = \"mandible\"\nfile = \"bone.obj\"\nmoves = true\n[jaw]\nmotions = \"motions.json\"\n",
        );
        Rig::load(&scene, folder.path())
    }

    #[test]
    fn motions_are_fitted_and_kept() {
        // A turn by acos(0.8) about the x axis through (0, 1, 2): t = pivot - R pivot.
        let hinge = format!(
            r#"{{"unit_jaw": {{"long": {{"rotation_rowmajor": {TURN}, "translation_units": [0, 1.4, -0.2]}}}},
                "frames": [{{"name": "bent", "weights": {{}}, "jaw": {{"rotation_rowmajor": [1,0,0,0,1,0,0,0,1], "translation": [0, 0, 0]}}}}, {{"name": "both"}}]}}"#
        );
        let rig = load(&hinge).unwrap();
        let jaw = rig.jaw.clone().unwrap();
        let [x, y, z] = jaw.pivot;
        assert!((y - 1.0).abs() < 1e-9, "{x} {y} {z}");
        assert!((z - 2.0).abs() < 1e-9 && jaw.residual_angle < 1e-9);
        assert!(jaw.residual_max < 1e-9, "{}", jaw.residual_max);
        let theta = jaw.parameters("long").unwrap();
        assert!((theta[0] - 0.8_f64.acos()).abs() < 1e-9);
        assert!(theta[1..].iter().all(|t| t.abs() < 1e-9));
        assert_eq!(jaw.parameters("both"), Some(Joint::REST));
        let folder = tempfile::tempdir().unwrap();
        rig.write(folder.path()).unwrap();
        let again = Rig::read(folder.path()).unwrap();
        assert_eq!(again.jaw, rig.jaw);
        assert_eq!(again.bones[0].name, "mandible");
        // Kept in single precision, as all inputs of a run.
        for (a, b) in again.bones[0]
            .surface
            .vertices()
            .iter()
            .zip(rig.bones[0].surface.vertices())
        {
            assert!((a - b).norm() < 1e-6);
        }
        assert_eq!(
            Rig::read(&folder.path().join("none")).unwrap(),
            Rig::default()
        );
    }

    #[test]
    fn bad_motions_are_refused_with_the_mend() {
        for (motions, expected) in [
            ("{", "motions.json: EOF"),
            ("{}", "holds no motion"),
            (r#"{"open": {"rotation_rowmajor": [1, 2]}}"#, "9 numbers"),
            (
                r#"{"open": {"rotation_rowmajor": [1,0,0,0,1,0,0,0,1], "translation_m": [0, 0, 0]}}"#,
                "has `translation_m`, but the scene's unit is `units`",
            ),
            (
                r#"{"open": {"rotation_rowmajor": [1,0,0,0,1,0,0,0,1]}}"#,
                "`open` has no `translation_units`",
            ),
            (
                r#"{"open": {"rotation_rowmajor": [1,0,0,0,1,0,0,0,-1], "translation": [0, 0, 0]}}"#,
                "is no rigid motion",
            ),
            (
                r#"{"open": {"rotation_rowmajor": [2,0,0,0,1,0,0,0,1], "translation": [0, 0, 0]}}"#,
                "is no rigid motion",
            ),
        ] {
            let message = load(motions).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        }
    }

    #[test]
    fn a_bone_that_moves_needs_a_joint() {
        let folder = tempfile::tempdir().unwrap();
        write_obj(folder.path().join("bone.obj"), &icosphere(1, 0.3)).unwrap();
        let bone = "[[bone]]\nname = \"mandible\"\nfile = \"bone.obj\"\nmoves = true\n";
        let message = Rig::load(&fixture::scene(bone), folder.path()).unwrap_err();
        assert!(message.to_string().contains("`jaw.motions`"), "{message}");
        let pivot = fixture::scene(&format!("{bone}[jaw]\npivot = [0, 0, 0]\n"));
        let jaw = Rig::load(&pivot, folder.path()).unwrap().jaw.unwrap();
        assert_eq!(jaw.parameters("long"), None);
        let still = bone.replace("true", "false");
        let rig = Rig::load(&fixture::scene(&still), folder.path()).unwrap();
        assert!(rig.jaw.is_none() && rig.bones.len() == 1);
        let absent = fixture::scene(&bone.replace("bone.obj", "none.obj"));
        let message = Rig::load(&absent, folder.path()).unwrap_err().to_string();
        assert!(message.contains("none.obj"), "{message}");
    }
}
