//! Fits on the tiny ball, trained for a moment.

use super::*;
use crate::evaluate::Evaluator;
use crate::fixture;
use crate::rig::Rig;
use crate::shapes::difference;
use std::path::Path;
use surface_mesh::{MorphTarget, MorphedSurface, Surface, read_surface, write_glb, write_obj};

/// A trained ball in a folder of its own.
struct Ball {
    folder: tempfile::TempDir,
    run: Run,
    trained: Trained,
}

impl Ball {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let text = fixture::SCENE.replace("[stage1]\nepochs = 2", "[stage1]\nepochs = 150");
        let inputs = fixture::inputs();
        let run = Run::create(
            &folder.path().join("run"),
            &text,
            &inputs,
            &Rig::default(),
            None,
        )
        .unwrap();
        crate::train::train(&run).unwrap();
        let trained = Trained::load(&run, &Changes::default()).unwrap();
        Self {
            folder,
            run,
            trained,
        }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The surface that a code makes which no descriptor gives: off that of `long`, in a direction that the encoder does not know.
    fn strange(&self) -> Surface {
        let Trained {
            scene, body, net, ..
        } = &self.trained;
        let unit = code_unit(&self.trained.shapes, net).unwrap() as f32;
        let mut latent = net.latent(&[1.0, 0.0]).unwrap();
        for (z, share) in latent.iter_mut().zip([0.12, -0.1, 0.1, -0.12]) {
            *z += share * unit;
        }
        let answer = net
            .evaluate_latent(&latent, &body.actuated().coordinates)
            .unwrap();
        let mut evaluator = Evaluator::new(body, scene).unwrap();
        let found = evaluator.equilibrium(&answer, None).unwrap();
        let vertices = body.surface_positions(&found.solution.positions);
        body.surface.with_vertices(vertices).unwrap()
    }

    fn fit(&self, source: FitSource) -> Result<Fit> {
        let request = FitRequest {
            source,
            steps: DEFAULT_STEPS,
            changes: Changes::default(),
            out: Some(self.path("out")),
        };
        fit(&self.run, &request)
    }

    fn fit_scan(&self, surface: &Surface, reach: Option<f64>) -> Result<Fit> {
        let path = self.path("scan.obj");
        write_obj(&path, surface).unwrap();
        let files = vec![path];
        self.fit(FitSource::Scans { files, reach })
    }

    /// What the fit says about a scan that it refuses.
    fn refuses(&self, surface: &Surface, reach: Option<f64>) -> String {
        let message = self.fit_scan(surface, reach).err().unwrap().to_string();
        assert!(!self.path("out").join("fit.json").exists());
        message
    }
}

/// The same surface with every triangle cut into four, and no two triangles sharing a vertex.
fn subdivided(surface: &Surface) -> Surface {
    let mut vertices = Vec::new();
    for t in surface.triangles() {
        let [a, b, c] = t.map(|v| surface.vertices()[v as usize]);
        let [p, q, r] = [(a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0];
        vertices.extend([a, p, r, p, b, q, r, q, c, p, q, r]);
    }
    let triangles = (0..vertices.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]);
    let triangles = triangles.collect();
    Surface::from_triangles(vertices, triangles).unwrap()
}

/// The triangles on one side of a plane.
fn half(surface: &Surface) -> Surface {
    let vertices = surface.vertices();
    let side = |t: &&[u32; 3]| t.iter().all(|v| vertices[*v as usize].x > -0.1);
    let triangles = surface.triangles().iter().filter(side).copied();
    Surface::from_triangles(vertices.to_vec(), triangles.collect()).unwrap()
}

fn moved(surface: &Surface, how: impl Fn(&Vector3<f64>) -> Vector3<f64>) -> Surface {
    let vertices = surface.vertices().iter().map(how);
    surface.with_vertices(vertices.collect()).unwrap()
}

fn json(path: &Path) -> serde_json::Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

#[test]
fn a_code_that_no_descriptor_gives_is_recovered() {
    let ball = Ball::new();
    let (strange, inputs) = (ball.strange(), fixture::inputs());
    let rest = inputs.surface.vertices();
    let target = MorphTarget {
        name: "strange".into(),
        deltas: difference(strange.vertices(), rest),
    };
    let file = ball.path("strange.glb");
    let targets = MorphedSurface::new(inputs.surface.clone(), vec![target]).unwrap();
    write_glb(&file, &targets).unwrap();
    let fitted = ball.fit(FitSource::Shapes { file, units: None }).unwrap();
    let shape = &fitted.shapes[0];
    println!("{}", fit_table(&fitted));
    assert!(shape.before.mean > 0.002 * ball.trained.body.diagonal);
    assert!(shape.after.mean < 0.1 * shape.before.mean);
    assert!(shape.loss_after < 0.02 * shape.loss_before);
    assert!(shape.simulations <= DEFAULT_STEPS + 2);

    // What is written can be used again: the code alone makes the shape.
    let written = &json(&fitted.folder.join("fit.json"))["shapes"][0];
    let latent: Vec<f32> = serde_json::from_value(written["latent"].clone()).unwrap();
    assert_eq!(latent, shape.latent);
    let Trained {
        scene, body, net, ..
    } = &ball.trained;
    let answer = net
        .evaluate_latent(&latent, &body.actuated().coordinates)
        .unwrap();
    let mut evaluator = Evaluator::new(body, scene).unwrap();
    let again = evaluator.equilibrium(&answer, None).unwrap();
    let surface = body.surface_positions(&again.solution.positions);
    let kept = read_surface(fitted.folder.join("fit.glb")).unwrap();
    for (a, b) in surface.iter().zip(kept.shape(0)) {
        assert!((a - b).norm() < 1e-5, "{a} {b}");
    }
    assert!(fitted.folder.join("fit-sheet-1.png").exists());
}

#[test]
fn a_scan_of_other_triangles_is_reached() {
    let ball = Ball::new();
    let scan = subdivided(&ball.strange());
    let fitted = ball.fit_scan(&scan, None).unwrap();
    let shape = &fitted.shapes[0];
    println!("{}", fit_table(&fitted));
    assert_eq!(
        (shape.name.as_str(), shape.start.as_str()),
        ("scan", "long")
    );
    assert!(shape.after.mean < 0.25 * shape.before.mean);
    assert!(shape.left_out.unwrap().total() < 0.02);

    // Of one half, the other is left out, mostly because the border is nearest to it.
    let fitted = ball.fit_scan(&half(&scan), Some(0.6)).unwrap();
    let shape = &fitted.shapes[0];
    println!("{}", fit_table(&fitted));
    let left_out = shape.left_out.unwrap();
    assert!((0.2..0.7).contains(&left_out.total()), "{left_out:?}");
    assert!(left_out.border > 0.0 && left_out.far > 0.0);
    assert!(shape.after.mean < 0.5 * shape.before.mean);
}

#[test]
fn scans_that_do_not_fit_are_refused_with_the_mend() {
    let ball = Ball::new();
    let scan = moved(&fixture::inputs().surface, |x| x * 1.05);
    let message = ball.refuses(&moved(&scan, |x| x * 10.0), None);
    let parts = [
        "scan.obj",
        "diagonal of 36.37",
        "3.4641 units",
        "scale it to units",
    ];
    assert!(parts.iter().all(|p| message.contains(p)), "{message}");
    let message = ball.refuses(&moved(&scan, |x| x + Vector3::new(0.0, 5.0, 0.0)), None);
    let parts = ["beside the body", "move and turn it"];
    assert!(parts.iter().all(|p| message.contains(p)), "{message}");
    let message = ball.refuses(&moved(&scan, |x| x * 2.0), Some(0.1));
    assert!(message.contains("within 0.1: move the scan"), "{message}");
    let inside_out = scan.triangles().iter().map(|[a, b, c]| [*a, *c, *b]);
    let inside_out = Surface::from_triangles(scan.vertices().to_vec(), inside_out.collect());
    let message = ball.refuses(&inside_out.unwrap(), None);
    assert!(message.contains("only 0.0 %"), "{message}");
    assert!(
        message.contains("turn the scan's triangles round"),
        "{message}"
    );
    for reach in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let message = ball.refuses(&scan, Some(reach));
        assert!(message.contains("--scan-reach"), "{message}");
    }
    let files = vec![ball.path("none.obj")];
    let message = ball.fit(FitSource::Scans { files, reach: None });
    assert!(message.err().unwrap().to_string().contains("none.obj"));
}

#[test]
fn shapes_and_steps_that_do_not_fit_are_refused() {
    let ball = Ball::new();
    let other = surface_mesh::primitives::icosphere(1, 1.0);
    let deltas = vec![Vector3::x(); other.vertex_count()];
    let name = "far".to_string();
    let other = MorphedSurface::new(other, vec![MorphTarget { name, deltas }]).unwrap();
    let file = ball.path("other.glb");
    write_glb(&file, &other).unwrap();
    let source = FitSource::Shapes { file, units: None };
    let message = ball.fit(source.clone()).err().unwrap().to_string();
    assert!(
        message.contains("has 42 vertices, but the body's surface has 162"),
        "{message}"
    );
    let request = FitRequest {
        source,
        steps: 0,
        changes: Changes::default(),
        out: None,
    };
    let message = fit(&ball.run, &request).err().unwrap().to_string();
    assert!(message.contains("--fit-steps 0"), "{message}");
}
