//! The program from the outside: a study that goes on, what it recommends, and what it refuses.

use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Duration;
use trainer::run::Run;
use trainer::trained::{Changes, Trained};

const SCENE: &str = r#"
name = "small"
unit = "cm"
[surface.starfish]
radius = 1.0
[mesh]
element_size = 0.12
[[effects]]
type = "elasticity"
[[effects]]
type = "prescribed"
nodes = { type = "sphere", center = [0, 0, 0], radius = 0.25 }
[network]
width = 64
[stage1]
epochs = 60
batch = 2
[[pose]]
name = "curl"
arms = [{ curl = 40 }, {}, { curl = 40 }]
[[pose]]
name = "lift"
arms = [{}, {}, {}, {}, { lift = 30 }]
"#;

struct Place(tempfile::TempDir);

impl Place {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("small.toml"), SCENE).unwrap();
        Self(folder)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn run(&self, line: &str) -> Output {
        Command::new(env!("CARGO_BIN_EXE_myofield-accuracy"))
            .current_dir(self.0.path())
            .args(line.split_whitespace())
            .output()
            .unwrap()
    }

    fn succeeds(&self, line: &str) -> (String, String) {
        let (ok, out, err) = self.said(line);
        assert!(ok, "{line}: {err}");
        (out, err)
    }

    fn refuses(&self, line: &str, words: &[&str]) {
        let (ok, _, err) = self.said(line);
        assert!(!ok, "{line} was taken");
        for word in words {
            assert!(err.contains(word), "{line}: {err}");
        }
    }

    /// Asks the program to stop so long after it tells something with `begun` in it; whether it was done before.
    #[cfg(unix)]
    fn is_done_within(&self, line: &str, begun: &str, wait: Duration) -> bool {
        let mut program = Command::new(env!("CARGO_BIN_EXE_myofield-accuracy"))
            .current_dir(self.0.path())
            .args(line.split_whitespace())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut told = BufReader::new(program.stderr.take().unwrap()).lines();
        let first = told
            .by_ref()
            .map_while(Result::ok)
            .find(|l| l.contains(begun));
        assert!(first.is_some(), "it ended before");
        std::thread::sleep(wait);
        let id = program.id().to_string();
        // Fails where it is done.
        Command::new("kill")
            .args(["-INT", &id])
            .stderr(Stdio::null())
            .status()
            .unwrap();
        let last = told.map_while(Result::ok).last().unwrap_or_default();
        let is_done = program.wait().unwrap().success();
        assert!(
            is_done || last.contains("the same command goes on"),
            "{last}"
        );
        is_done
    }

    fn said(&self, line: &str) -> (bool, String, String) {
        let output = self.run(line);
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        (
            output.status.success(),
            text(&output.stdout),
            text(&output.stderr),
        )
    }
}

fn json(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

#[test]
fn a_study_measures_recommends_and_goes_on() {
    let place = Place::new();
    let line = "small.toml --sizes 1.5,1 --shapes 1 --out out";
    let (said, told) = place.succeeds(&format!("{line} --target 2mm"));
    let out = place.path("out");
    for name in ["cost", "split", "element-size"] {
        for kind in ["png", "svg"] {
            assert!(out.join(format!("{name}.{kind}")).exists(), "{name}.{kind}");
        }
    }
    let study = json(&out.join("study.json"));
    let rows = study["rows"].as_array().unwrap();
    let of = |question: &str| {
        let own = rows.iter().filter(move |r| r["question"] == question);
        own.collect::<Vec<_>>()
    };
    // Two sizes, four kinds of samples and points, four accuracies.
    assert_eq!(of("matrix").len(), 32);
    let sizes = of("discretisation");
    assert_eq!(sizes.len(), 2);
    let error = |row: &Value| row["error"].as_f64().unwrap();
    assert!(error(sizes[1]) < error(sizes[0]), "{sizes:?}");
    let solver: Vec<f64> = of("solver").into_iter().map(error).collect();
    assert!(solver[3] < 1e-5 && solver[3] < solver[0], "{solver:?}");
    assert!(study["known_answer"]["order"].as_f64().unwrap() > 1.8);

    // 2 mm are 0.2 of the scene's centimetres.
    let kept = &json(&out.join("recommended.json"))[0];
    let diagonal = study["diagonal"].as_f64().unwrap();
    assert!((kept["target"].as_f64().unwrap() * diagonal - 0.2).abs() < 1e-9);
    assert!(error(kept) <= kept["target"].as_f64().unwrap());
    let snippet = said
        .split("```toml")
        .nth(1)
        .unwrap()
        .split("```")
        .next()
        .unwrap();
    let snippet: toml::Table = toml::from_str(snippet).unwrap();
    assert!(snippet["mesh"]["element_size"].as_float().unwrap() >= 0.1199);
    assert!(said.contains(&std::fs::read_to_string(out.join("study.md")).unwrap()));

    // What is there is not measured again; a line that a killed process left unfinished is.
    let count = |told: &str| told.matches("measured ").count();
    assert_eq!(count(&told), rows.len());
    let (_, again) = place.succeeds(line);
    assert_eq!(count(&again), 0, "{again}");
    let text = std::fs::read_to_string(out.join("rows.jsonl")).unwrap();
    std::fs::write(out.join("rows.jsonl"), &text[..text.len() - 20]).unwrap();
    let (_, again) = place.succeeds(line);
    assert_eq!(count(&again), 1, "{again}");
    let lines = |text: &str| text.lines().count();
    let mended = std::fs::read_to_string(out.join("rows.jsonl")).unwrap();
    assert_eq!(lines(&mended), lines(&text));

    // Stopped while its network is trained, and between two rows, it comes to the same.
    #[cfg(unix)]
    {
        let line = line.replace("--out out", "--out stopped");
        for begun in ["stage 1", "measured"] {
            assert!(
                !place.is_done_within(&line, begun, Duration::ZERO),
                "{begun}"
            );
        }
        let (_, told) = place.succeeds(&line);
        assert!((1..rows.len()).contains(&count(&told)), "{told}");
        let resumed = json(&place.path("stopped/study.json"));
        let resumed = resumed["rows"].as_array().unwrap().iter();
        assert!(resumed.map(error).eq(rows.iter().map(error)));
    }

    // Settings for one body are tried on another.
    let other = SCENE.replace("radius = 1.0", "radius = 1.2\nthickness = 0.12");
    std::fs::write(place.path("other.toml"), other.replace("small", "other")).unwrap();
    let (said, _) =
        place.succeeds("other.toml --shapes 1 --out other --check out/recommended.json");
    assert!(
        said.contains("| yes |") || said.contains("| no |"),
        "{said}"
    );

    place.refuses(&format!("{line} --target 1e-9"), &["nearest is", "--sizes"]);
    place.refuses(
        &format!("{line} --budget 1e-9"),
        &["fastest takes", "--sizes"],
    );
    place.refuses(
        &format!("{line} --target 3furlongs"),
        &["furlongs", "--target"],
    );
    place.refuses(
        "small.toml --sizes 2,1 --shapes 1 --out out",
        &["rows.jsonl", "another study", "--out"],
    );
}

#[test]
fn what_cannot_be_studied_is_refused() {
    let place = Place::new();
    place.refuses("absent.toml", &["absent.toml"]);
    place.refuses("small.toml --sizes 0,1", &["--sizes"]);
    place.refuses(
        "small.toml --budget 1 --target 1mm",
        &["--budget", "--target"],
    );
    place.refuses("small.toml --budget -1", &["--budget"]);
    place.refuses("small.toml --shapes 0", &["--shapes"]);
    std::fs::create_dir(place.path("empty")).unwrap();
    place.refuses("empty", &["empty"]);
}

#[test]
fn loosened_trainings_are_set_side_by_side() {
    let place = Place::new();
    let (said, _) = place.succeeds("training small.toml --shapes 1 --passes 2 --out out");
    let found = json(&place.path("out").join("training.json"));
    let courses = found.as_array().unwrap();
    let angle = |name: &str| {
        let own = courses.iter().find(|c| c["tightness"]["name"] == name);
        own.unwrap()["angle"].as_f64().unwrap()
    };
    assert!(angle("tight") < 0.1, "{said}");
    assert!(
        angle("1 % of the points") > angle("25 % of the points"),
        "{said}"
    );
    for course in courses {
        assert_eq!(course["passes"].as_array().unwrap().len(), 2);
    }
    for kind in ["equilibria", "adjoint", "points"] {
        assert!(
            place
                .path("out")
                .join(format!("training-{kind}.png"))
                .exists()
        );
    }
}

#[test]
fn a_transfer_goes_on_after_its_last_network_and_leaves_a_run() {
    let place = Place::new();
    let line = "transfer small.toml --shapes 1 --passes 1 --out out";
    place.succeeds(line);
    let out = place.path("out");
    let found = std::fs::read(out.join("transfer.json")).unwrap();
    let networks = out.join("networks");
    // The finest and the conditioned, one of the other grid, two transferred, five alone.
    let kept = std::fs::read_dir(&networks).unwrap().flatten();
    let kept = kept.filter(|f| f.path().extension().is_some_and(|e| e == "safetensors"));
    assert_eq!(kept.count(), 10);
    // As if it had been stopped there.
    for last in ["alone-23", "transferred-89-502"] {
        std::fs::remove_file(networks.join(format!("{last}.safetensors"))).unwrap();
    }
    let finest = networks.join("finest.safetensors");
    let trained = std::fs::metadata(&finest).unwrap().modified().unwrap();
    place.succeeds(line);
    assert_eq!(std::fs::read(out.join("transfer.json")).unwrap(), found);
    assert_eq!(
        std::fs::metadata(&finest).unwrap().modified().unwrap(),
        trained
    );
    place.refuses(
        "transfer small.toml --shapes 1 --passes 2 --out out",
        &["plan.json", "another transfer", "--out"],
    );

    // Stopped again and again in the middle of networks, it comes to the same.
    #[cfg(unix)]
    {
        let (mut in_training, mut stops) = (0, 0);
        let again = line.replace("out out", "out again");
        let wait = |stops: u64| Duration::from_millis(300 + 170 * stops);
        while !place.is_done_within(&again, "finest grid", wait(stops)) {
            stops += 1;
            let left = std::fs::read_dir(place.path("again/networks")).unwrap();
            let is_unfinished =
                |f: std::fs::DirEntry| f.path().extension() == Some("unfinished".as_ref());
            in_training += u64::from(left.flatten().any(is_unfinished));
        }
        assert!(
            in_training > 1,
            "{in_training} of {stops} stops in training"
        );
        let again = place.path("again").join("transfer.json");
        assert!(std::fs::read(again).unwrap() == found, "{stops} stops");
    }

    // The network that knows the spacing is a run like any other, on any grid.
    let run = Run::open(&out.join("conditioned")).unwrap();
    for size in [0.12, 0.1] {
        let changes = Changes {
            element_size: Some(size),
            ..Changes::default()
        };
        let trained = Trained::load(&run, &changes).unwrap();
        assert!(trained.net.config().resolution.is_some());
        assert_eq!(trained.body.mesh.element_size(), size);
    }
}
