//! Trains a small body without any file of its own: the scene is a text, the ball and its shapes are made here.
//!
//! `cargo run --release -p trainer --example train_in_code`

use nalgebra::Vector3;
use std::path::Path;
use surface_mesh::primitives::icosphere;
use surface_mesh::{MorphTarget, MorphedSurface};
use trainer::rig::Rig;
use trainer::run::Run;
use trainer::scene::Scene;
use trainer::table::table;
use trainer::train::{check, train};

const SCENE: &str = r#"
name = "ball"
unit = "radii"

# For the record: this program hands the shapes over itself.
[surface]
file = "ball.obj"

[shapes]
held_out = ["half of both"]

[mesh]
element_size = 0.25

[[effects]]
type = "elasticity"

# Held: the core.
[[effects]]
type = "prescribed"
nodes = { type = "sphere", center = [0, 0, 0], radius = 0.3 }

[network]
width = 64

[stage1]
epochs = 60
batch = 2
points = 256
blends = 2

[stage2]
epochs = 10
"#;

/// A ball of radius 1 that learns to stretch and to bend; half of both together is held out.
fn shapes() -> Result<MorphedSurface, surface_mesh::SurfaceError> {
    let surface = icosphere(3, 1.0);
    let stretch = |x: &Vector3<f64>| Vector3::new(0.3 * x.x, -0.12 * x.y, -0.12 * x.z);
    let bend = |x: &Vector3<f64>| Vector3::new(0.0, 0.25 * x.x * x.x, 0.0);
    let target = |name: &str, delta: &dyn Fn(&Vector3<f64>) -> Vector3<f64>| MorphTarget {
        name: name.into(),
        deltas: surface.vertices().iter().map(delta).collect(),
    };
    let targets = vec![
        target("stretch", &stretch),
        target("bend", &bend),
        target("half of both", &|x| (stretch(x) + bend(x)) / 2.0),
    ];
    MorphedSurface::new(surface, targets)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let named = Path::new("the scene in this program");
    let scene = Scene::parse(SCENE, named)?;
    let inputs = shapes()?;
    check(&scene, named, &inputs, &Rig::default())?;

    let folder = tempfile::tempdir()?;
    let run = Run::create(folder.path(), SCENE, &inputs, &Rig::default(), None)?;
    let trained = train(&run)?;
    println!(
        "{}",
        table(
            &trained.results,
            &trained.stage1,
            trained.diagonal,
            &scene.unit
        )
    );
    let mut names: Vec<String> = (std::fs::read_dir(folder.path())?)
        .map(|entry| Ok(entry?.file_name().to_string_lossy().into_owned()))
        .collect::<std::io::Result<_>>()?;
    names.sort();
    println!("the run folder had: {}", names.join(", "));
    Ok(())
}
