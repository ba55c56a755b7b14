//! The shapes that a body is to learn, and the basis whose weights describe any shape to the network.

use crate::error::{Result, TrainerError};
use crate::frames::{frame_shapes, read_frames};
use crate::matching::{check_same_mesh, check_unit};
use crate::rig::Jaw;
use crate::scene::{Basis, Scene, SurfaceSource};
use crate::weights::vertex_weights;
use face_rig::{BasisChoice, BlendBasis, Bounds, Joint, JointParameters};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::path::Path;
use surface_mesh::{MorphTarget, MorphedSurface, Surface, read_surface};

/// What a shape is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ShapeSet {
    /// Trained on.
    Train,
    /// Kept from training, to see how the network generalises.
    HeldOut,
    /// A blend of shapes by weights.
    Blend,
}

impl ShapeSet {
    /// As tables write it.
    pub fn label(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::HeldOut => "held out",
            Self::Blend => "blend",
        }
    }
}

/// A target shape over the vertices of the neutral surface.
#[derive(Debug, Clone, PartialEq)]
pub struct Shape {
    /// Its name.
    pub name: String,
    /// What it is for.
    pub set: ShapeSet,
    /// Vertex positions.
    pub positions: Vec<Vector3<f64>>,
    /// What the jaw does, where that is known.
    pub joint: Option<JointParameters>,
}

/// The neutral surface of a scene and all its target shapes.
#[derive(Debug, Clone)]
pub struct Inputs {
    /// The neutral surface and the target shapes.
    pub shapes: MorphedSurface,
    /// How many of the targets are shapes of their own, and not frames that blend them; they come first.
    pub units: usize,
}

/// The neutral surface and all target shapes of a scene, read or generated.
///
/// # Errors
/// When a file cannot be read, has no targets, or does not match the surface.
pub fn load_shapes(scene: &Scene, data: &Path) -> Result<Inputs> {
    match &scene.surface {
        SurfaceSource::Solid(_) => Err(TrainerError::NothingToLearn),
        SurfaceSource::Starfish(shape) => {
            let surface = scene_shapes::starfish(shape)?;
            let mut targets = Vec::new();
            for pose in &scene.poses {
                pose.pose().check(shape)?;
                let moved = scene_shapes::pose(shape, &pose.pose(), surface.vertices());
                let deltas = difference(&moved, surface.vertices());
                let name = pose.name.clone();
                targets.push(MorphTarget { name, deltas });
            }
            let units = targets.len();
            let shapes = MorphedSurface::new(surface, targets)?;
            Ok(Inputs { shapes, units })
        }
        SurfaceSource::File(file) => {
            let own_path = data.join(file);
            let neutral = read_surface(&own_path)?;
            check_unit(&own_path, &neutral, &scene.unit);
            let path = data.join(scene.shapes.file.as_ref().unwrap_or(file));
            let mut targets = match &scene.shapes.file {
                Some(_) => {
                    let file = read_like(&path, &neutral.surface)?;
                    check_unit(&path, &file, &scene.unit);
                    file.targets
                }
                None => neutral.targets,
            };
            // Frames may weigh what is no target by itself, such as a corrective.
            let frames = frame_targets(scene, data, &neutral.surface, &targets)?;
            let mut is_known = vec![false; scene.shapes.leave_out.len()];
            let mut keep = |target: &MorphTarget| {
                let mut names = scene.shapes.leave_out.iter();
                let place = names.position(|name| *name == target.name);
                place.inspect(|&i| is_known[i] = true).is_none()
            };
            targets.retain(&mut keep);
            let units = targets.len();
            targets.extend(frames.into_iter().filter(keep));
            if let Some(i) = is_known.iter().position(|known| !known) {
                let name = &scene.shapes.leave_out[i];
                return Err(unknown_shape("`shapes.leave_out`", name, &targets));
            }
            if targets.is_empty() {
                return Err(TrainerError::NoTargets { path });
            }
            let shapes = MorphedSurface::new(neutral.surface, targets)?;
            Ok(Inputs { shapes, units })
        }
    }
}

/// The neutral surface of a scene alone, read or generated.
///
/// # Errors
/// When a file cannot be read, or the measures of a generated surface are impossible.
pub fn load_neutral(scene: &Scene, data: &Path) -> Result<Surface> {
    match &scene.surface {
        SurfaceSource::Solid(solid) => solid.surface(),
        SurfaceSource::Starfish(shape) => Ok(scene_shapes::starfish(shape)?),
        SurfaceSource::File(file) => {
            let path = data.join(file);
            let neutral = read_surface(&path)?;
            check_unit(&path, &neutral, &scene.unit);
            Ok(neutral.surface)
        }
    }
}

/// The frames of a scene, blended from all its units.
fn frame_targets(
    scene: &Scene,
    data: &Path,
    surface: &Surface,
    units: &[MorphTarget],
) -> Result<Vec<MorphTarget>> {
    let Some(frames) = &scene.shapes.frames else {
        return Ok(Vec::new());
    };
    let units = MorphedSurface::new(surface.clone(), units.to_vec())?;
    let frames = read_frames(&data.join(frames), &units)?;
    let blended = frame_shapes(&frames, &units, ShapeSet::Train);
    let targets = blended.into_iter().map(|shape| MorphTarget {
        deltas: difference(&shape.positions, surface.vertices()),
        name: shape.name,
    });
    Ok(targets.collect())
}

/// Morph targets of a file, as displacements from the vertices of `surface`, which the file's own neutral must have as well.
///
/// # Errors
/// When the file cannot be read, has another number or order of vertices, another unit, or no morph target.
pub fn read_matching(path: &Path, surface: &Surface) -> Result<Vec<MorphTarget>> {
    Ok(read_like(path, surface)?.targets)
}

/// As [`read_matching`], with the surface itself and the unit that the file names.
fn read_like(path: &Path, surface: &Surface) -> Result<MorphedSurface> {
    let file = read_surface(path)?;
    let (found, expected) = (file.surface.vertex_count(), surface.vertex_count());
    if found != expected {
        return Err(TrainerError::VertexCount {
            path: path.to_path_buf(),
            found,
            expected,
        });
    }
    check_same_mesh(path, &file.surface, surface)?;
    if file.targets.is_empty() {
        let path = path.to_path_buf();
        return Err(TrainerError::NoTargets { path });
    }
    let targets = (0..file.targets.len()).map(|i| MorphTarget {
        name: file.targets[i].name.clone(),
        deltas: difference(&file.shape(i), surface.vertices()),
    });
    Ok(MorphedSurface {
        surface: surface.clone(),
        targets: targets.collect(),
        unit: file.unit,
    })
}

/// `a - b`, vertex by vertex.
pub fn difference(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

/// The shapes that a scene's number of basis shapes stands for, as a run keeps them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChosenBasis {
    /// Their names, the farthest first.
    pub basis: Vec<String>,
    /// The other units that were there to choose from, and what the best weights over the basis leave of each: the largest distance
    /// at a vertex that counts, in scene units.
    pub left_out: Vec<(String, f64)>,
}

impl ChosenBasis {
    /// What was chosen, and which unit it describes worst, in a line.
    pub fn summary(&self, unit: &str) -> String {
        let (count, names) = (self.basis.len(), self.basis.join(", "));
        let worst = self.left_out.iter().max_by(|a, b| a.1.total_cmp(&b.1));
        let worst = worst.map(|(name, far)| {
            format!(
                "; of the {} left out `{name}` is described worst, {far:.3} {unit} off at its worst vertex",
                self.left_out.len()
            )
        });
        format!(
            "weights of {count} shapes, the farthest first: {names}{}",
            worst.unwrap_or_default()
        )
    }
}

impl Inputs {
    /// Chooses basis shapes from the training shapes that are no frames, where the scene asks for a number of them.
    ///
    /// # Errors
    /// When there are not so many, or the loss of the scene does not fit the surface.
    pub fn choose_basis(&self, scene: &Scene) -> Result<Option<ChosenBasis>> {
        let Some(Basis::Count(count)) = scene.shapes.basis else {
            return Ok(None);
        };
        let weights = vertex_weights(&self.shapes.surface, scene)?;
        let units = self.shapes.targets[..self.units].iter();
        let units: Vec<&MorphTarget> = units
            .filter(|unit| !scene.shapes.held_out.contains(&unit.name))
            .collect();
        let deltas: Vec<_> = units.iter().map(|unit| unit.deltas.clone()).collect();
        let choice = BasisChoice::farthest_first(&deltas, &weights, count)?;
        let name = |i: usize| units[i].name.clone();
        let others = (0..units.len()).filter(|i| !choice.chosen.contains(i));
        Ok(Some(ChosenBasis {
            left_out: others.map(|i| (name(i), choice.residual_max[i])).collect(),
            basis: choice.chosen.iter().copied().map(name).collect(),
        }))
    }
}

/// Shapes, their split, and the basis whose weights describe any shape to the network.
pub struct Shapes {
    /// All target shapes, in file order.
    pub all: Vec<Shape>,
    basis: BlendBasis,
    /// Which of all shapes, all of them trained on.
    basis_indices: Vec<usize>,
    neutral: Vec<Vector3<f64>>,
    jaw: Option<Jaw>,
}

impl Shapes {
    /// Splits the targets of a scene and forms the basis.
    ///
    /// # Errors
    /// When the scene names a shape that does not exist, or the basis cannot be formed.
    pub fn new(
        scene: &Scene,
        inputs: &MorphedSurface,
        jaw: Option<&Jaw>,
        vertex_weights: &[f64],
    ) -> Result<Self> {
        let named = |place: &str, name: &String| {
            inputs
                .target_index(name)
                .ok_or_else(|| unknown_shape(place, name, &inputs.targets))
        };
        let mut held_out = vec![false; inputs.targets.len()];
        for name in &scene.shapes.held_out {
            held_out[named("`shapes.held_out`", name)?] = true;
        }
        let training = (0..held_out.len()).filter(|&i| !held_out[i]);
        let basis_indices: Vec<usize> = match &scene.shapes.basis {
            Some(Basis::Names(names)) => {
                let indices = names.iter().map(|name| named("`shapes.basis`", name));
                indices.collect::<Result<_>>()?
            }
            Some(Basis::Count(count)) => {
                let training: Vec<usize> = training.collect();
                let deltas: Vec<_> = training
                    .iter()
                    .map(|&i| inputs.targets[i].deltas.clone())
                    .collect();
                let choice = BasisChoice::farthest_first(&deltas, vertex_weights, *count)?;
                choice.chosen.iter().map(|&i| training[i]).collect()
            }
            None => training.collect(),
        };
        if let Some(&index) = basis_indices.iter().find(|&&i| held_out[i]) {
            let name = inputs.targets[index].name.clone();
            return Err(TrainerError::HeldOutBasis { name });
        }
        let deltas = basis_indices
            .iter()
            .map(|&i| inputs.targets[i].deltas.clone());
        let basis = BlendBasis::weighted(deltas.collect(), vertex_weights)?;
        let all = (inputs.targets.iter().zip(held_out).enumerate())
            .map(|(i, (target, held_out))| Shape {
                name: target.name.clone(),
                set: if held_out {
                    ShapeSet::HeldOut
                } else {
                    ShapeSet::Train
                },
                positions: inputs.shape(i),
                joint: jaw.and_then(|jaw| jaw.parameters(&target.name)),
            })
            .collect();
        Ok(Self {
            all,
            basis,
            basis_indices,
            neutral: inputs.surface.vertices().to_vec(),
            jaw: jaw.cloned(),
        })
    }

    /// The jaw, where a bone moves.
    pub fn jaw(&self) -> Option<&Jaw> {
        self.jaw.as_ref()
    }

    /// The shapes to train on.
    pub fn training(&self) -> Vec<&Shape> {
        let training = self.all.iter().filter(|s| s.set == ShapeSet::Train);
        training.collect()
    }

    /// Number of weights that describe a shape.
    pub fn descriptor_size(&self) -> usize {
        self.basis.shape_count()
    }

    /// The weights in [0, 1] over the basis that come nearest to a shape.
    ///
    /// # Errors
    /// When the positions do not match the basis.
    pub fn descriptor(&self, positions: &[Vector3<f64>]) -> Result<Vec<f32>> {
        let bounds = Bounds::uniform(self.basis.shape_count(), 0.0, 1.0);
        let fit = self
            .basis
            .fit(&difference(positions, &self.neutral), &bounds, 1e-6)?;
        Ok(fit.weights.iter().map(|&w| w as f32).collect())
    }

    /// The linear blend that a descriptor stands for: neutral plus its weights times the displacements of the basis.
    pub fn linear(&self, descriptor: &[f32]) -> Vec<Vector3<f64>> {
        let mut sum = self.neutral.clone();
        for (&shape, &weight) in self.basis_indices.iter().zip(descriptor) {
            let moved = self.all[shape].positions.iter().zip(&self.neutral);
            for (sum, (x, rest)) in sum.iter_mut().zip(moved) {
                *sum += (x - rest) * f64::from(weight);
            }
        }
        sum
    }

    /// Which training shape each weight of a descriptor belongs to.
    pub fn basis_in_training(&self) -> Vec<usize> {
        let before = |i: usize| {
            self.all[..i]
                .iter()
                .filter(|s| s.set == ShapeSet::Train)
                .count()
        };
        self.basis_indices.iter().map(|&i| before(i)).collect()
    }

    /// Neutral plus the weighted displacements of named shapes.
    ///
    /// # Errors
    /// When a name does not exist.
    pub fn blend(&self, weights: &[(String, f64)], inputs: &MorphedSurface) -> Result<Shape> {
        let mut all = vec![0.0; inputs.targets.len()];
        for (name, weight) in weights {
            let index = inputs.target_index(name);
            all[index.ok_or_else(|| unknown_shape("`--weights`", name, &inputs.targets))?] +=
                weight;
        }
        let label = weights.iter().map(|(name, w)| format!("{w} {name}"));
        Ok(Shape {
            name: label.collect::<Vec<_>>().join(" + "),
            set: ShapeSet::Blend,
            positions: inputs.blend(&all),
            joint: self.jaw.as_ref().and_then(|jaw| {
                let mut sum = Joint::REST;
                for (name, weight) in weights {
                    let own = jaw.parameters(name)?;
                    sum.iter_mut().zip(own).for_each(|(s, x)| *s += weight * x);
                }
                Some(sum)
            }),
        })
    }
}

fn unknown_shape(place: &str, name: &str, targets: &[MorphTarget]) -> TrainerError {
    let known = targets.iter().map(|t| t.name.as_str());
    TrainerError::UnknownShape {
        place: place.to_string(),
        name: name.to_string(),
        known: known.collect::<Vec<_>>().join(", "),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;

    /// A count chooses from the training shapes that are no frames; the run's own scene then has the names.
    #[test]
    fn a_number_of_basis_shapes_is_chosen_from_the_units() {
        let text = fixture::SCENE.replace("[\"long\", \"bent\"]", "1");
        let scene = Scene::parse(&text, Path::new("ball.toml")).unwrap();
        assert_eq!(scene.shapes.basis, Some(Basis::Count(1)));
        let inputs = Inputs {
            shapes: fixture::inputs(),
            units: 2,
        };
        // `both` is the largest, but no unit.
        let chosen = inputs.choose_basis(&scene).unwrap().unwrap();
        assert_eq!(chosen.basis, ["long"]);
        assert_eq!(chosen.left_out[0].0, "bent");
        let weights = vertex_weights(&inputs.shapes.surface, &scene).unwrap();
        let basis =
            BlendBasis::weighted(vec![inputs.shapes.targets[0].deltas.clone()], &weights).unwrap();
        let fit = basis
            .fit(
                &inputs.shapes.targets[1].deltas,
                &Bounds::uniform(1, 0.0, 1.0),
                0.0,
            )
            .unwrap();
        assert!((chosen.left_out[0].1 - fit.residual_max).abs() < 1e-12);
        let folder = tempfile::tempdir().unwrap();
        let rig = crate::rig::Rig::default();
        let run =
            crate::run::Run::create(folder.path(), &text, &inputs.shapes, &rig, Some(&chosen));
        let names = run.unwrap().scene().unwrap().shapes.basis;
        assert_eq!(names, Some(Basis::Names(vec!["long".into()])));
        let named = fixture::scene("");
        assert_eq!(inputs.choose_basis(&named).unwrap(), None);
        let many = text.replace("basis = 1", "basis = 3");
        let many = Scene::parse(&many, Path::new("ball.toml")).unwrap();
        let message = inputs.choose_basis(&many).unwrap_err().to_string();
        assert!(message.contains("1 to 2"), "{message}");
        let bad = fixture::SCENE.replace("[\"long\", \"bent\"]", "0.5");
        let message = Scene::parse(&bad, Path::new("ball.toml")).unwrap_err();
        assert!(
            message.to_string().contains("list of their names"),
            "{message}"
        );
    }
}
