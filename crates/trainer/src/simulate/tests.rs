//! Simulations of small bodies, and of a trained ball in time.

use super::*;
use crate::fixture;
use crate::performance::{PerformanceRequest, Source, perform};
use crate::run::Run;
use crate::trained::Changes;

const FALLING: &str = r#"
name = "falling"
[surface.solid]
shape = "box"
min = [0, 0, 0]
max = [1, 1, 1]
spacing = 0.5
[mesh]
element_size = 0.5
[[effects]]
type = "elasticity"
[[effects]]
type = "gravity"
acceleration = [0, -2, 0]
density = 1
[[effects]]
type = "inertia"
density = 1
time_step = 0.05
[motion]
frames = 6
rate = 10
"#;

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn simulate(&self, text: &str) -> Result<Simulated> {
        let scene = self.path("scene.toml");
        std::fs::write(&scene, text).unwrap();
        simulate(&SimulateRequest {
            scene,
            data: None,
            without: None,
            element_size: None,
            out: Some(self.path("out")),
        })
    }

    fn error(&self, text: &str) -> String {
        self.simulate(text).expect_err("refused").to_string()
    }
}

/// Two steps a frame by backward Euler: h^2 g n (n + 1) / 2 after n steps, and no strain.
#[test]
fn a_falling_box_falls_as_it_should_and_leaves_its_files() {
    let folder = Folder::new();
    let simulated = folder.simulate(FALLING).unwrap();
    let frames = &simulated.variants[0].frames;
    for (i, frame) in frames.iter().enumerate() {
        let n = 2.0 * i as f64;
        let exact = 0.05f64.powi(2) * 2.0 * n * (n + 1.0) / 2.0;
        assert!(
            (frame.moved - exact).abs() < 1e-5,
            "{} {exact}",
            frame.moved
        );
        assert!(frame.geometry.volume_change_percent.abs() < 1e-3);
        assert_eq!(frame.status, Status::Converged);
    }
    for file in ["sheet.png", "animation.glb", "simulation.json"] {
        assert!(simulated.folder.join(file).exists(), "{file}");
    }
    let line = variant_line(&simulated.variants[0]);
    assert!(line.starts_with("all effects: 6 frames in "), "{line}");
}

/// Half a frame after the held end was moved, the free one has not come along; without inertia it has. Loads follow their keys.
#[test]
fn effects_are_left_out_beside() {
    let text = FALLING.replace("[[effects]]\ntype = \"gravity\"", "[[effects]]\ntype = \"prescribed\"\nnodes = { type = \"half_space\", normal = [-1, 0, 0], offset = 0 }\n[[effects]]\ntype = \"gravity\"")
        + "without = [\"inertia\"]\n[[motion.key]]\nframe = 1\nloads = { gravity = 0 }\n[[motion.key]]\nframe = 2\nheld = { shift = [0, 0, 1] }\nloads = { gravity = 0 }\n";
    let folder = Folder::new();
    let simulated = folder.simulate(&text).unwrap();
    let [with, without] = &simulated.variants[..] else {
        panic!("two variants");
    };
    let farthest = |v: &Variant, i: usize| {
        v.frames[i]
            .surface
            .iter()
            .map(|x| x.z)
            .fold(f64::INFINITY, f64::min)
    };
    assert!((farthest(without, 1) - 1.0).abs() < 1e-3);
    assert!(farthest(with, 1) < 0.9, "{}", farthest(with, 1));
    assert_eq!(without.without, ["inertia"]);
    assert!(without.frames[0].kinetic_energy.is_none() && with.frames[0].kinetic_energy.is_some());
}

/// A ball held at its top is pushed up from below by a block that a file describes: with contact nothing passes, without it the block does.
#[test]
fn obstacles_of_files_are_kept_off_and_counted() {
    let folder = Folder::new();
    let block = surface_mesh::primitives::icosphere(1, 0.5);
    let low = block
        .vertices()
        .iter()
        .map(|x| x - Vector3::new(0.0, 1.6, 0.0));
    let block = block.with_vertices(low.collect()).unwrap();
    surface_mesh::write_obj(folder.path("block.obj"), &block).unwrap();
    let text = r#"
name = "pushed"
[surface.solid]
shape = "ball"
radius = 1
subdivisions = 2
[mesh]
element_size = 0.4
[[obstacle]]
name = "block"
file = "block.obj"
[[effects]]
type = "elasticity"
[[effects]]
type = "prescribed"
nodes = { type = "half_space", normal = [0, 1, 0], offset = 0.6 }
[[effects]]
type = "contact"
distance = 0.05
own = false
obstacles = ["block"]
[motion]
frames = 3
rate = 2
without = ["contact"]
[[motion.key]]
frame = 1
[[motion.key]]
frame = 3
obstacles = { shift = [0, 0.4, 0] }
"#;
    let simulated = folder.simulate(text).unwrap();
    let pairs = |variant: usize| -> Vec<_> {
        let frames = simulated.variants[variant].frames.iter();
        frames.map(|f| f.obstacle_pairs.unwrap()).collect()
    };
    assert_eq!(pairs(0), [0, 0, 0]);
    let beside = pairs(1);
    assert_eq!(beside[0], 0);
    assert!(beside[1] > 0 && beside[2] > 0, "{beside:?}");
    let pushed = simulated.variants[0].frames[2].moved;
    assert!(pushed > 0.2, "{pushed}");
    assert!(variant_line(&simulated.variants[1]).contains("with obstacles"));
}

#[test]
fn senseless_scenes_are_refused_with_their_place() {
    let folder = Folder::new();
    let still = FALLING.split("[motion]").next().unwrap();
    let message = folder.error(still);
    assert!(message.contains("`motion` is missing"), "{message}");
    let message = folder.error(&FALLING.replace("density = 1\ntime", "density = 0\ntime"));
    assert!(
        message.contains("scene.toml:16: effect 2: `density` is 0"),
        "{message}"
    );
    let message = folder.error(&FALLING.replace("rate = 10", "rate = 7"));
    assert!(
        message.contains("does not divide a frame of 1/7 s"),
        "{message}"
    );
    let weighed = |name: &str| {
        format!(
            "{FALLING}[[motion.muscle]]\nname = \"long\"\nb = [0.1, 0, 0, 0, 0, 0]\n[[motion.key]]\nframe = 1\nweights = {{ {name} = 1 }}\n"
        )
    };
    assert!(folder.simulate(&weighed("long")).is_ok());
    let message = folder.error(&weighed("lung"));
    assert!(message.contains("did you mean `long`?"), "{message}");
    let empty = "region = { type = \"sphere\", center = [9, 9, 9], radius = 1 }\nb";
    let message = folder.error(&weighed("long").replace("\nb", &format!("\n{empty}")));
    assert!(
        message.contains("nothing lies in the region of `long`"),
        "{message}"
    );
    let message = folder.error(&FALLING.replace("shape = \"box\"", "shape = \"bax\""));
    assert!(message.contains("scene.toml:"), "{message}");
}

/// A trained ball in time: it begins at rest, lags when what is held is moved, and single frames know nothing of inertia.
#[test]
fn a_performance_goes_through_time() {
    let folder = Folder::new();
    let run = Run::create(
        &folder.path("run"),
        fixture::SCENE,
        &fixture::inputs(),
        &Rig::default(),
        None,
    )
    .unwrap();
    crate::train::train(&run).unwrap();
    let effects = folder.path("effects.toml");
    std::fs::write(
        &effects,
        "[[effects]]\ntype = \"inertia\"\ndensity = 0.5\ntime_step = 0.1\n[motion]\nframes = 4\n\
         [[motion.key]]\nframe = 2\n[[motion.key]]\nframe = 4\nheld = { shift = [1, 0, 0] }\n",
    )
    .unwrap();
    let curves = folder.path("curves.csv");
    std::fs::write(&curves, "long\n0\n0\n0\n0\n").unwrap();
    let performed = |dynamics: bool, effects: Option<&PathBuf>| {
        perform(
            &run,
            &PerformanceRequest {
                source: Source::Curves(curves.clone()),
                units: None,
                fps: 10.0,
                changes: Changes {
                    effects: effects.cloned(),
                    dynamics,
                    ..Changes::default()
                },
                out: Some(folder.path("out")),
            },
        )
    };
    let mean =
        |surface: &[Vector3<f64>]| surface.iter().map(|x| x.x).sum::<f64>() / surface.len() as f64;
    let (timed, still) = (
        performed(true, Some(&effects)).unwrap(),
        performed(false, Some(&effects)).unwrap(),
    );
    let at = |p: &crate::performance::Performance, i: usize| mean(&p.frames[i].result.surface);
    assert!((at(&timed, 0) - at(&still, 0)).abs() < 1e-3);
    assert!((at(&still, 3) - at(&still, 0) - 1.0).abs() < 1e-3);
    let moved = at(&timed, 3) - at(&timed, 0);
    assert!((0.05..0.95).contains(&moved), "{moved}");
    let message = performed(true, None).err().unwrap().to_string();
    assert!(
        message.contains("nothing gives the body inertia"),
        "{message}"
    );
}
