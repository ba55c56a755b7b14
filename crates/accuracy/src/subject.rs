//! What is studied: a body, a few of its shapes, and the field that actuates them.

use crate::error::{AccuracyError, Result};
use crate::table::Units;
use actuation_net::{ActuationNet, Width};
use std::path::Path;
use surface_mesh::MorphedSurface;
use trainer::TrainerError;
use trainer::body::Body;
use trainer::rig::Rig;
use trainer::run::Run;
use trainer::scene::Scene;
use trainer::shapes::{Shape, Shapes, load_shapes};
use trainer::train::{check, train};
use trainer::trained::{Changes, Trained};

/// A network of some width.
pub struct Field {
    /// Its width.
    pub width: Width,
    /// The network.
    pub net: ActuationNet,
}

/// A body with fields that actuate it.
pub struct Subject {
    /// The scene.
    pub scene: Scene,
    /// Its bones.
    pub rig: Rig,
    inputs: MorphedSurface,
    shapes: Shapes,
    /// Shapes studied, of all.
    chosen: Vec<usize>,
    /// Fields, the narrowest first.
    pub fields: Vec<Field>,
    /// Length of the diagonal of the surface's bounding box.
    pub diagonal: f64,
}

impl Subject {
    /// The body and the network of a finished run, with `count` of its training shapes.
    ///
    /// # Errors
    /// When the run is not finished or damaged.
    pub fn of_run(folder: &Path, count: usize) -> Result<Self> {
        let run = Run::open(folder)?;
        let rig = run.rig()?;
        let Trained {
            scene,
            inputs,
            shapes,
            net,
            ..
        } = Trained::load(&run, &Changes::default())?;
        let width = scene.network.width;
        Ok(Self::new(
            scene,
            rig,
            inputs,
            shapes,
            vec![Field { width, net }],
            count,
        ))
    }

    /// The body of a scene, with fields of some widths. They are trained by stage 1 alone, into run folders under `out` that are used again:
    /// how a field that is nearly right depends on grid and solver does not change when it becomes a little better.
    ///
    /// # Errors
    /// When a file cannot be read or written, something does not fit, or the user stops.
    pub fn of_scene(
        path: &Path,
        data: &Path,
        widths: &[Width],
        out: &Path,
        count: usize,
    ) -> Result<Self> {
        let (mut scene, _) = Scene::read(path)?;
        let mut fields = Vec::new();
        let mut last = None;
        for &width in widths {
            scene.network.width = width;
            scene.stage2.epochs = 0;
            let folder = out.join(format!("network-{}", width.size()));
            let run = match folder.join("scene.toml").exists() {
                true => Run::open(&folder)?,
                false => {
                    let inputs = load_shapes(&scene, data)?;
                    let rig = Rig::load(&scene, data)?;
                    check(&scene, path, &inputs.shapes, &rig)?;
                    let basis = inputs.choose_basis(&scene)?;
                    let text = toml::to_string(&scene).expect("a scene is plain data");
                    Run::create(&folder, &text, &inputs.shapes, &rig, basis.as_ref())?
                }
            };
            if run.scene()? != scene {
                return Err(AccuracyError::Folder {
                    path: folder,
                    problem: "holds the network of another scene: give another --out".into(),
                });
            }
            if !run.model_path().exists() {
                train(&run).map_err(|error| match error {
                    TrainerError::Interrupted { .. } => AccuracyError::Stopped,
                    other => other.into(),
                })?;
            }
            let trained = Trained::load(&run, &Changes::default())?;
            fields.push(Field {
                width,
                net: trained.net,
            });
            last = Some((trained.scene, run.rig()?, trained.inputs, trained.shapes));
        }
        let (scene, rig, inputs, shapes) = last.expect("at least one width");
        Ok(Self::new(scene, rig, inputs, shapes, fields, count))
    }

    fn new(
        scene: Scene,
        rig: Rig,
        inputs: MorphedSurface,
        shapes: Shapes,
        fields: Vec<Field>,
        count: usize,
    ) -> Self {
        let training = shapes.training().len();
        let count = count.clamp(1, training.max(1));
        // Spread over all of them: shapes of one kind stand together in most files.
        let chosen = (0..count).map(|i| i * training / count);
        let names: Vec<String> = { chosen.map(|i| shapes.training()[i].name.clone()) }.collect();
        let place = |name: &String| shapes.all.iter().position(|s| s.name == *name);
        Self {
            chosen: names.iter().filter_map(place).collect(),
            diagonal: inputs.surface.diagonal(),
            scene,
            rig,
            inputs,
            shapes,
            fields,
        }
    }

    /// Writes a run folder with another network of the scene, for `eval` and whatever else takes a trained run. One that was written before is
    /// written again.
    ///
    /// # Errors
    /// When the folder holds a run of another scene, or cannot be written.
    pub fn write_run(&self, folder: &Path, net: &ActuationNet) -> Result<()> {
        let run = match folder.join("scene.toml").exists() {
            true => Run::open(folder)?,
            false => {
                let text = toml::to_string(&self.scene).expect("a scene is plain data");
                Run::create(folder, &text, &self.inputs, &self.rig, None)?
            }
        };
        if run.scene()? != self.scene {
            return Err(AccuracyError::Folder {
                path: folder.to_path_buf(),
                problem: "holds a run of another scene: give another --out".into(),
            });
        }
        Ok(net.save(run.model_path())?)
    }

    /// Its lengths, to be told in.
    pub fn units(&self) -> Units {
        Units {
            name: self.scene.unit.clone(),
            diagonal: self.diagonal,
        }
    }

    /// The body, by the mesh settings of `scene`.
    ///
    /// # Errors
    /// When the element size does not fit.
    pub fn body(&self, scene: &Scene) -> Result<Body> {
        let surface = self.inputs.surface.clone();
        let size = scene.mesh.element_size;
        Ok(Body::of_scene(scene, surface, &self.rig, size)?)
    }

    /// The shapes studied, each with the code that describes it.
    ///
    /// # Errors
    /// When a shape does not match the basis.
    pub fn shapes(&self) -> Result<Vec<(&Shape, Vec<f32>)>> {
        let described = self.chosen.iter().map(|&i| {
            let shape = &self.shapes.all[i];
            Ok((shape, self.shapes.descriptor(&shape.positions)?))
        });
        described.collect()
    }

    /// Names of the shapes studied.
    pub fn names(&self) -> Vec<&str> {
        let chosen = self.chosen.iter();
        chosen.map(|&i| &self.shapes.all[i].name[..]).collect()
    }

    /// The field of a width; the widest where that is not there.
    pub fn field(&self, width: Width) -> &Field {
        let own = self.fields.iter().find(|f| f.width == width);
        own.unwrap_or_else(|| self.fields.last().expect("at least one field"))
    }
}
