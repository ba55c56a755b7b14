//! A trained run with everything that simulating it needs.

use crate::body::Body;
use crate::error::{Result, TrainerError};
use crate::props::Props;
use crate::run::Run;
use crate::scene::Scene;
use crate::shapes::Shapes;
use crate::units::Length;
use actuation_net::{ActuationNet, NetworkConfig, TensorFile};
use std::path::PathBuf;
use surface_mesh::MorphedSurface;

/// Scene, body, shapes and network of a finished run.
pub struct Trained {
    /// The scene as it was used.
    pub scene: Scene,
    /// The neutral surface and the target shapes.
    pub inputs: MorphedSurface,
    /// The body, voxelised.
    pub body: Body,
    /// The target shapes and the basis that describes any shape.
    pub shapes: Shapes,
    /// The trained network.
    pub net: ActuationNet,
}

/// What may differ from training when a run is simulated.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Changes {
    /// Edge length of an element.
    pub element_size: Option<f64>,
    /// How far any node may be from its place: [`Scene::accuracy`].
    pub accuracy: Option<Length>,
    /// A file of effects that are added to those of training, and of keys for what is held: see [`Scene::add_effects`].
    pub effects: Option<PathBuf>,
    /// Whether frames follow one another in time: inertia and damping act, which training and single shapes know nothing of.
    pub dynamics: bool,
}

impl Trained {
    /// Loads a run, with what is given in `changes` instead of what training had.
    ///
    /// # Errors
    /// When the run is not finished or damaged, or a change does not fit the body.
    pub fn load(run: &Run, changes: &Changes) -> Result<Self> {
        let mut scene = run.scene()?;
        if let Some(accuracy) = &changes.accuracy {
            scene.set_accuracy(accuracy)?;
        }
        let added = match &changes.effects {
            Some(path) => scene.add_effects(path)?,
            None => Props::default(),
        };
        let timed = scene.effects.iter().any(|e| e.kind() == "inertia");
        match changes.dynamics {
            true if !timed => return Err(TrainerError::NoInertia),
            true => {}
            false => scene = scene.still(),
        }
        let inputs = run.inputs()?;
        let element_size = changes.element_size.unwrap_or(scene.mesh.element_size);
        let surface = inputs.surface.clone();
        let mut rig = run.rig()?;
        rig.props = rig.props.with(added)?;
        let body = Body::of_scene(&scene, surface, &rig, element_size)?;
        let shapes = Shapes::new(&scene, &inputs, rig.jaw.as_ref(), &body.vertex_weights)?;
        let mut config = crate::train::network_config(&scene, &shapes);
        if !run.model_path().exists() {
            return Err(TrainerError::Run {
                path: run.folder().to_path_buf(),
                problem:
                    "has no trained network yet (no model.safetensors): finish training with --resume"
                        .into(),
            });
        }
        let file = TensorFile::read(run.model_path())?;
        // The one setting that no scene has: whether the network knows the spacing of its grid.
        config.resolution = NetworkConfig::from_file(&file, "")?.resolution;
        let net = ActuationNet::from_file_with(&file, "", &config)?;
        Ok(Self {
            scene,
            inputs,
            body,
            shapes,
            net,
        })
    }
}
