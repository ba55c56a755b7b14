//! Performances from the outside: curves and paths of codes in, an animation, pictures and numbers out; frames as shapes.

use myofield_tests::{Ran, TinyScene, check, refused_and_unchanged, tree};
use std::path::{Path, PathBuf};
use surface_mesh::primitives::icosphere;
use surface_mesh::read_surface;

/// A trained tiny scene.
struct Trained {
    tiny: TinyScene,
    run: PathBuf,
}

impl Trained {
    fn new(stage1: usize, stage2: usize) -> Self {
        let tiny = TinyScene::new(stage1, stage2);
        let run = tiny.path("run");
        let line = format!("train {} --out {}", tiny.scene().display(), run.display());
        check(line).succeeds();
        Self { tiny, run }
    }

    /// Writes a file and gives its path.
    fn file(&self, name: &str, text: &str) -> String {
        std::fs::write(self.tiny.path(name), text).unwrap();
        self.tiny.path(name).display().to_string()
    }

    fn eval(&self, options: &str) -> Ran {
        check(format!("eval {} {options}", self.run.display()))
    }

    /// Evaluating with these options is refused, and neither the run nor another folder changes.
    #[track_caller]
    fn refuses(&self, options: &str, parts: &[&str]) {
        let line = format!("eval {} {options}", self.run.display());
        refused_and_unchanged(&line, &self.run, parts);
        let out = self.tiny.path("out");
        refused_and_unchanged(format!("{line} --out {}", out.display()), &out, parts);
    }
}

fn json(path: &Path) -> serde_json::Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// Width and height of a picture that is not of one colour.
fn size_of(path: &Path) -> [u32; 2] {
    let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    assert!(pixels.iter().any(|&p| p != pixels[0]), "{}", path.display());
    [info.width, info.height]
}

/// Checks all files of a performance in an evaluation folder, and returns its numbers.
fn check_performance(evaluation: &Path, ran: &Ran, names: &[&str], fps: f64) -> serde_json::Value {
    let folder = evaluation.join("performance");
    let pictures = (1..=names.len()).map(|i| format!("frame-{i:04}.png"));
    let mut expected: Vec<PathBuf> = pictures.map(|name| folder.join(name)).collect();
    let size = size_of(&expected[0]);
    for picture in &expected {
        assert_eq!(size_of(picture), size);
    }
    size_of(&folder.join("contact-sheet.png"));
    let others = ["animation.glb", "contact-sheet.png", "performance.json"];
    expected.extend(others.map(|name| folder.join(name)));
    expected.sort();
    let found: Vec<PathBuf> = tree(&folder).into_keys().collect();
    assert_eq!(found, expected);

    let numbers = json(&folder.join("performance.json"));
    assert_eq!(numbers["fps"].as_f64(), Some(fps));
    let frames = numbers["frames"].as_array().unwrap();
    let found: Vec<&str> = frames.iter().map(|f| f["name"].as_str().unwrap()).collect();
    assert_eq!(found, names);
    for (i, frame) in frames.iter().enumerate() {
        assert_eq!(frame["frame"], i + 1);
        assert!((frame["time"].as_f64().unwrap() - i as f64 / fps).abs() < 1e-12);
        assert_eq!(frame["start"], if i == 0 { "rest" } else { "previous" });
        assert_eq!(frame["status"], "converged");
        assert!(frame["inverted_elements"].is_u64() && frame["iterations"].is_u64());
        let row = format!("{:.5}", frame["mean_error"].as_f64().unwrap());
        assert!(ran.stdout.contains(&row), "{}", ran.stdout);
    }
    let meshes = read_surface(folder.join("animation.glb")).unwrap();
    let named = names.iter().enumerate();
    let named = named.map(|(i, name)| format!("{:04} {name}", i + 1));
    assert!(named.eq(meshes.targets.iter().map(|t| t.name.clone())));
    assert!(ran.stdout.contains(&format!("{} frames", names.len())));
    assert!(ran.stdout.contains("linear blend"), "{}", ran.stdout);
    numbers
}

#[test]
fn curves_and_paths_become_performances() {
    let trained = Trained::new(60, 3);
    let before = tree(&trained.run.join("evaluation"));
    let evaluation = trained.run.join("evaluation");
    let text = "frame,bend,turn\none,0,0\ntwo,0.5,0.25\nthree,1,0.5\nthree,1,1\n";
    let csv = trained.file("curves.csv", text);
    let ran = trained.eval(&format!("--curves {csv}")).succeeds();
    let names = ["one", "two", "three", "three"];
    let first = check_performance(&evaluation, &ran, &names, 24.0);
    assert_eq!(first["source"], "curves");
    // The shapes' evaluation is left alone.
    for (path, bytes) in before {
        assert!(std::fs::read(&path).unwrap() == bytes, "{}", path.display());
    }
    // Frames end at the same place as shapes that are solved by themselves.
    let out = trained.tiny.path("blends");
    let single = format!("--weights bend=0.5,turn=0.25 --out {}", out.display());
    trained.eval(&single).succeeds();
    let alone = json(&out.join("metrics.json"))["shapes"][4]["mean_error"].as_f64();
    let warm = first["frames"][1]["mean_error"].as_f64().unwrap();
    assert!((alone.unwrap() - warm).abs() < 1e-3 * 12.0_f64.sqrt());

    // The same as JSON, without the last frame: its picture goes.
    let text = r#"{ "frames": [ { "name": "one", "weights": {} },
        { "name": "two", "weights": { "turn": 0.25, "bend": 0.5 }, "jaw": { "rms_cm": 0.0 } },
        { "weights": { "bend": 1, "turn": 0.5 } } ] }"#;
    let file = trained.file("curves.json", text);
    let ran = trained
        .eval(&format!("--curves {file} --fps 12.5"))
        .succeeds();
    assert!(!ran.stderr.contains("note"), "{}", ran.stderr);
    let second = check_performance(&evaluation, &ran, &["one", "two", "frame 3"], 12.5);
    for frame in 0..3 {
        let of = |numbers: &serde_json::Value| numbers["frames"][frame]["mean_error"].clone();
        assert_eq!(of(&first), of(&second));
    }

    let ran = trained.eval("--blend neutral:rise:bend:3").succeeds();
    let between = ["0.50 neutral + 0.50 rise", "0.50 rise + 0.50 bend"];
    let names = ["neutral", between[0], "rise", between[1], "bend"];
    let path = check_performance(&evaluation, &ran, &names, 24.0);
    assert_eq!(path["source"], "blend");
    assert!(ran.stdout.contains("no target"), "{}", ran.stdout);
    let codes = path["frames"].as_array().unwrap().iter();
    let codes: Vec<Vec<f64>> = codes
        .map(|f| serde_json::from_value(f["descriptor"].clone()).unwrap())
        .collect();
    let middle = codes[2].iter().zip(&codes[4]).map(|(a, b)| 0.5 * (a + b));
    let far = codes[3].iter().zip(middle).map(|(a, b)| (a - b).abs());
    assert!(far.fold(0.0, f64::max) < 1e-6);
}

#[test]
fn frames_are_shapes_over_the_scene_or_over_units() {
    let trained = Trained::new(20, 1);
    let frames = r#"{ "frames": [ { "name": "half", "weights": { "bend": 0.5, "both": 0.5 } } ] }"#;
    let file = trained.file("frames.json", frames);
    let shapes = |options: &str| {
        let out = trained.tiny.path("out");
        let line = format!("{options} --out {}", out.display());
        trained.eval(&line).succeeds();
        json(&out.join("metrics.json"))["shapes"][4].clone()
    };
    let own = shapes(&format!("--shapes {file}"));
    assert_eq!(own["name"], "half");
    assert_eq!(own["set"], "held_out");
    // The same shape by a blend of the scene's shapes.
    let blend = shapes("--weights bend=0.5,both=0.5");
    assert_eq!(own["mean_error"], blend["mean_error"]);

    let ball = icosphere(2, 1.0);
    let lean = [("lean", [0.2, 0.1, 0.0])];
    trained.tiny.write_targets("units.glb", &ball, &lean);
    let units = trained.tiny.path("units.glb");
    let frames = r#"{ "frames": [ { "weights": { "lean": 1 } } ] }"#;
    let over = trained.file("over.json", frames);
    let by_units = shapes(&format!("--shapes {over} --units {}", units.display()));
    let whole = shapes(&format!("--shapes {}", units.display()));
    assert_eq!(by_units["mean_error"], whole["mean_error"]);
    let line = format!("--curves {over} --units {}", units.display());
    let ran = trained.eval(&line).succeeds();
    check_performance(&trained.run.join("evaluation"), &ran, &["frame 1"], 24.0);
    let known = ["over.json, frame 1: ", "`lean`", "there are: bend"];
    trained.refuses(&format!("--shapes {over}"), &known);
    let meshes = format!("--shapes {0} --units {0}", units.display());
    trained.refuses(&meshes, &["--units", "frames"]);
    let alone = format!("--units {}", units.display());
    trained.refuses(&alone, &["--units", "--curves"]);
}

#[test]
fn frames_that_cannot_be_used() {
    let trained = Trained::new(1, 0);
    let suggestion = "did you mean `bend`?";
    for (name, text, parts) in [
        ("a.csv", "", &["no frames"][..]),
        ("a.csv", "bend,rise\n", &["no frames"]),
        (
            "a.csv",
            "bend,rise\n0,1\n0\n",
            &["a.csv:3", "1 cells", "2 columns"],
        ),
        (
            "a.csv",
            "bend,rise,bend\n0,1,0\n",
            &["a.csv:1", "1 and 3", "`bend`"],
        ),
        (
            "a.csv",
            "bend,rise\n0,1.5\n",
            &["a.csv:2", "`rise`", "1.5", "0 to 1"],
        ),
        (
            "a.csv",
            "bend,rise\n-0.5,1\n",
            &["a.csv:2", "`bend`", "-0.5"],
        ),
        ("a.csv", "bend,rise\n0,NaN\n", &["a.csv:2", "`rise`", "NaN"]),
        ("a.csv", "bend,rise\n0,x\n", &["a.csv:2", "`x`", "`rise`"]),
        (
            "a.csv",
            "bendd,rise\n0,1\n",
            &["a.csv:2", "bendd", suggestion],
        ),
        ("a.csv", "bend;rise\n0;1\n", &["a.csv:1", "semicolons"]),
        ("a.json", "", &["no frames"]),
        ("a.json", "{\"frames\": []}", &["no frames"]),
        (
            "a.json",
            "{\"frames\": [{\"weights\":\n{\"bend\": NaN}}]}",
            &["a.json:2"],
        ),
        (
            "a.json",
            "{\"frames\": [{\"weights\": {\"bend\": 2}}]}",
            &["frame 1", "`bend` is 2"],
        ),
        (
            "a.json",
            "{\"frames\": [{\"weights\": {\"bendd\": 1}}]}",
            &["frame 1", suggestion],
        ),
        (
            "a.json",
            "{\"frames\": [{\"weights\": {\"bend\": 1, \"bend\": 1}}]}",
            &["twice"],
        ),
        ("a.txt", "bend\n0\n", &[".csv and .json"]),
    ] {
        let file = trained.file(name, text);
        let parts: Vec<&str> = parts.iter().copied().chain([name]).collect();
        trained.refuses(&format!("--curves {file}"), &parts);
        if name.ends_with(".json") {
            trained.refuses(&format!("--shapes {file}"), &parts);
        }
    }
    trained.refuses("--curves absent.csv", &["absent.csv", "cannot read"]);
    let good = trained.file("good.csv", "bend\n1\n");
    for fps in ["0", "-24", "nan", "inf", "1e9"] {
        let parts = ["--fps", "0.01 to 1000"];
        trained.refuses(&format!("--curves {good} --fps {fps}"), &parts);
    }
    trained.refuses("--fps 24", &["required"]);
    for other in ["--blend bend:rise:3", "--shapes a.glb", "--weights bend=1"] {
        let parts = ["cannot be used with"];
        trained.refuses(&format!("--curves {good} {other}"), &parts);
    }
    for path in [
        "bend",
        "bend:rise",
        "bend:3",
        "bend:rise:1",
        "bend::3",
        "bend:rise:x",
    ] {
        trained.refuses(&format!("--blend {path}"), &["--blend", path, "A:B:N"]);
    }
    trained.refuses("--blend bendd:rise:3", &["--blend", "bendd", suggestion]);
    let most = ["999999999 frames", "4 GiB", "at a time"];
    trained.refuses("--blend bend:rise:999999999", &most);
}
