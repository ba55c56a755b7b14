//! A body ready to be simulated: surface, voxels, bones and embedding.

use crate::actuator::Points;
use crate::error::{Result, TrainerError};
use crate::progress::note;
use crate::props::Props;
use crate::rig::{Bone, Rig};
use crate::scene::{ActuationPer, MeshSettings, Scene, SurfaceSource};
use crate::weights::vertex_weights;
use face_rig::Joint;
use hex_mesh::{
    Embedding, HexMesh, Quadrature, Splitting, VoxelOptions, VoxelReport, nodes_near,
    voxelise_with_bones,
};
use nalgebra::Vector3;
use pd_solver::{EffectSpec, EmbeddedSurface, NodeSet, Solver, deformation_gradients};
use std::collections::BTreeMap;
use surface_mesh::{Separation, Surface, separate};

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
    /// All samples of the energy.
    pub samples: Points,
    /// The middles of the elements, where their samples share one actuation.
    middles: Option<Points>,
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
    /// What effects know by name.
    pub props: Props,
    /// The share of every element under each paint.
    paint: BTreeMap<String, Vec<f64>>,
}

impl Body {
    /// Voxelises a surface without bones.
    ///
    /// # Errors
    /// When the surface is open or the element size does not fit it.
    pub fn new(name: &str, surface: Surface, element_size: f64, samples: usize) -> Result<Self> {
        let settings = MeshSettings {
            element_size,
            samples,
            actuation: ActuationPer::Sample,
            cover_thin: false,
            separate: false,
        };
        Self::with_bones(name, surface, &Rig::default(), &settings)
    }

    /// The body of a scene.
    ///
    /// # Errors
    /// As [`Body::with_bones`], and when the loss names parts that do not exist.
    pub fn of_scene(scene: &Scene, surface: Surface, rig: &Rig, element_size: f64) -> Result<Self> {
        let name = match &scene.surface {
            SurfaceSource::File(file) => file.display().to_string(),
            SurfaceSource::Starfish(_) | SurfaceSource::Solid(_) => scene.name.clone(),
        };
        let settings = scene.mesh.resized(element_size);
        let surface = match settings.separate {
            true => separated(&surface, &scene.unit)?,
            false => surface,
        };
        let weights = vertex_weights(&surface, scene)?;
        Ok(Self {
            vertex_weights: weights,
            ..Self::with_bones(&name, surface, rig, &settings)?
        })
    }

    /// Voxelises a surface; the cells inside bones are left out, and the nodes around them are the bones'.
    ///
    /// # Errors
    /// When the surface or a bone is open, the element size does not fit, or a bone holds nothing.
    pub fn with_bones(
        name: &str,
        surface: Surface,
        rig: &Rig,
        settings: &MeshSettings,
    ) -> Result<Self> {
        let element_size = settings.element_size;
        let mesh_error = |source| TrainerError::Mesh {
            name: name.to_string(),
            source,
        };
        surface_mesh::report(&surface).require_closed(name)?;
        let options = VoxelOptions {
            quadrature: Quadrature::from_count(settings.samples).map_err(mesh_error)?,
            cover_bones: true,
            split: Some(Splitting {
                cover_thin: settings.cover_thin,
                ..Splitting::default()
            }),
            ..VoxelOptions::new(element_size)
        };
        let is_closed = |bone: &&Bone| {
            surface_mesh::report(&bone.surface)
                .require_closed("")
                .is_ok()
        };
        let (closed, open): (Vec<&Bone>, Vec<&Bone>) = rig.bones.iter().partition(is_closed);
        let bones: Vec<Surface> = closed.iter().map(|bone| bone.surface.clone()).collect();
        let voxelised = voxelise_with_bones(&surface, &bones, &options).map_err(mesh_error)?;
        let embedding = voxelised.embed_surface(&surface).map_err(mesh_error)?;
        let mesh = voxelised.mesh;
        let (mut fixed_nodes, mut moved_nodes) = (Vec::new(), Vec::new());
        let mut is_held = vec![false; mesh.nodes().len()];
        let nowhere = vec![Vec::new(); open.len()];
        let all = closed.into_iter().chain(open);
        // What lies inside a bone is its own before anything that lies near another one.
        let inside: Vec<(&Bone, Vec<u32>)> = all
            .zip(voxelised.bone_nodes.into_iter().chain(nowhere))
            .collect();
        { inside.iter() }
            .flat_map(|(_, nodes)| nodes)
            .for_each(|&n| is_held[n as usize] = true);
        for (bone, mut nodes) in inside {
            if bone.reach > 0.0 {
                let near = nodes_near(&mesh, &bone.surface, bone.reach).map_err(|source| {
                    let name = format!("the bone `{}`", bone.name);
                    TrainerError::Mesh { name, source }
                })?;
                nodes.extend(
                    near.into_iter()
                        .filter(|&n| !std::mem::replace(&mut is_held[n as usize], true)),
                );
            }
            if nodes.is_empty() {
                return Err(TrainerError::BoneOutside {
                    bone: bone.name.clone(),
                    across: bone.surface.diagonal(),
                    body: surface.diagonal(),
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
            samples: points(&surface, &mesh, &mesh.sample_positions()),
            middles: (settings.actuation == ActuationPer::Element)
                .then(|| points(&surface, &mesh, &middles(&mesh))),
            diagonal: surface.diagonal(),
            vertex_weights: areas.iter().map(|a| a / total).collect(),
            fixed_nodes,
            moved_nodes,
            joint: rig.jaw.as_ref().map(|jaw| jaw.joint()),
            report: voxelised.report,
            props: rig.props.clone(),
            paint: rig.props.element_shares(&surface, &mesh)?,
            surface,
            mesh,
            embedding,
        })
    }

    /// The points at which the network is asked for an actuation.
    pub fn actuated(&self) -> &Points {
        self.middles.as_ref().unwrap_or(&self.samples)
    }

    /// The scene's effects, what they name in place of its name, and the bones. Nodes that the scene prescribes itself stay with the scene.
    ///
    /// # Errors
    /// When a region of the scene does not fit the body, or an effect names what is not listed.
    pub fn effects(&self, scene: &Scene) -> Result<Vec<EffectSpec>> {
        let mut effects = scene.effects.clone();
        let place = |i| scene.effect_place(i);
        self.props.put_into(&mut effects, &self.paint, place)?;
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

    /// The surface as effects on it see it.
    pub fn embedded_surface(&self) -> EmbeddedSurface {
        EmbeddedSurface {
            points: self.embedding.vertices().to_vec(),
            triangles: self.surface.triangles().to_vec(),
        }
    }

    /// The solver of the scene's effects, the bones and the surface.
    ///
    /// # Errors
    /// When an effect does not fit the body; the error names its line in the scene where that is known.
    pub fn solver(&self, scene: &Scene) -> Result<Solver> {
        let effects = self.effects(scene)?;
        let solver = match effects.iter().any(EffectSpec::acts_on_surface) {
            true => Solver::on_surface(&self.mesh, &self.embedded_surface(), &effects),
            false => Solver::new(&self.mesh, &effects),
        };
        solver.map_err(|source| scene.effect_error(source))
    }

    /// Vertices that count in the loss but cannot move by themselves: bones hold all nodes of the elements that carry them.
    pub fn vertices_on_bone(&self) -> Vec<usize> {
        let mut held = vec![false; self.mesh.nodes().len()];
        for &node in self.fixed_nodes.iter().chain(&self.moved_nodes) {
            held[node as usize] = true;
        }
        let elements = self.mesh.elements();
        let on_bone = |v: &usize| {
            let carrier = self.embedding.vertices()[*v].element as usize;
            self.vertex_weights[*v] > 0.0 && elements[carrier].iter().all(|&n| held[n as usize])
        };
        (0..self.embedding.vertices().len())
            .filter(on_bone)
            .collect()
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

/// The surface, moved apart where it passes through itself.
fn separated(surface: &Surface, unit: &str) -> Result<Surface> {
    let (apart, done) = separate(surface)?;
    if done.before > 0 {
        let Separation {
            before,
            after,
            moved,
            farthest,
        } = done;
        let mut message = format!(
            "{before} edges of the surface passed through others of its triangles: {moved} vertices were moved by at most {farthest:.2e} {unit}"
        );
        if after > 0 {
            message += &format!("; {after} still do");
        }
        note(&message);
    }
    Ok(apart)
}

/// Maps points so that the surface's bounding box is centred at 0 and its longest side spans [-1, 1]: the network sees the same
/// body whatever its unit, and the same point whatever the grid.
fn points(surface: &Surface, mesh: &HexMesh, points: &[Vector3<f64>]) -> Points {
    let (min, max) = surface.bounding_box();
    let centre = (min + max) / 2.0;
    let scale = 2.0 / (max - min).max();
    let normalised = points.iter().map(|p| (p - centre) * scale);
    Points {
        coordinates: normalised
            .flat_map(|p| [p.x as f32, p.y as f32, p.z as f32])
            .collect(),
        per_element: points.len() / mesh.elements().len(),
        spacing: (mesh.element_size() * scale) as f32,
    }
}

fn middles(mesh: &HexMesh) -> Vec<Vector3<f64>> {
    let half = Vector3::repeat(mesh.element_size() / 2.0);
    (0..mesh.elements().len())
        .map(|element| mesh.element_corner(element) + half)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;

    fn bone(name: &str, moves: bool, reach: f64, surface: Surface) -> Bone {
        Bone {
            name: name.into(),
            moves,
            reach,
            surface,
        }
    }

    /// An open strip of teeth in the plane y = 0.
    fn teeth(x: [f64; 2]) -> Surface {
        let corners = [
            [x[0], 0.0, -0.3],
            [x[1], 0.0, -0.3],
            [x[1], 0.0, 0.3],
            [x[0], 0.0, 0.3],
        ];
        let vertices = corners.map(Vector3::from).to_vec();
        Surface::from_triangles(vertices, vec![[0, 1, 2], [0, 2, 3]]).unwrap()
    }

    fn body(bones: Vec<Bone>) -> Result<Body> {
        let scene = fixture::scene("");
        let rig = Rig {
            bones,
            ..Rig::default()
        };
        Body::of_scene(&scene, fixture::inputs().surface, &rig, 0.2)
    }

    #[test]
    fn a_reach_holds_what_is_near_an_open_bone() {
        let body = body(vec![
            bone("upper", false, 0.15, teeth([-0.5, 0.05])),
            bone("lower", true, 0.15, teeth([0.05, 0.5])),
        ]);
        let body = body.unwrap();
        let nodes = body.mesh.nodes();
        let distance = |n: u32, x: [f64; 2]| {
            let p = nodes[n as usize];
            let aside = (x[0] - p.x).max(p.x - x[1]).max(0.0);
            Vector3::new(aside, p.y, (p.z.abs() - 0.3).max(0.0)).norm()
        };
        let all = 0..nodes.len() as u32;
        let upper = |n: &u32| distance(*n, [-0.5, 0.05]) <= 0.15;
        let lower = |n: &u32| distance(*n, [0.05, 0.5]) <= 0.15;
        assert_eq!(
            body.fixed_nodes,
            all.clone().filter(upper).collect::<Vec<_>>()
        );
        // A node near both is the first one's.
        let second = all.clone().filter(|n| lower(n) && !upper(n));
        assert_eq!(body.moved_nodes, second.collect::<Vec<_>>());
        assert!(!body.moved_nodes.is_empty() && all.clone().any(|n| lower(&n) && upper(&n)));
        assert!(body.vertices_on_bone().is_empty());
    }

    #[test]
    fn a_bone_that_holds_nothing_is_named_with_its_size() {
        let far = teeth([50.0, 50.5]);
        let message = body(vec![bone("upper", false, 0.15, far)])
            .err()
            .unwrap()
            .to_string();
        assert!(message.contains("`upper`, 0.781 across"), "{message}");
        assert!(message.contains("another unit"), "{message}");
    }

    /// Where a bone fills the body up to the skin, that skin cannot move, and it is told.
    #[test]
    fn skin_on_a_bone_is_found() {
        let ball = surface_mesh::primitives::icosphere(2, 1.1);
        let aside = ball
            .vertices()
            .iter()
            .map(|x| x + Vector3::new(0.7, 0.0, 0.0));
        let skull = ball.with_vertices(aside.collect()).unwrap();
        let body = body(vec![bone("skull", false, 0.0, skull)]).unwrap();
        let on_bone = body.vertices_on_bone();
        assert!(!on_bone.is_empty());
        let vertices = body.surface.vertices();
        assert!(on_bone.iter().all(|&v| vertices[v].x > 0.2), "{on_bone:?}");
        let rightmost =
            (0..vertices.len()).max_by(|&a, &b| vertices[a].x.total_cmp(&vertices[b].x));
        assert!(on_bone.contains(&rightmost.unwrap()));
    }
}
