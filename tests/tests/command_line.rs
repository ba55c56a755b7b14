//! The program's three commands from the outside: files, numbers, exit codes.

use myofield_tests::{Ran, TinyScene, check};
use nalgebra::{Matrix3, Vector3};
use npyz::{DType, NpyFile, Order};
use std::path::Path;
use surface_mesh::primitives::icosphere;
use surface_mesh::{read_surface, write_obj};
use trainer::npy;

const CELLS: [usize; 3] = [4, 3, 2];
const SIZE: f64 = 0.25;
const ELEMENTS: usize = 24;
const NODES: usize = 60;
const SAMPLES: usize = 8;

/// A float64 or int64 array with its shape, whose type and order are what the documentation says.
fn array<T: npyz::Deserialize>(path: &Path, kind: &str, shape: &[usize]) -> Vec<T> {
    let bytes = std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let file = NpyFile::new(&bytes[..]).unwrap();
    let found: Vec<usize> = file.shape().iter().map(|&n| n as usize).collect();
    assert_eq!(found, shape, "{}", path.display());
    assert_eq!(file.order(), Order::C);
    match file.dtype() {
        DType::Plain(found) => assert_eq!(found.to_string(), kind, "{}", path.display()),
        other => panic!("{other:?}"),
    }
    file.into_vec().unwrap()
}

fn vectors(path: &Path, count: usize) -> Vec<Vector3<f64>> {
    let flat: Vec<f64> = array(path, "<f8", &[count, 3]);
    flat.chunks_exact(3)
        .map(Vector3::from_column_slice)
        .collect()
}

fn json(path: &Path) -> serde_json::Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// A smooth actuation with every entry in use.
fn actuation() -> Vec<f64> {
    let entry = |i: usize| 0.12 * (0.37 * i as f64).sin() + 0.05 * (0.011 * i as f64).cos();
    (0..ELEMENTS * SAMPLES * 6).map(entry).collect()
}

fn cotangent() -> Vec<f64> {
    (0..NODES * 3).map(|i| (1.3 * i as f64).cos()).collect()
}

/// A temporary folder with the inputs of a small box.
struct Bench(tempfile::TempDir);

impl Bench {
    fn new() -> Self {
        let bench = Self(tempfile::tempdir().unwrap());
        bench.write_actuation(&actuation());
        npy::write(&bench.path("C.npy"), &[NODES, 3], &cotangent()).unwrap();
        bench
    }

    fn path(&self, name: &str) -> std::path::PathBuf {
        self.0.path().join(name)
    }

    fn write_actuation(&self, values: &[f64]) {
        npy::write(&self.path("A.npy"), &[ELEMENTS, SAMPLES, 6], values).unwrap();
    }

    /// Solves the box with more options; the output goes to the folder `out`.
    fn solve(&self, options: &str, out: &str) -> Ran {
        check(format!(
            "solve --cells 4,3,2 --size {SIZE} --fix x=0 --actuation {} {options} --out {}",
            self.path("A.npy").display(),
            self.path(out).display(),
        ))
    }

    fn solve_with_cotangent(&self, options: &str, out: &str) -> Ran {
        let cotangent = self.path("C.npy");
        self.solve(
            &format!("{options} --cotangent {}", cotangent.display()),
            out,
        )
    }
}

/// Deformation gradient at a point of a cube from its corners, x slowest and z fastest, by the trilinear weights'
/// derivatives.
fn deformation_gradient(
    corners: &[Vector3<f64>; 8],
    low: &Vector3<f64>,
    point: &Vector3<f64>,
) -> Matrix3<f64> {
    let xi = (point - low) / SIZE;
    let mut f = Matrix3::zeros();
    for (n, position) in corners.iter().enumerate() {
        let high = [n >> 2 & 1 == 1, n >> 1 & 1 == 1, n & 1 == 1];
        let along = |axis: usize| if high[axis] { xi[axis] } else { 1.0 - xi[axis] };
        let slope = |axis: usize| if high[axis] { 1.0 / SIZE } else { -1.0 / SIZE };
        let gradient = Vector3::new(
            slope(0) * along(1) * along(2),
            along(0) * slope(1) * along(2),
            along(0) * along(1) * slope(2),
        );
        f += position * gradient.transpose();
    }
    f
}

/// `sum of volume / samples / 2 |F - R(F A) A|^2`, from the files alone.
fn energy_from_files(out: &Path, actuation: &[f64]) -> f64 {
    let rest = vectors(&out.join("rest.npy"), NODES);
    let positions = vectors(&out.join("positions.npy"), NODES);
    let elements: Vec<i64> = array(&out.join("elements.npy"), "<i8", &[ELEMENTS, 8]);
    let samples: Vec<f64> = array(&out.join("samples.npy"), "<f8", &[ELEMENTS, SAMPLES, 3]);
    let points = samples.chunks_exact(3).map(Vector3::from_column_slice);
    let mut energy = 0.0;
    for (i, (point, b)) in points.zip(actuation.chunks_exact(6)).enumerate() {
        let corners = &elements[i / SAMPLES * 8..][..8];
        let moved = std::array::from_fn(|n| positions[corners[n] as usize]);
        let f = deformation_gradient(&moved, &rest[corners[0] as usize], &point);
        #[rustfmt::skip]
        let a = Matrix3::identity() + Matrix3::new(b[0], b[1], b[2], b[1], b[3], b[4], b[2], b[4], b[5]);
        let r = polar_grad::polar_rotation(&(f * a));
        energy += 0.5 * (f - r * a).norm_squared() * SIZE.powi(3) / SAMPLES as f64;
    }
    energy
}

#[test]
fn solve_writes_every_file_in_the_documented_order() {
    let bench = Bench::new();
    bench
        .solve_with_cotangent("--rel-grad 1e-10", "D")
        .succeeds();
    let out = bench.path("D");
    let rest = vectors(&out.join("rest.npy"), NODES);
    let elements: Vec<i64> = array(&out.join("elements.npy"), "<i8", &[ELEMENTS, 8]);
    let samples: Vec<f64> = array(&out.join("samples.npy"), "<f8", &[ELEMENTS, SAMPLES, 3]);
    let weights: Vec<f64> = array(&out.join("sample_weights.npy"), "<f8", &[SAMPLES]);
    let _: Vec<f64> = array(
        &out.join("actuation_grad.npy"),
        "<f8",
        &[ELEMENTS, SAMPLES, 6],
    );
    let prescribed: Vec<i64> = array(&out.join("prescribed.npy"), "<i8", &[12]);
    let _ = vectors(&out.join("prescribed_grad.npy"), 12);
    let volume: f64 = weights.iter().sum();
    assert!((volume - SIZE.powi(3)).abs() < 1e-15);
    let extent = CELLS.map(|n| n as f64 * SIZE);
    for x in &rest {
        assert!((0..3).all(|i| (0.0..=extent[i]).contains(&x[i])), "{x}");
    }
    for (e, corners) in elements.chunks_exact(8).enumerate() {
        let low = rest[corners[0] as usize];
        for (n, &corner) in corners.iter().enumerate() {
            let offset = Vector3::new(n >> 2 & 1, n >> 1 & 1, n & 1).map(|i| i as f64 * SIZE);
            assert_eq!(rest[corner as usize], low + offset);
        }
        // Two-point Gauss along each axis, samples ordered as corners are.
        let gauss = [0.5 - 0.5 / 3.0_f64.sqrt(), 0.5 + 0.5 / 3.0_f64.sqrt()];
        for (i, point) in samples[e * SAMPLES * 3..][..SAMPLES * 3]
            .chunks_exact(3)
            .enumerate()
        {
            let xi = Vector3::new(gauss[i >> 2 & 1], gauss[i >> 1 & 1], gauss[i & 1]);
            let expected = low + xi * SIZE;
            assert!((Vector3::from_column_slice(point) - expected).norm() < 1e-14);
        }
    }
    let positions = vectors(&out.join("positions.npy"), NODES);
    let held = |n: &usize| rest[*n].x == 0.0;
    let expected: Vec<i64> = (0..NODES).filter(held).map(|n| n as i64).collect();
    assert_eq!(prescribed, expected);
    for &node in &prescribed {
        assert_eq!(positions[node as usize], rest[node as usize]);
    }
    let stats = json(&out.join("stats.json"));
    for key in [
        "iterations",
        "residual",
        "energy",
        "setup_s",
        "forward_s",
        "backward_s",
    ] {
        assert!(stats[key].is_number(), "{key}: {}", stats[key]);
    }
    assert_eq!(stats["status"], "converged");
    assert_eq!(stats["adjoint_status"], "converged");
    assert!(stats["residual"].as_f64().unwrap() <= 1e-10);
    assert_eq!(stats["peak_mb"].is_number(), cfg!(target_os = "linux"));
}

#[test]
fn the_energy_is_that_of_the_files() {
    let bench = Bench::new();
    bench.solve("--rel-grad 1e-8", "D").succeeds();
    let out = bench.path("D");
    let expected = energy_from_files(&out, &actuation());
    let found = json(&out.join("stats.json"))["energy"].as_f64().unwrap();
    assert!(
        (found - expected).abs() <= 1e-12 * expected,
        "{found} {expected}"
    );
    bench.solve("--rel-grad 1e-8 --stiffness 3", "E").succeeds();
    let stiff = json(&bench.path("E/stats.json"))["energy"]
        .as_f64()
        .unwrap();
    assert!(
        (stiff - 3.0 * expected).abs() <= 1e-8 * expected,
        "{stiff} {expected}"
    );
}

#[test]
fn the_gradient_is_the_slope_of_the_program() {
    let bench = Bench::new();
    bench
        .solve_with_cotangent("--rel-grad 1e-12", "D")
        .succeeds();
    let shape = [ELEMENTS, SAMPLES, 6];
    let gradient: Vec<f64> = array(&bench.path("D/actuation_grad.npy"), "<f8", &shape);
    let loss = |entry: usize, step: f64| {
        let mut moved = actuation();
        moved[entry] += step;
        bench.write_actuation(&moved);
        bench.solve("--rel-grad 1e-12", "M").succeeds();
        let positions: Vec<f64> = array(&bench.path("M/positions.npy"), "<f8", &[NODES, 3]);
        positions
            .iter()
            .zip(cotangent())
            .map(|(x, c)| x * c)
            .sum::<f64>()
    };
    let size = gradient.iter().fold(0.0_f64, |m, g| m.max(g.abs()));
    let h = 2e-3;
    // One entry of each of the six kinds, spread over elements and samples.
    for kind in 0..6 {
        let entry = (kind * 4 * SAMPLES + kind) * 6 + kind;
        let outer = loss(entry, 2.0 * h) - loss(entry, -2.0 * h);
        let slope = (8.0 * (loss(entry, h) - loss(entry, -h)) - outer) / (12.0 * h);
        let error = (slope - gradient[entry]).abs();
        assert!(
            error < 1e-6 * gradient[entry].abs().max(0.1 * size),
            "{slope} {}",
            gradient[entry]
        );
    }
    // A body moved as a whole goes along: the gradient by the held nodes sums to what the loss gains.
    let held: Vec<f64> = array(&bench.path("D/prescribed_grad.npy"), "<f8", &[12, 3]);
    for axis in 0..3 {
        let by_held: f64 = held.iter().skip(axis).step_by(3).sum();
        let of_loss: f64 = cotangent().iter().skip(axis).step_by(3).sum();
        assert!((by_held - of_loss).abs() < 1e-8, "{by_held} {of_loss}");
    }
}

#[test]
fn a_second_run_and_one_thread_give_the_same_bits() {
    let bench = Bench::new();
    let bits = |out: &str| {
        let names = ["positions.npy", "actuation_grad.npy"];
        names.map(|name| std::fs::read(bench.path(out).join(name)).unwrap())
    };
    bench
        .solve_with_cotangent("--rel-grad 1e-10", "D")
        .succeeds();
    bench
        .solve_with_cotangent("--rel-grad 1e-10", "E")
        .succeeds();
    assert!(bits("D") == bits("E"));
    let line = format!(
        "solve --cells 4,3,2 --size {SIZE} --fix x=0 --actuation {} --rel-grad 1e-10 --cotangent {} --out {}",
        bench.path("A.npy").display(),
        bench.path("C.npy").display(),
        bench.path("F").display(),
    );
    let alone = std::process::Command::new(myofield_tests::program())
        .args(line.split_whitespace())
        .env("RAYON_NUM_THREADS", "1")
        .output()
        .unwrap();
    assert!(alone.status.success());
    assert_eq!(json(&bench.path("F/stats.json"))["threads"], 1);
    assert!(bits("D") == bits("F"));
}

#[test]
fn the_accuracy_asked_for_is_reached() {
    let bench = Bench::new();
    for method in [
        "automatic",
        "multigrid",
        "lbfgs",
        "newton",
        "anderson",
        "local-global",
    ] {
        bench.solve("--rel-grad 1e-12", "exact").succeeds();
        let exact = vectors(&bench.path("exact/positions.npy"), NODES);
        for accuracy in [1e-3, 1e-5, 1e-7] {
            bench
                .solve(
                    &format!("--accuracy {accuracy} --method {method} --max-iterations 20000"),
                    "D",
                )
                .succeeds();
            let found = vectors(&bench.path("D/positions.npy"), NODES);
            let off = found.iter().zip(&exact).map(|(a, b)| (a - b).norm());
            let off = off.fold(0.0, f64::max);
            assert!(off <= accuracy, "{method}: {off} for {accuracy}");
            let stats = json(&bench.path("D/stats.json"));
            assert!(stats["estimated_error"].as_f64().unwrap() <= accuracy);
        }
    }
}

#[test]
fn what_did_not_converge_says_so() {
    let bench = Bench::new();
    bench
        .solve_with_cotangent("--rel-grad 1e-10", "D")
        .succeeds();
    let ran = bench.solve_with_cotangent("--rel-grad 1e-10 --max-iterations 1", "D");
    assert_eq!(ran.code, Some(3), "{}", ran.stderr);
    let stats = json(&bench.path("D/stats.json"));
    assert_eq!(stats["status"], "iteration_limit");
    assert_eq!(stats["adjoint_status"], "forward_not_converged");
    // Not even an older one: it would be taken for this solve's.
    for name in [
        "actuation_grad.npy",
        "prescribed_grad.npy",
        "prescribed.npy",
    ] {
        assert!(!bench.path("D").join(name).exists(), "{name}");
    }
    bench.write_actuation(&[1e160; ELEMENTS * SAMPLES * 6]);
    assert_eq!(bench.solve("--rel-grad 1e-10", "D").code, Some(3));
    let stats = json(&bench.path("D/stats.json"));
    assert_eq!(stats["status"], "not_finite");
    assert!(stats["residual"].is_null() && stats["energy"].is_null());
    assert_eq!(check("solve --nonsense").code, Some(2));
    assert_eq!(check("--version").code, Some(0));
    assert_eq!(check("solve --help").code, Some(0));
}

#[test]
fn solve_takes_a_surface_and_leaves_a_passive_body_at_rest() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    write_obj(path("ball.obj"), &icosphere(3, 1.0)).unwrap();
    check(format!(
        "solve --surface {} --element-size 0.2 --samples 1 --fix z<-0.7 --fix z=max --out {}",
        path("ball.obj").display(),
        path("D").display(),
    ))
    .succeeds();
    let stats = json(&path("D/stats.json"));
    let [nodes, elements] = ["nodes", "elements"].map(|k| stats[k].as_u64().unwrap() as usize);
    // Five cells to a radius: the volume of a ball is met within a tenth.
    let share = elements as f64 * 0.2_f64.powi(3) / (4.0 / 3.0 * std::f64::consts::PI);
    assert!((0.9..1.1).contains(&share), "{share}");
    let rest = vectors(&path("D/rest.npy"), nodes);
    assert_eq!(rest, vectors(&path("D/positions.npy"), nodes));
    let _: Vec<f64> = array(&path("D/samples.npy"), "<f8", &[elements, 1, 3]);
    let top = rest.iter().fold(0.0_f64, |m, x| m.max(x.z));
    let held = rest
        .iter()
        .filter(|x| x.z < -0.699 || x.z > top - 1e-9)
        .count();
    assert_eq!(stats["prescribed"].as_u64(), Some(held as u64));
    assert!(stats["energy"].as_f64().unwrap() < 1e-24);
}

fn decodes(path: &Path) {
    let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    assert!(info.width > 200 && info.height > 100, "{}", path.display());
    assert!(pixels.iter().any(|&p| p != pixels[0]), "{}", path.display());
}

/// What the issue of every evaluation has to be: an entry per shape in the table, the metrics, the meshes and a picture.
fn check_evaluation(folder: &Path, stdout: &str, expected: &[(&str, &str)]) -> serde_json::Value {
    let metrics = json(&folder.join("metrics.json"));
    let diagonal = metrics["bbox_diagonal"].as_f64().unwrap();
    assert!((diagonal - 12.0_f64.sqrt()).abs() < 0.2, "{diagonal}");
    assert_eq!(metrics["unit"], "cm");
    let shapes = metrics["shapes"].as_array().unwrap();
    let found: Vec<(&str, &str)> = (shapes.iter())
        .map(|s| (s["name"].as_str().unwrap(), s["set"].as_str().unwrap()))
        .collect();
    assert_eq!(found, expected);
    for shape in shapes {
        let number = |key: &str| shape[key].as_f64().unwrap();
        assert!(number("mean_error") > 0.0 && number("mean_error") <= number("max_error"));
        assert!(number("max_error") < diagonal && number("energy") >= 0.0);
        assert!(number("seconds") > 0.0);
        assert!(shape["iterations"].is_u64() && shape["inverted_elements"].is_u64());
        assert_eq!(shape["status"], "converged");
    }
    let meshes = read_surface(folder.join("shapes.glb")).unwrap();
    let names = meshes.targets.iter().map(|t| t.name.as_str());
    assert!(names.eq(expected.iter().map(|e| e.0)));
    for (target, shape) in meshes.targets.iter().zip(shapes) {
        assert_eq!(target.deltas.len(), meshes.surface.vertex_count());
        assert!(
            target.deltas.iter().any(|d| d.norm() > 0.0),
            "{}",
            target.name
        );
        assert!(stdout.contains(&target.name), "{stdout}");
        assert!(stdout.contains(&format!("{:.5}", shape["mean_error"].as_f64().unwrap())));
    }
    decodes(&folder.join("sheet-1.png"));
    metrics
}

#[test]
fn a_scene_is_trained_and_evaluated() {
    let tiny = TinyScene::new(60, 3);
    let run = tiny.path("run");
    let trained = check(format!(
        "train {} --out {}",
        tiny.scene().display(),
        run.display()
    ))
    .succeeds();
    let used = std::fs::read_to_string(run.join("scene.toml")).unwrap();
    assert_eq!(used, std::fs::read_to_string(tiny.scene()).unwrap());
    for name in ["checkpoint.safetensors", "model.safetensors", "inputs.glb"] {
        assert!(run.join(name).exists(), "{name}");
    }
    decodes(&run.join("loss-1.png"));
    decodes(&run.join("loss-2.png"));
    let own = [
        ("bend", "train"),
        ("rise", "train"),
        ("turn", "train"),
        ("both", "held_out"),
    ];
    let first = check_evaluation(&run.join("evaluation"), &trained.stdout, &own);

    let out = tiny.path("more");
    let evaluated = check(format!(
        "eval {} --shapes {} --weights bend=0.5,turn=0.5 --out {}",
        run.display(),
        tiny.path("other.glb").display(),
        out.display()
    ))
    .succeeds();
    let mut all = own.to_vec();
    all.extend([("lean", "held_out"), ("0.5 bend + 0.5 turn", "blend")]);
    let second = check_evaluation(&out, &evaluated.stdout, &all);
    for shape in 0..own.len() {
        let of = |metrics: &serde_json::Value| metrics["shapes"][shape]["mean_error"].clone();
        assert_eq!(of(&first), of(&second));
    }
    // A blend that is a training shape is told from the trained shape by its name alone.
    let whole = check(format!("eval {} --weights rise=1", run.display())).succeeds();
    let metrics = json(&run.join("evaluation/metrics.json"));
    assert_eq!(
        metrics["shapes"][1]["mean_error"],
        metrics["shapes"][4]["mean_error"]
    );
    assert!(whole.stdout.contains("1 rise"));

    let coarse = check(format!("eval {} --element-size 0.55", run.display())).succeeds();
    let third = check_evaluation(&run.join("evaluation"), &coarse.stdout, &own);
    assert_eq!(third["element_size"], 0.55);
    assert!(third["elements"].as_u64() < first["elements"].as_u64());
}

#[test]
fn training_learns() {
    let tiny = TinyScene::new(200, 10);
    let run = tiny.path("run");
    check(format!(
        "train {} --out {}",
        tiny.scene().display(),
        run.display()
    ))
    .succeeds();
    let metrics = json(&run.join("evaluation/metrics.json"));
    let diagonal = metrics["bbox_diagonal"].as_f64().unwrap();
    for shape in &metrics["shapes"].as_array().unwrap()[..3] {
        let error = shape["mean_error"].as_f64().unwrap() / diagonal;
        // The targets are away by 2 to 4 % of the diagonal in the mean.
        assert!(error < 0.01, "{}: {error}", shape["name"]);
    }
}
