//! A ball that learns to stretch and to bend: what unit tests share.

use crate::body::Body;
use crate::evaluate::ShapeResult;
use crate::props::Props;
use crate::rig::{Bone, Jaw, Rig};
use crate::scene::Scene;
use crate::shapes::{ShapeSet, Shapes, difference};
use actuation_net::JOINT_SIZE;
use nalgebra::Vector3;
use pd_solver::Status;
use std::collections::BTreeMap;
use std::path::Path;
use surface_mesh::primitives::icosphere;
use surface_mesh::{MorphTarget, MorphedSurface};

pub const SCENE: &str = r#"
name = "ball"
checkpoint_seconds = 0
[surface]
file = "ball.obj"
[shapes]
basis = ["long", "bent"]
[mesh]
element_size = 0.4
[[effects]]
type = "elasticity"
stiffness = 3
[[effects]]
type = "prescribed"
nodes = { type = "sphere", center = [0, 0, 0], radius = 0.4 }
[network]
width = 64
latent = 4
[stage1]
epochs = 2
batch = 2
points = 16
blends = 1
[stage2]
epochs = 1
"#;

/// The scene, with `more` behind it.
pub fn scene(more: &str) -> Scene {
    Scene::parse(&format!("{SCENE}{more}"), Path::new("ball.toml")).unwrap()
}

/// The unit ball and the shapes `long`, `bent` and `both`.
pub fn inputs() -> MorphedSurface {
    let surface = icosphere(2, 1.0);
    let long = |x: &Vector3<f64>| Vector3::new(1.3 * x.x, 0.9 * x.y, 0.9 * x.z);
    let bent = |x: &Vector3<f64>| x + Vector3::new(0.0, 0.2 * x.x * x.x, 0.0);
    let both = |x: &Vector3<f64>| bent(&long(x));
    let target = |name: &str, moved: &dyn Fn(&Vector3<f64>) -> Vector3<f64>| MorphTarget {
        name: name.into(),
        deltas: difference(
            &surface.vertices().iter().map(moved).collect::<Vec<_>>(),
            surface.vertices(),
        ),
    };
    let targets = vec![
        target("long", &long),
        target("bent", &bent),
        target("both", &both),
    ];
    MorphedSurface::new(surface, targets).unwrap()
}

pub fn body(scene: &Scene) -> Body {
    let mesh = &scene.mesh;
    Body::new("ball", inputs().surface, mesh.element_size, mesh.samples).unwrap()
}

/// A bone in the ball that moves on a joint.
pub fn rig() -> Rig {
    let bone = icosphere(2, 0.45);
    let aside = bone
        .vertices()
        .iter()
        .map(|x| x + Vector3::new(0.3, 0.0, 0.0));
    Rig {
        bones: vec![Bone {
            name: "mandible".into(),
            moves: true,
            reach: 0.0,
            surface: bone.with_vertices(aside.collect()).unwrap(),
        }],
        jaw: Some(Jaw {
            pivot: [-0.4, 0.2, 0.1],
            shapes: BTreeMap::new(),
            residual_angle: 0.0,
            residual_max: 0.0,
        }),
        props: Props::default(),
    }
}

/// Fails where a cotangent of the network's answer for the joint is not the slope of `f` there.
pub fn assert_joint_slope(
    exact: &[f32; JOINT_SIZE],
    answer: &[f32; JOINT_SIZE],
    f: impl Fn(&[f32; JOINT_SIZE]) -> f64,
) {
    for k in 0..JOINT_SIZE {
        let at = |h: f32| {
            let mut moved = *answer;
            moved[k] += h;
            (f(&moved), f64::from(moved[k]))
        };
        let ((up, a), (down, b)) = (at(0.01), at(-0.01));
        let slope = (up - down) / (a - b);
        let error = (slope - f64::from(exact[k])).abs();
        assert!(
            error < 1e-3 * (1.0 + slope.abs()),
            "{k}: {slope} {}",
            exact[k]
        );
    }
}

pub fn shapes(scene: &Scene, body: &Body) -> Shapes {
    Shapes::new(scene, &inputs(), None, &body.vertex_weights).unwrap()
}

/// A result with a mean error of one hundredth of a diagonal of 2.
pub fn result(name: &str, set: ShapeSet) -> ShapeResult {
    ShapeResult {
        name: name.into(),
        set,
        mean_error: 0.02,
        max_error: 0.04,
        mean_error_percent: 1.0,
        max_error_percent: 2.0,
        energy: 0.5,
        iterations: 7,
        status: Status::Converged,
        seconds: 0.1,
        estimated_error: Some(1e-6),
        inverted_elements: 0,
        weighted_error: 0.02,
        error_p99: 0.04,
        joint: None,
        jaw_error: None,
        descriptor: vec![1.0, 0.0],
        target: Vec::new(),
        surface: Vec::new(),
        nodes: Vec::new(),
    }
}
