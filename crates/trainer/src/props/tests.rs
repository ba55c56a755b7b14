//! What effects know by name: read, kept with a run, put into effects, moved by the joint.

use super::*;
use crate::body::Body;
use crate::fixture;
use crate::hanging::Hanging;
use crate::rig::Rig;
use crate::scene::Scene;
use surface_mesh::primitives::icosphere;
use surface_mesh::write_obj;

const NAMED: &str = r#"
[[obstacle]]
name = "ground"
file = "ground.obj"
region = { type = "half_space", normal = [0, 1, 0], offset = -1.6 }
[[obstacle]]
name = "tongue"
file = "tongue.obj"
moves = true
[jaw]
pivot = [-0.4, 0.2, 0.1]
[[paint]]
name = "right"
file = "right.txt"
[[effects]]
type = "contact"
distance = 0.05
own = false
obstacles = ["ground", { type = "plane", normal = [0, 1, 0], offset = -9 }, "tongue"]
[[effects]]
type = "activation"
elements = "right"
scale = 0
"#;

struct Folder(tempfile::TempDir);

impl Folder {
    /// Balls below the unit ball and beside it, and paint on its right half.
    fn new() -> Self {
        let folder = Self(tempfile::tempdir().unwrap());
        let ball = |middle: [f64; 3], radius| {
            let ball = icosphere(1, radius);
            let moved = ball.vertices().iter().map(|x| x + Vector3::from(middle));
            ball.with_vertices(moved.collect()).unwrap()
        };
        write_obj(folder.file("ground.obj"), &ball([0.0, -2.0, 0.0], 0.9)).unwrap();
        write_obj(folder.file("tongue.obj"), &ball([0.0, 0.0, 1.5], 0.4)).unwrap();
        let right = fixture::inputs().surface;
        let right = right
            .vertices()
            .iter()
            .map(|x| f64::from(u8::from(x.x > 0.0)));
        let lines: Vec<String> = right.map(|s| s.to_string()).collect();
        let text = format!("# the right half\n\n{}\n", lines.join("  # a share\n"));
        std::fs::write(folder.file("right.txt"), text).unwrap();
        folder
    }

    fn file(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn load(&self, text: &str) -> (Scene, Result<Rig>) {
        let scene = fixture::scene(text);
        let rig = Rig::load(&scene, self.0.path());
        (scene, rig)
    }

    fn body(&self, text: &str) -> (Scene, Result<Body>) {
        let (scene, rig) = self.load(text);
        let surface = fixture::inputs().surface;
        let body = rig.and_then(|rig| Body::of_scene(&scene, surface, &rig, 0.4));
        (scene, body)
    }

    fn error(&self, text: &str) -> String {
        let (scene, body) = self.body(text);
        let error = body.and_then(|body| body.effects(&scene).map(drop));
        error.expect_err("refused").to_string()
    }
}

#[test]
fn a_run_keeps_them_as_they_were_read() {
    let folder = Folder::new();
    let rig = folder.load(NAMED).1.unwrap();
    let [ground, tongue] = &rig.props.obstacles[..] else {
        panic!("{:?}", rig.props);
    };
    // The part above -1.6 of a ball that reaches to -1.1.
    assert!(ground.surface.triangles().len() < tongue.surface.triangles().len() / 2);
    assert!(ground.surface.vertices().iter().all(|x| x.y >= -1.6));
    assert!(tongue.moves && !ground.moves);
    let kept = folder.file("rig");
    rig.write(&kept).unwrap();
    let again = Rig::read(&kept).unwrap();
    assert_eq!(again.props.paints, rig.props.paints);
    assert_eq!(again.jaw, rig.jaw);
    for (a, b) in again.props.obstacles.iter().zip(&rig.props.obstacles) {
        assert_eq!((&a.name, a.moves), (&b.name, b.moves));
        assert_eq!(a.surface.triangles(), b.surface.triangles());
        let pairs = a.surface.vertices().iter().zip(b.surface.vertices());
        // Single precision.
        assert!(pairs.into_iter().all(|(a, b)| (a - b).norm() < 1e-6));
    }
    let nothing = Rig::default();
    nothing.write(&folder.file("none")).unwrap();
    assert!(!folder.file("none").exists());
}

/// Half of the skin is painted: the elements of that half are, those of the other are not.
#[test]
fn effects_get_what_they_name() {
    let folder = Folder::new();
    let (scene, body) = folder.body(NAMED);
    let body = body.unwrap();
    let effects = body.effects(&scene).unwrap();
    let mut met = 0;
    for effect in &effects {
        match effect {
            EffectSpec::Contact { obstacles, .. } => {
                let counts = obstacles.iter().map(|o| match o {
                    Obstacle::Surface { vertices, .. } => vertices.len(),
                    _ => 0,
                });
                let props = &body.props.obstacles;
                let own = |i: usize| props[i].surface.vertex_count();
                assert_eq!(counts.collect::<Vec<_>>(), [own(0), 0, own(1)]);
                met += 1;
            }
            EffectSpec::Activation { elements, .. } => {
                let ElementSet::Painted(shares) = elements else {
                    panic!("{elements:?}");
                };
                for (e, share) in shares.iter().enumerate() {
                    let x = body.mesh.element_corner(e).x + 0.2;
                    if x.abs() > 0.3 {
                        assert_eq!(*share > 0.5, x > 0.0, "{x} {share}");
                    }
                }
                met += 1;
            }
            _ => {}
        }
    }
    assert_eq!(met, 2);
    body.solver(&scene).unwrap();
}

/// The joint moves what moves and nothing else, and its cotangent is the slope.
#[test]
fn the_joint_moves_obstacles() {
    let folder = Folder::new();
    let (scene, body) = folder.body(NAMED);
    let body = body.unwrap();
    let solver = body.solver(&scene).unwrap();
    let hanging = Hanging::new(&body, &scene.effects, &solver).unwrap();
    let rest = solver.rest_parameters();
    let first = body.props.obstacles[0].surface.vertex_count();
    let mut bar = rest.clone();
    bar.obstacles
        .iter_mut()
        .enumerate()
        .for_each(|(i, bar)| *bar = Vector3::new((i as f64).sin(), (i as f64).cos(), 0.3));
    let at = |theta| {
        let mut parameters = rest.clone();
        hanging.place(theta, &mut parameters);
        parameters
    };
    let answer = [0.2, -0.1, 0.5, -0.3, 0.4];
    let moved = at(hanging.parameters(&answer));
    for (i, (a, b)) in moved.obstacles.iter().zip(&rest.obstacles).enumerate() {
        assert_eq!(a != b, i >= first, "{i}");
    }
    let exact = hanging.vjp(hanging.parameters(&answer), &bar);
    fixture::assert_joint_slope(&exact, &answer, |answer| {
        let moved = at(hanging.parameters(answer)).obstacles;
        let pairs = moved.iter().zip(&bar.obstacles);
        pairs.map(|(x, b)| x.dot(b)).sum()
    });
}

#[test]
fn what_is_wrong_is_told_with_its_place() {
    let folder = Folder::new();
    std::fs::write(folder.file("bad.txt"), "0.5\n1\n\n1.5 # too much\n").unwrap();
    std::fs::write(folder.file("short.txt"), "0.5\n1\n").unwrap();
    for (from, to, expected) in [
        ("\"ground\", {", "\"grund\", {", "did you mean `ground`?"),
        ("\"ground\", {", "\"grund\", {", "ball.toml:"),
        (
            "elements = \"right\"",
            "elements = \"left\"",
            "names the paint `left`",
        ),
        ("right.txt", "bad.txt", "bad.txt:4: `1.5` is no share"),
        (
            "right.txt",
            "short.txt",
            "has 2 shares, and the surface 162 vertices",
        ),
        ("right.txt", "none.txt", "cannot read the paint"),
        ("ground.obj", "none.obj", "none.obj"),
        (
            "offset = -1.6",
            "offset = 7",
            "nothing lies in the region of `ground`",
        ),
        (
            "name = \"tongue\"",
            "name = \"ground\"",
            "have the name `ground`",
        ),
        (
            "pivot = [-0.4, 0.2, 0.1]",
            "",
            "the obstacle `tongue` moves, but",
        ),
    ] {
        assert!(NAMED.contains(from), "{from}");
        let message = folder.error(&NAMED.replace(from, to));
        assert!(message.contains(expected), "{message}");
    }
}
