//! Bad input: one clear line of error that names the file, the place and the mend; no panic, and nothing written.

use myofield_tests::{Place, TinyScene, check, refused_and_unchanged};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use surface_mesh::primitives::icosphere;
use trainer::run::Run;

/// A tiny scene and the ways to use it that are refused.
struct Trained {
    tiny: TinyScene,
    run: PathBuf,
}

impl Trained {
    /// Trained for a moment.
    fn new() -> Self {
        let tiny = TinyScene::new(1, 0);
        let run = tiny.path("run");
        let line = format!("train {} --out {}", tiny.scene().display(), run.display());
        check(line).succeeds();
        Self { tiny, run }
    }

    /// Evaluating with these options is refused, and neither the run nor another folder changes.
    #[track_caller]
    fn refuses_eval(&self, options: &str, parts: &[&str]) {
        let line = format!("eval {} {options}", self.run.display());
        refused_and_unchanged(&line, &self.run, parts);
        let out = self.tiny.path("out");
        refused_and_unchanged(format!("{line} --out {}", out.display()), &out, parts);
    }

    #[track_caller]
    fn refuses_resume(&self, parts: &[&str]) {
        let run = self.run.display();
        let line = format!("train {} --resume --out {run}", self.tiny.scene().display());
        refused_and_unchanged(line, &self.run, parts);
    }

    fn spoil(&self, name: &str, change: impl FnOnce(&mut Vec<u8>)) {
        let path = self.run.join(name);
        let mut bytes = std::fs::read(&path).unwrap();
        change(&mut bytes);
        std::fs::write(path, bytes).unwrap();
    }
}

/// Training this scene is refused, and no run folder appears.
#[track_caller]
fn refuses_train(tiny: &TinyScene, parts: &[&str]) {
    let out = tiny.path("out");
    let line = format!("train {} --out {}", tiny.scene().display(), out.display());
    refused_and_unchanged(line, &out, parts);
}

/// The same scene with one thing replaced is refused.
#[track_caller]
fn refuses_scene(from: &str, to: &str, parts: &[&str]) {
    let tiny = TinyScene::new(1, 1);
    tiny.edit(from, to);
    refuses_train(&tiny, parts);
}

/// Changes the JSON of a GLB file; the rest stays.
fn edit_glb(path: &Path, change: impl FnOnce(&mut Value)) {
    let bytes = std::fs::read(path).unwrap();
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let mut value: Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
    change(&mut value);
    let mut text = serde_json::to_vec(&value).unwrap();
    text.resize(text.len().next_multiple_of(4), b' ');
    let rest = &bytes[20 + length..];
    let total = 20 + text.len() + rest.len();
    let mut out = bytes[..8].to_vec();
    out.extend((total as u32).to_le_bytes());
    out.extend((text.len() as u32).to_le_bytes());
    out.extend(&bytes[16..20]);
    out.extend(text);
    out.extend(rest);
    std::fs::write(path, out).unwrap();
}

#[test]
fn a_missing_surface() {
    let place = Place::new();
    for name in ["absent.obj", "absent.glb", "absent.gltf"] {
        place.refuses_surface(name, &["cannot read", "No such file"]);
    }
    place.write("ball.stl", "solid");
    place.refuses_surface("ball.stl", &[".obj, .glb or .gltf"]);
    place.refuses_surface("ball", &["unknown surface format"]);
    std::fs::create_dir(place.path("folder.obj")).unwrap();
    place.refuses_surface("folder.obj", &["cannot read"]);
}

#[test]
fn a_truncated_surface() {
    let place = Place::new();
    for name in ["ball.glb", "ball.obj"] {
        let whole = place.read(name);
        let n = whole.len();
        for length in [
            0,
            1,
            3,
            4,
            11,
            12,
            19,
            20,
            21,
            n / 4,
            n / 2,
            3 * n / 4,
            n - 5,
            n - 1,
        ] {
            // The last line of an OBJ file is whole without its end.
            if name == "ball.obj" && length == n - 1 {
                continue;
            }
            place.write(name, &whole[..length]);
            place.refuses_surface(name, &[]);
        }
    }
}

#[test]
fn a_surface_that_is_something_else() {
    let place = Place::new();
    let mut glb = place.read("ball.glb");
    glb[..4].copy_from_slice(b"fTlg");
    place.write("magic.glb", &glb);
    place.refuses_surface("magic.glb", &[]);
    place.write("text.glb", "v 0 0 0\n");
    place.refuses_surface("text.glb", &[]);
    place.write("text.gltf", "{ \"asset\": 3");
    place.refuses_surface("text.gltf", &[]);
    place.write("binary.obj", place.read("ball.glb"));
    place.refuses_surface("binary.obj", &["binary.obj:"]);
    place.write("words.obj", "once upon a time\n");
    place.refuses_surface("words.obj", &["words.obj"]);
}

#[test]
fn a_vertex_that_is_not_finite() {
    let place = Place::new();
    let text = String::from_utf8(place.read("ball.obj")).unwrap();
    let rest = text.split_once('\n').unwrap().1;
    for x in ["nan", "NaN", "inf", "-inf", "1e999"] {
        place.write("bad.obj", format!("v {x} 0 0\n{rest}"));
        place.refuses_surface("bad.obj", &["bad.obj:1"]);
    }
    let glb = place.read("ball.glb");
    let x = (icosphere(2, 1.0).vertices()[0].x as f32).to_le_bytes();
    let at = glb.windows(4).position(|w| w == x).unwrap();
    for value in [f32::NAN, f32::INFINITY] {
        let mut bad = glb.clone();
        bad[at..at + 4].copy_from_slice(&value.to_le_bytes());
        place.write("bad.glb", bad);
        place.refuses_surface("bad.glb", &["element 0 of accessor", "not finite"]);
    }
}

#[test]
fn an_open_surface() {
    let place = Place::new();
    let text = String::from_utf8(place.read("ball.obj")).unwrap();
    let cut = text.trim_end().rfind('\n').unwrap();
    place.write("open.obj", &text[..=cut]);
    place.refuses_surface("open.obj", &["not closed", "3 open edges"]);
    let tiny = TinyScene::new(1, 1);
    std::fs::write(tiny.path("ball.obj"), &text[..=cut]).unwrap();
    refuses_train(&tiny, &["ball.obj", "not closed"]);
}

#[test]
fn elements_that_do_not_fit_the_body() {
    let place = Place::new();
    let surface = place.path("ball.obj").display().to_string();
    for (size, parts) in [
        (
            "10",
            &["larger than the body", "try an element size of"][..],
        ),
        ("0", &["element size 0"]),
        ("-1", &["element size -1"]),
        ("nan", &["element size NaN"]),
        ("1e-7", &["the smallest size that fits"]),
    ] {
        let options = format!("--surface {surface} --element-size {size} --fix z=min");
        place.refuses_solve(&options, parts);
    }
    refuses_scene(
        "element_size = 0.4",
        "element_size = 40.0",
        &["ball.obj", "larger than the body"],
    );
    refuses_scene(
        "element_size = 0.4",
        "element_size = 0.0",
        &["mesh.element_size"],
    );
    let trained = Trained::new();
    trained.refuses_eval("--element-size 40", &["larger than the body"]);
    trained.refuses_eval("--element-size -0.4", &["-0.4"]);
    trained.refuses_eval("--element-size nan", &["NaN"]);
}

#[test]
fn target_shapes_of_another_surface() {
    let tiny = TinyScene::new(1, 1);
    let lean = [("lean", [0.2, 0.1, 0.0])];
    tiny.write_targets("shapes.glb", &icosphere(1, 1.0), &lean);
    refuses_train(&tiny, &["shapes.glb", "42 vertices", "162"]);
    let trained = Trained::new();
    let other = trained.tiny.path("coarse.glb");
    trained
        .tiny
        .write_targets("coarse.glb", &icosphere(1, 1.0), &lean);
    let option = format!("--shapes {}", other.display());
    trained.refuses_eval(&option, &["coarse.glb", "42 vertices", "162"]);
    trained.refuses_eval("--shapes absent.glb", &["absent.glb", "cannot read"]);
    trained
        .tiny
        .write_targets("none.glb", &icosphere(2, 1.0), &[]);
    let option = format!("--shapes {}", trained.tiny.path("none.glb").display());
    trained.refuses_eval(&option, &["none.glb", "no morph targets"]);
}

#[test]
fn morph_targets_that_contradict_their_file() {
    let tiny = TinyScene::new(1, 1);
    edit_glb(&tiny.path("shapes.glb"), |glb| {
        glb["meshes"][0]["extras"]["targetNames"] = json!(["bend", "rise"]);
    });
    refuses_train(&tiny, &["shapes.glb", "2", "4"]);
    let tiny = TinyScene::new(1, 1);
    edit_glb(&tiny.path("shapes.glb"), |glb| {
        let target = &glb["meshes"][0]["primitives"][0]["targets"][1]["POSITION"];
        let accessor = target.as_u64().unwrap() as usize;
        glb["accessors"][accessor]["count"] = json!(161);
    });
    refuses_train(&tiny, &["shapes.glb", "161", "162"]);
    let tiny = TinyScene::new(1, 1);
    tiny.edit("file = \"shapes.glb\"\n", "");
    refuses_train(&tiny, &["ball.obj", "no morph targets"]);
}

#[test]
fn a_scene_with_a_misspelt_key() {
    for (from, to, line, meant) in [
        ("element_size", "elemnt_size", 13, "element_size"),
        ("held_out", "heldout", 10, "held_out"),
        ("width", "widht", 24, "width"),
        ("points = 64", "point = 64", 29, "points"),
        ("unit =", "units =", 2, "unit"),
        ("[stage2]", "[stage3]", 31, "stage2"),
        ("offset", "ofset", 21, "offset"),
    ] {
        let place = format!("scene.toml:{line}: ");
        let meant = format!("did you mean `{meant}`?");
        refuses_scene(from, to, &[&place, &meant]);
    }
}

#[test]
fn a_scene_that_makes_no_sense() {
    let unknown = ["scene.toml:", "did you mean `elasticity`?"];
    refuses_scene("\"elasticity\"", "\"elastic\"", &unknown);
    refuses_scene(
        "\"elasticity\"",
        "\"magnetism\"",
        &["magnetism", "elasticity", "gravity"],
    );
    refuses_scene(
        "\"elasticity\"",
        "\"elasticity\"\nstiffness = -1.0",
        &["stiffness", "-1"],
    );
    refuses_scene("[[effects]]\ntype = \"elasticity\"\n", "", &["elasticity"]);
    refuses_scene("offset = 0.6", "offset = 60.0", &["selects no node"]);
    refuses_scene(
        "samples = 8",
        "samples = 5",
        &["mesh.samples", "1, 8 or 27"],
    );
    refuses_scene(
        "width = 64",
        "width = 65",
        &["scene.toml:24", "64, 128 or 256"],
    );
    refuses_scene("width = 64", "width = 64\nlatent = 0", &["latent size 0"]);
    refuses_scene("batch = 2", "batch = 0", &["stage1.batch"]);
    refuses_scene(
        "checkpoint_seconds = 0",
        "checkpoint_seconds = -1",
        &["checkpoint_seconds"],
    );
    refuses_scene("epochs = 1", "epochs = -1", &["scene.toml:27"]);
    refuses_scene("epochs = 1", "epochs = \"many\"", &["scene.toml:27"]);
    refuses_scene("[mesh]", "[mesh", &["scene.toml:12"]);
    refuses_scene("[mesh]", "[surface]", &["scene.toml:12"]);
    refuses_scene("name = \"ball\"", "name = \"../ball\"", &["name"]);
    refuses_scene(
        "[\"both\"]",
        "[\"bothe\"]",
        &["held_out", "did you mean `both`?"],
    );
    let all = "[\"bend\", \"rise\", \"turn\", \"both\"]";
    refuses_scene("[\"both\"]", all, &["leave at least one"]);
    refuses_scene("ball.obj", "bell.obj", &["bell.obj", "cannot read"]);
    let tiny = TinyScene::new(1, 1);
    std::fs::write(tiny.scene(), b"name = \"\xff\"").unwrap();
    refuses_train(&tiny, &["scene.toml", "UTF-8"]);
    std::fs::remove_file(tiny.scene()).unwrap();
    refuses_train(&tiny, &["scene.toml", "No such file"]);
}

#[test]
fn weights_of_shapes_that_do_not_exist() {
    let trained = Trained::new();
    let parts = ["--weights", "bendd", "did you mean `bend`?"];
    trained.refuses_eval("--weights bendd=1", &parts);
    for list in [
        "bend",
        "bend=",
        "bend=x",
        "bend=nan",
        "=1",
        "bend=1,,rise=1",
    ] {
        trained.refuses_eval(&format!("--weights {list}"), &["name=weight", list]);
    }
}

#[test]
fn weights_of_another_network() {
    let trained = Trained::new();
    let config = actuation_net::NetworkConfig::new(3, actuation_net::Width::W128);
    let wider = actuation_net::ActuationNet::new(&config, 1).unwrap();
    wider.save(trained.run.join("model.safetensors")).unwrap();
    trained.refuses_eval("", &["model.safetensors", "width", "128", "64"]);
    let config = actuation_net::NetworkConfig::new(5, actuation_net::Width::W64);
    let longer = actuation_net::ActuationNet::new(&config, 1).unwrap();
    longer.save(trained.run.join("model.safetensors")).unwrap();
    trained.refuses_eval("", &["model.safetensors", "descriptor", "5", "3"]);
    // The scene in the run asks for another network than the checkpoint holds.
    let scene = std::fs::read_to_string(trained.run.join("scene.toml")).unwrap();
    let wider = scene.replace("width = 64", "width = 128");
    std::fs::write(trained.run.join("scene.toml"), wider).unwrap();
    trained.refuses_resume(&["checkpoint.safetensors", "width", "64", "128"]);
}

#[test]
fn weights_that_are_damaged() {
    for file in ["model.safetensors", "checkpoint.safetensors"] {
        let trained = Trained::new();
        let whole = std::fs::read(trained.run.join(file)).unwrap();
        let refuses = |parts: &[&str]| match file {
            "model.safetensors" => trained.refuses_eval("", parts),
            _ => trained.refuses_resume(parts),
        };
        let n = whole.len();
        for length in [0, 1, 7, 8, 9, 100, n / 2, n - 1] {
            trained.spoil(file, |bytes| bytes.truncate(length));
            refuses(&[file, "truncated"]);
            trained.spoil(file, |bytes| *bytes = whole.clone());
        }
        // A header that claims to be as long as memory.
        trained.spoil(file, |bytes| bytes[..8].fill(0xff));
        refuses(&[file, "not a safetensors file"]);
        trained.spoil(file, |bytes| *bytes = whole.clone());
        std::fs::remove_file(trained.run.join(file)).unwrap();
        if file == "model.safetensors" {
            trained.refuses_eval("", &["model.safetensors", "--resume"]);
        }
    }
    let trained = Trained::new();
    trained.spoil("model.safetensors", |bytes| {
        let n = bytes.len();
        bytes[n - 4..].copy_from_slice(&f32::NAN.to_le_bytes());
    });
    trained.refuses_eval("", &["model.safetensors", "NaN", "tensor"]);
}

#[test]
fn a_run_whose_inputs_are_damaged() {
    let trained = Trained::new();
    trained.spoil("inputs.glb", |bytes| bytes.truncate(bytes.len() / 2));
    trained.refuses_eval("", &["inputs.glb"]);
    trained.refuses_resume(&["inputs.glb"]);
}

#[test]
fn an_output_folder_that_cannot_be_written() {
    let place = Place::new();
    let trained = Trained::new();
    let scene = trained.tiny.scene();
    let commands = [
        "solve --cells 2,1,1 --size 1 --fix x=0".to_string(),
        format!("train {}", scene.display()),
        format!("eval {}", trained.run.display()),
    ];
    place.write("file", "not a folder");
    let mut bad = vec![place.path("file"), place.path("file").join("below")];
    if cfg!(target_os = "linux") {
        bad.push("/proc/nope".into());
    }
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let closed = place.path("closed");
        std::fs::create_dir(&closed).unwrap();
        std::fs::set_permissions(&closed, PermissionsExt::from_mode(0o555)).unwrap();
        // To root nothing is closed.
        if std::fs::write(closed.join("probe"), "").is_err() {
            bad.push(closed);
        }
    }
    for out in &bad {
        for command in &commands {
            let line = format!("{command} --out {}", out.display());
            check(line).refuses(&["cannot", &out.display().to_string()]);
        }
        assert_eq!(place.read("file"), b"not a folder");
    }
}

#[test]
fn a_run_that_another_process_holds() {
    let trained = Trained::new();
    let held = Run::open(&trained.run).unwrap();
    trained.refuses_resume(&["another process"]);
    trained.refuses_eval("", &["another process"]);
    drop(held);
    let line = format!("eval {}", trained.run.display());
    check(line).succeeds();
}

#[test]
fn a_run_that_is_there_or_is_not() {
    let trained = Trained::new();
    let scene = trained.tiny.scene();
    let again = format!("train {} --out {}", scene.display(), trained.run.display());
    refused_and_unchanged(again, &trained.run, &["holds a run already", "--resume"]);
    let none = trained.tiny.path("none");
    for command in ["eval", "train --resume --out"] {
        let line = format!("{command} {}", none.display());
        refused_and_unchanged(line, &none, &["holds no run", "none"]);
    }
    // Any folder is no run.
    let folder = trained.tiny.folder();
    let line = format!("eval {}", folder.display());
    std::fs::remove_file(trained.tiny.scene()).unwrap();
    refused_and_unchanged(line, folder, &["holds no run"]);
}

#[test]
fn a_run_that_is_not_finished() {
    let trained = Trained::new();
    std::fs::remove_file(trained.run.join("model.safetensors")).unwrap();
    trained.refuses_eval("", &["no trained network yet", "--resume"]);
}
