//! A body ready to be simulated: surface, voxels, bones and embedding.

use crate::error::{Result, TrainerError};
use crate::rig::Rig;
use crate::scene::{Scene, SurfaceSource};
use crate::weights::vertex_weights;
use face_rig::Joint;
use hex_mesh::{Embedding, HexMesh, Quadrature, VoxelOptions, VoxelReport, voxelise_with_bones};
use nalgebra::Vector3;
use pd_solver::{EffectSpec, NodeSet, Solver, deformation_gradients};
use surface_mesh::Surface;

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
        body.vertex_weights = vertex_weights(&body.surface, scene)?;
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
