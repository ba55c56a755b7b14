//! The scenes of the project can be read, are named as their files, and say in their first lines what they are.

use std::path::Path;
use trainer::scene::Scene;

#[test]
fn every_scene_parses_and_is_named_as_its_file() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/scenes");
    let files = std::fs::read_dir(&folder).expect("the project's scenes");
    let mut count = 0;
    for file in files {
        let path = file.expect("a readable folder").path();
        let (scene, text) = Scene::read(&path).unwrap_or_else(|error| panic!("{error}"));
        let stem = path.file_stem().expect("a name").to_string_lossy();
        assert_eq!(scene.name, stem, "{}", path.display());
        assert!(text.starts_with("# "), "{}", path.display());
        count += 1;
    }
    assert!(count >= 10, "{count} scenes");
}

#[test]
fn the_frames_of_the_project_are_weights_from_0_to_1() {
    let path =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/frames/face_ict-combinations.json");
    let text = std::fs::read_to_string(path).expect("the project's frames");
    let file: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    let frames = file["frames"].as_array().expect("frames");
    assert!(!frames.is_empty());
    for frame in frames {
        let weights = frame["weights"].as_object().expect("weights by name");
        assert!(!weights.is_empty(), "{frame}");
        for weight in weights.values() {
            assert!(
                (0.0..=1.0).contains(&weight.as_f64().expect("a number")),
                "{frame}"
            );
        }
    }
}
