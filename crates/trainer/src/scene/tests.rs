//! What scenes may hold, and how they are refused.

use super::*;

const GOOD: &str = r#"
name = "cube"
[surface]
file = "cube.obj"
[mesh]
element_size = 0.1
[[effects]]
type = "elasticity"
[[effects]]
type = "prescribed"
nodes = { type = "sphere", center = [0, 0, 0], radius = 0.2 }
[network]
width = 64
"#;

fn error_of(text: &str) -> String {
    Scene::parse(text, Path::new("cube.toml"))
        .unwrap_err()
        .to_string()
}

#[test]
fn a_good_scene_parses() {
    let scene = Scene::parse(GOOD, Path::new("cube.toml")).unwrap();
    assert_eq!(scene.effects.len(), 2);
    assert_eq!(scene.mesh.samples, 8);
}

#[test]
fn a_misspelt_key_is_named_with_its_line_and_a_suggestion() {
    let message = error_of(&GOOD.replace("element_size", "elemnt_size"));
    assert!(message.starts_with("cube.toml:6: "), "{message}");
    assert!(
        message.contains("did you mean `element_size`?"),
        "{message}"
    );
    let message = error_of(&GOOD.replace("radius", "radiu"));
    assert!(message.contains("cube.toml:11"), "{message}");
    let message = error_of(&GOOD.replace("\"prescribed\"", "\"perscribed\""));
    assert!(message.contains("did you mean `prescribed`?"), "{message}");
}

#[test]
fn values_that_make_no_sense_are_refused() {
    for (from, to, expected) in [
        ("0.1", "-0.1", "mesh.element_size"),
        ("0.1", "nan", "mesh.element_size"),
        ("width = 64", "width = 65", "65"),
        ("\"cube\"", "\"a/b\"", "name"),
        (
            "element_size = 0.1",
            "element_size = 0.1\nsamples = 9",
            "mesh.samples",
        ),
        (
            "width = 64",
            "width = 64\n[stage1]\nbalance = 1.5",
            "stage1.balance",
        ),
        (
            "width = 64",
            "width = 64\n[stage2]\nbalance = -0.5",
            "stage2.balance",
        ),
    ] {
        let message = error_of(&GOOD.replace(from, to));
        assert!(message.contains(expected), "{message}");
    }
}
