//! A body ready to be simulated: surface, voxels, embedding, and the shapes it is to learn.

use crate::error::{Result, TrainerError};
use crate::frames::{frame_shapes, read_frames};
use crate::rig::{Jaw, Rig};
use crate::scene::{LossPart, Scene, SurfaceSource};
use face_rig::{BlendBasis, Bounds, Joint, JointParameters};
use hex_mesh::{Embedding, HexMesh, Quadrature, VoxelOptions, VoxelReport, voxelise_with_bones};
use nalgebra::Vector3;
use pd_solver::{EffectSpec, NodeSet, Solver, deformation_gradients};
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

/// The neutral surface and all target shapes of a scene, read or generated.
///
/// # Errors
/// When a file cannot be read, has no targets, or does not match the surface.
pub fn load_shapes(scene: &Scene, data: &Path) -> Result<MorphedSurface> {
    match &scene.surface {
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
            Ok(MorphedSurface::new(surface, targets)?)
        }
        SurfaceSource::File(file) => {
            let neutral = read_surface(data.join(file))?;
            let path = data.join(scene.shapes.file.as_ref().unwrap_or(file));
            let mut targets = match &scene.shapes.file {
                Some(_) => read_matching(&path, &neutral.surface)?,
                None => neutral.targets,
            };
            if let Some(frames) = &scene.shapes.frames {
                let units = MorphedSurface::new(neutral.surface.clone(), targets.clone())?;
                let frames = read_frames(&data.join(frames), &units)?;
                for shape in frame_shapes(&frames, &units, ShapeSet::Train) {
                    targets.push(MorphTarget {
                        deltas: difference(&shape.positions, units.surface.vertices()),
                        name: shape.name,
                    });
                }
            }
            for name in &scene.shapes.leave_out {
                let before = targets.len();
                targets.retain(|target| target.name != *name);
                if targets.len() == before {
                    return Err(unknown_shape("`shapes.leave_out`", name, &targets));
                }
            }
            if targets.is_empty() {
                return Err(TrainerError::NoTargets { path });
            }
            Ok(MorphedSurface::new(neutral.surface, targets)?)
        }
    }
}

/// Morph targets of a file, as displacements from the vertices of `surface`, which the file's own neutral must have as well.
///
/// # Errors
/// When the file cannot be read, has another number of vertices or no morph target.
pub fn read_matching(path: &Path, surface: &Surface) -> Result<Vec<MorphTarget>> {
    let file = read_surface(path)?;
    let (found, expected) = (file.surface.vertex_count(), surface.vertex_count());
    if found != expected {
        return Err(TrainerError::VertexCount {
            path: path.to_path_buf(),
            found,
            expected,
        });
    }
    if file.targets.is_empty() {
        let path = path.to_path_buf();
        return Err(TrainerError::NoTargets { path });
    }
    let targets = (0..file.targets.len()).map(|i| MorphTarget {
        name: file.targets[i].name.clone(),
        deltas: difference(&file.shape(i), surface.vertices()),
    });
    Ok(targets.collect())
}

/// `a - b`, vertex by vertex.
pub fn difference(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

/// A surface with its voxels.
pub struct Body {
    /// The neutral surface.
    pub surface: Surface,
    /// The voxels.
    pub mesh: HexMesh,
    /// What the voxeliser said.
    pub report: VoxelReport,
    /// Where the surface's vertices are in the voxels.
    pub embedding: Embedding,
    /// Sample points for the network, `[elements * samples, 3]`, in [-1, 1] over the surface's bounding box.
    pub points: Vec<f32>,
    /// Length of the diagonal of the surface's bounding box.
    pub diagonal: f64,
    /// What each vertex counts: its share of the surface's area, times the weights of the loss; they sum to 1.
    pub vertex_weights: Vec<f64>,
    /// Nodes that bones hold at rest, by rising index.
    pub fixed_nodes: Vec<u32>,
    /// Nodes that hang on the joint, by rising index.
    pub moved_nodes: Vec<u32>,
    /// The joint; absent where nothing moves.
    pub joint: Option<Joint>,
}

impl Body {
    /// Voxelises a surface without bones.
    ///
    /// # Errors
    /// When the surface is open or the element size does not fit it.
    pub fn new(name: &str, surface: Surface, element_size: f64, samples: usize) -> Result<Self> {
        Self::with_bones(name, surface, &Rig::default(), element_size, samples)
    }

    /// The body of a scene.
    ///
    /// # Errors
    /// As [`Body::with_bones`], and when the loss names parts that do not exist.
    pub fn of_scene(scene: &Scene, surface: Surface, rig: &Rig, element_size: f64) -> Result<Self> {
        let name = match &scene.surface {
            SurfaceSource::File(file) => file.display().to_string(),
            SurfaceSource::Starfish(_) => scene.name.clone(),
        };
        let samples = scene.mesh.samples;
        let mut body = Self::with_bones(&name, surface, rig, element_size, samples)?;
        body.weigh(&scene.loss.weights)?;
        Ok(body)
    }

    /// Voxelises a surface; the cells inside bones are left out, and the nodes around them are the bones'.
    ///
    /// # Errors
    /// When the surface or a bone is open, the element size does not fit, or a bone holds nothing.
    pub fn with_bones(
        name: &str,
        surface: Surface,
        rig: &Rig,
        element_size: f64,
        samples: usize,
    ) -> Result<Self> {
        let mesh_error = |source| TrainerError::Mesh {
            name: name.to_string(),
            source,
        };
        surface_mesh::report(&surface).require_closed(name)?;
        let options = VoxelOptions {
            quadrature: Quadrature::from_count(samples).map_err(mesh_error)?,
            cover_bones: true,
            ..VoxelOptions::new(element_size)
        };
        let bones: Vec<Surface> = rig.bones.iter().map(|b| b.surface.clone()).collect();
        let voxelised = voxelise_with_bones(&surface, &bones, &options).map_err(mesh_error)?;
        let embedding = voxelised.embed_surface(&surface).map_err(mesh_error)?;
        let mesh = voxelised.mesh;
        let (mut fixed_nodes, mut moved_nodes) = (Vec::new(), Vec::new());
        for (bone, nodes) in rig.bones.iter().zip(voxelised.bone_nodes) {
            if nodes.is_empty() {
                return Err(TrainerError::BoneOutside {
                    bone: bone.name.clone(),
                    element_size,
                });
            }
            let list = if bone.moves {
                &mut moved_nodes
            } else {
                &mut fixed_nodes
            };
            list.extend(nodes);
        }
        fixed_nodes.sort_unstable();
        moved_nodes.sort_unstable();
        let areas = surface.vertex_areas();
        let total: f64 = areas.iter().sum();
        Ok(Self {
            points: normalised_points(&surface, &mesh.sample_positions()),
            diagonal: surface.diagonal(),
            vertex_weights: areas.iter().map(|a| a / total).collect(),
            fixed_nodes,
            moved_nodes,
            joint: rig.jaw.as_ref().map(|jaw| jaw.joint()),
            report: voxelised.report,
            surface,
            mesh,
            embedding,
        })
    }

    /// Multiplies the weights of parts of the surface, and makes them sum to 1 again.
    fn weigh(&mut self, parts: &[LossPart]) -> Result<()> {
        for (i, part) in parts.iter().enumerate() {
            let wrong = |problem: String| TrainerError::LossPart {
                number: i + 1,
                problem,
            };
            if !(part.weight.is_finite() && part.weight >= 0.0) {
                let problem = format!(
                    "has the weight {}: give a finite number, zero or more",
                    part.weight
                );
                return Err(wrong(problem));
            }
            let vertices = self.surface.vertices();
            let chosen = match (part.region, part.vertices) {
                (Some(region), None) => region
                    .contains(vertices, self.mesh.element_size())
                    .map_err(|error| wrong(error.to_string()))?,
                (None, Some([first, last])) if first <= last && last < vertices.len() => (0
                    ..vertices.len())
                    .map(|v| (first..=last).contains(&v))
                    .collect(),
                (None, Some([first, last])) => {
                    let count = vertices.len();
                    return Err(wrong(format!(
                        "names the vertices {first} to {last}, but the surface has 0 to {}",
                        count - 1
                    )));
                }
                _ => return Err(wrong("needs either `region` or `vertices`".into())),
            };
            if !chosen.contains(&true) {
                return Err(wrong("selects no vertex".into()));
            }
            for (weight, chosen) in self.vertex_weights.iter_mut().zip(chosen) {
                if chosen {
                    *weight *= part.weight;
                }
            }
        }
        let total: f64 = self.vertex_weights.iter().sum();
        if total == 0.0 {
            return Err(TrainerError::LossPart {
                number: parts.len(),
                problem: "leaves no vertex any weight".into(),
            });
        }
        self.vertex_weights.iter_mut().for_each(|w| *w /= total);
        Ok(())
    }

    /// The scene's effects, and the bones. Nodes that the scene prescribes itself stay with the scene.
    ///
    /// # Errors
    /// When a region of the scene does not fit the body.
    pub fn effects(&self, scene: &Scene) -> Result<Vec<EffectSpec>> {
        let mut effects = scene.effects.clone();
        if self.fixed_nodes.is_empty() && self.moved_nodes.is_empty() {
            return Ok(effects);
        }
        let mut own = vec![false; self.mesh.nodes().len()];
        for node in Solver::prescribed_by(&self.mesh, &effects)? {
            own[node as usize] = true;
        }
        for bone in [&self.fixed_nodes, &self.moved_nodes] {
            let free = bone.iter().copied().filter(|&n| !own[n as usize]);
            let nodes = NodeSet::Indices(free.collect());
            effects.push(EffectSpec::Prescribed { nodes });
        }
        Ok(effects)
    }

    /// Positions of the surface's vertices for positions of the nodes.
    pub fn surface_positions(&self, nodes: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        self.embedding.positions(nodes, &self.mesh)
    }

    /// Elements with at least one sample turned inside out.
    pub fn inverted_elements(&self, nodes: &[Vector3<f64>]) -> usize {
        let gradients = deformation_gradients(&self.mesh, nodes);
        let samples = self.mesh.quadrature().len();
        let inverted = |f: &nalgebra::Matrix3<f64>| f.determinant() <= 0.0;
        let elements = gradients.chunks(samples);
        elements.filter(|e| e.iter().any(inverted)).count()
    }
}

/// Maps points so that the surface's bounding box is centred at 0 and its longest side spans [-1, 1]: the network sees the same
/// body whatever its unit, and the same point whatever the grid.
fn normalised_points(surface: &Surface, points: &[Vector3<f64>]) -> Vec<f32> {
    let (min, max) = surface.bounding_box();
    let centre = (min + max) / 2.0;
    let scale = 2.0 / (max - min).max();
    let normalised = points.iter().map(|p| (p - centre) * scale);
    normalised
        .flat_map(|p| [p.x as f32, p.y as f32, p.z as f32])
        .collect()
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
        let basis_indices: Vec<usize> = match &scene.shapes.basis {
            Some(names) => {
                let indices = names.iter().map(|name| named("`shapes.basis`", name));
                indices.collect::<Result<_>>()?
            }
            None => (0..held_out.len()).filter(|&i| !held_out[i]).collect(),
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
