//! Options that do not fit: one line of error with the option, the value and what would be right, and no file.

use crate::common::{Place, run};

#[test]
fn wrong_values_are_named_with_their_mend() {
    let refuses = |line: &str, parts: &[&str]| run(line).refuses(parts);
    for cells in ["4,2", "0,2,2", "a,b,c", "4,2,2,2", "-4,2,2", "1.5,2,2", ""] {
        let line = format!("box --cells={cells}");
        refuses(&line, &["--cells", cells, "32,16,16"]);
    }
    refuses(
        "box --cells 9000,9000,9000",
        &["--cells", "9000,9000,9000", "more than"],
    );
    refuses(
        "box --cells 4,2,2 --method euler",
        &["--method", "euler", "local-global", "lbfgs", "newton"],
    );
    for value in ["0", "-1", "nan", "inf", "x"] {
        for option in ["--relative-gradient", "--adjoint-tolerance", "--budget"] {
            let line = format!("box --cells 4,2,2 {option} {value}");
            refuses(&line, &[option, value, "above zero"]);
        }
    }
    for value in ["0", "-1", "1.5", "x"] {
        for option in ["--runs", "--max-iterations"] {
            let line = format!("box --cells 4,2,2 {option} {value}");
            refuses(&line, &[option, value, "whole number above zero"]);
        }
        let line = format!("box --cells 4,2,2 --threads {value}");
        refuses(&line, &["--threads", value, "from 1 to"]);
    }
    refuses(
        "box --cells 4,2,2 --threads 99999",
        &["--threads", "99999", "1024"],
    );
    refuses(
        "box --cells 4,2,2 --amplitude nan",
        &["--amplitude", "nan", "finite"],
    );
    refuses(
        "box --cells 4,2,2 --seed -1",
        &["--seed", "-1", "whole number"],
    );
    refuses("warm --change inf", &["--change", "inf", "finite"]);
    refuses("warm --surface ball.obj", &["required"]);
    refuses(
        "warm --cells 2,2,2 --surface ball.obj --element-size 1",
        &["--cells", "--surface"],
    );
    refuses("threads --counts 1,0", &["--counts", "0", "from 1 to"]);
    refuses(
        "roofline --megabytes 8,x",
        &["--megabytes", "x", "whole numbers"],
    );
    refuses("kernels --count 0", &["--count", "above zero"]);
    refuses(
        "methods --sizes 8k,9k",
        &["--sizes", "9k", "30k", "64x32x32"],
    );
    refuses("methods --methods lbfgs,no", &["--methods", "no", "newton"]);
    refuses("methods --limit 0", &["--limit", "0", "above zero"]);
    refuses("nothing", &["nothing"]);
    refuses("box", &["required"]);
}

#[test]
fn bodies_that_cannot_be_used() {
    let place = Place::new();
    let ball = place.ball();
    let refuses = |options: &str, parts: &[&str]| {
        run(&format!("body --surface {} {options}", ball.display())).refuses(parts);
    };
    refuses(
        "--element-size 50",
        &["--element-size 50", "try an element size"],
    );
    refuses("--element-size 0", &["--element-size", "above zero"]);
    refuses("--element-size 0.4 --fix z<-9", &["--fix z<-9", "no node"]);
    refuses(
        "--element-size 0.4 --fix z<9",
        &["--fix z<9", "every node", "fewer"],
    );
    for fix in ["q<1", "z=1", "z<", "z<nan", "z"] {
        refuses(
            &format!("--element-size 0.4 --fix {fix}"),
            &["--fix", fix, "z<0.1"],
        );
    }
    run("body --surface nowhere.obj --element-size 1").refuses(&["--surface", "nowhere.obj"]);
    std::fs::write(place.path("broken.obj"), "f 1 2 3\n").unwrap();
    let broken = place.path("broken.obj").display().to_string();
    run(&format!("body --surface {broken} --element-size 1")).refuses(&["--surface", "broken.obj"]);
}

#[test]
fn files_are_written_whole_or_not_at_all() {
    let place = Place::new();
    let inside = place.path("absent").join("out.json");
    let line =
        |json: &std::path::Path, rest: &str| run(&format!("box {rest} --json {}", json.display()));
    line(&inside, "--cells 4,2,2").refuses(&["--json", "absent", "create the folder"]);
    line(&place.path("."), "--cells 4,2,2").refuses(&["--json", "folder", "name a file"]);
    assert!(place.files().is_empty());
    // What fails leaves an older file as it was, and nothing beside it.
    let json = place.path("out.json");
    std::fs::write(&json, "older").unwrap();
    line(&json, "--cells 9000,9000,9000").refuses(&["--cells"]);
    assert_eq!(std::fs::read_to_string(&json).unwrap(), "older");
    assert_eq!(place.files(), ["out.json"]);
    let ran = line(&json, "--cells 4,2,2 --runs 1");
    assert_eq!(ran.code, Some(0), "{ran:?}");
    assert!(place.read(&json).is_object());
    assert!(place.files().is_empty());
}
