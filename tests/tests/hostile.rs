//! Names made to do harm, from the file to the terminal and the pages.

use myofield_tests::{Ran, TinyScene, check, tree};
use surface_mesh::{primitives::icosphere, read_gltf};

/// Clears the screen, fakes a line of output, ends a text, and turns the direction of writing.
const NAME: &str = "\u{1b}[2J\nerror:\u{9b}31m\0\u{202e}";
/// As people see it.
const SHOWN: &str = "\\u{1b}[2J\\nerror:\\u{9b}31m\\u{0}\\u{202e}";

#[track_caller]
fn prints_only(ran: &Ran) {
    for text in [&ran.stdout, &ran.stderr] {
        let does_more = |c: &char| (c.is_control() && *c != '\n') || *c == '\u{202e}';
        assert_eq!(text.chars().find(does_more), None, "{text:?}");
        assert!(
            !text.lines().any(|line| line.starts_with("error:\u{9b}")),
            "{text:?}"
        );
    }
}

#[test]
fn a_shape_whose_name_does_more_than_print_is_trained_and_shown_escaped() {
    let tiny = TinyScene::new(1, 1);
    let shapes = [("bend", [0.3, 0.0, 0.0]), (NAME, [0.0, 0.25, 0.0])];
    tiny.write_targets("shapes.glb", &icosphere(2, 1.0), &shapes);
    tiny.edit("held_out = [\"both\"]\n", "");
    let run = tiny.path("run");
    let run_line = |verb: &str, more: &str| check(format!("{verb} {} {more}", run.display()));
    let trained = check(format!(
        "train {} --out {}",
        tiny.scene().display(),
        run.display()
    ))
    .succeeds();
    prints_only(&trained);
    assert!(trained.stdout.contains(SHOWN), "{}", trained.stdout);
    let compared = run_line("compare", "--seconds 1").succeeds();
    prints_only(&compared);
    // A name that is asked for in vain is told with those that there are.
    let refused = run_line("eval", "--weights none=1").refuses(&["`none`", SHOWN]);
    prints_only(&refused);
    let shapes = read_gltf(run.join("evaluation/shapes.glb")).unwrap();
    assert_eq!(shapes.targets[1].name, NAME);
    for (path, bytes) in tree(&run) {
        let ends_in = |all: &[&str]| {
            let extension = path.extension().and_then(|e| e.to_str());
            extension.is_some_and(|e| all.contains(&e))
        };
        // JSON is data: it keeps names as they are, and escapes what a file of text must not hold.
        let (is_page, is_data) = (ends_in(&["svg", "md", "html"]), ends_in(&["json", "jsonl"]));
        let text = String::from_utf8_lossy(&bytes);
        let does_more =
            |c: char| c.is_control() && !c.is_ascii_whitespace() && (is_page || c.is_ascii());
        assert!(
            !(is_page || is_data) || !text.contains(does_more),
            "{}",
            path.display()
        );
    }
}

#[test]
fn a_mesh_whose_name_does_more_than_print_is_refused_in_one_line() {
    let tiny = TinyScene::new(1, 1);
    let json = serde_json::json!({
        "asset": { "version": "2.0" },
        "meshes": [{ "name": NAME, "primitives": [] }, { "primitives": [] }],
    });
    std::fs::write(tiny.path("shapes.glb"), json.to_string()).unwrap();
    let line = format!(
        "train {} --out {}",
        tiny.scene().display(),
        tiny.path("run").display()
    );
    prints_only(&check(line).refuses(&["2 meshes", SHOWN]));
}
