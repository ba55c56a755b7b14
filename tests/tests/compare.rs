//! The comparison from the outside: a table, files, a decoder that is kept, and what is refused.

use myofield_tests::{TinyScene, check, refused_and_unchanged, tree};
use std::path::Path;

fn json(path: &Path) -> serde_json::Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

#[test]
fn a_run_is_compared_on_its_own_shapes_and_on_others() {
    let tiny = TinyScene::new(10, 1);
    let run = tiny.path("run");
    check(format!(
        "train {} --out {}",
        tiny.scene().display(),
        run.display()
    ))
    .succeeds();
    let line = format!("compare {}", run.display());
    let folder = run.join("comparison");
    let other = tiny.path("other.glb").display().to_string();

    refused_and_unchanged(format!("{line} --width 0"), &run, &["1 to 4096"]);
    refused_and_unchanged(format!("{line} --seconds -1"), &run, &["--seconds"]);
    refused_and_unchanged(format!("{line} --units {other}"), &run, &["--units"]);
    let absent = tiny.path("absent.json").display().to_string();
    refused_and_unchanged(format!("{line} --shapes {absent}"), &run, &["absent.json"]);

    let first = check(&line).succeeds();
    let names: Vec<String> = (tree(&folder).into_keys())
        .map(|path| path.file_name().unwrap().to_string_lossy().into_owned())
        .collect();
    let expected = [
        "comparison.json",
        "comparison.md",
        "comparison.png",
        "decoder.safetensors",
    ];
    assert_eq!(names, expected);
    let text = std::fs::read_to_string(folder.join("comparison.md")).unwrap();
    assert!(first.stdout.contains(&text));
    for method in ["field", "linear blendshapes", "explicit decoder (width 64)"] {
        assert!(text.contains(&format!("| {method} ")), "{text}");
    }
    assert!(text.contains("another element size needs another decoder"));

    // More frames, and no second training: the decoder is the one that is kept.
    let kept = std::fs::read(folder.join("decoder.safetensors")).unwrap();
    let out = tiny.path("out");
    std::fs::create_dir(&out).unwrap();
    std::fs::copy(
        folder.join("decoder.safetensors"),
        out.join("decoder.safetensors"),
    )
    .unwrap();
    let before = tree(&folder);
    let second = check(format!("{line} --shapes {other} --out {}", out.display())).succeeds();
    assert!(!second.stderr.contains("decoder 1"), "{}", second.stderr);
    assert_eq!(
        std::fs::read(out.join("decoder.safetensors")).unwrap(),
        kept
    );
    assert_eq!(tree(&folder), before);
    let numbers = json(&out.join("comparison.json"));
    assert_eq!(numbers["methods"][0]["held_out"]["frames"], 2);
    assert_eq!(numbers["methods"][2]["frames"][4]["name"], "lean");
    // What was trained on is the basis, and what leans is a linear blend of it; what turns is none.
    let linear = &numbers["methods"][1];
    let error = |frame: usize| linear["frames"][frame]["weighted_error"].as_f64().unwrap();
    assert!(linear["train"]["weighted_error"].as_f64().unwrap() < 1e-5);
    assert!(error(4) < 1e-5, "{}", error(4));
    assert!(error(3) > 1e-4, "{}", error(3));
}
