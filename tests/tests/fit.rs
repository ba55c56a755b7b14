//! Fits from the outside: files, table, and command lines that make no sense.

use myofield_tests::{TinyScene, check, refused_and_unchanged, tree};
use surface_mesh::primitives::icosphere;
use surface_mesh::{read_surface, write_obj};

#[test]
fn a_fit_writes_its_files_and_nothing_else_and_bad_lines_are_refused() {
    let tiny = TinyScene::new(40, 1);
    let run = tiny.path("run");
    let line = format!("train {} --out {}", tiny.scene().display(), run.display());
    check(line).succeeds();
    let before = tree(&run);
    let eval = format!("eval {} --fit", run.display());
    let out = tiny.path("out");
    let to = format!("--out {}", out.display());
    let [other, surface] = ["other.glb", "ball.obj"].map(|n| tiny.path(n).display().to_string());

    for (options, parts) in [
        (String::new(), &["required"][..]),
        (format!("--shapes {other} --scan {surface}"), &["--scan"]),
        (
            format!("--shapes {other} --blend bend:rise:3"),
            &["--blend"],
        ),
        (format!("--shapes {other} --weights bend=1"), &["--weights"]),
        (
            format!("--shapes {other} --scan-reach 1"),
            &["--scan-reach"],
        ),
        (
            format!("--shapes {other} --fit-steps 0"),
            &["--fit-steps 0"],
        ),
        (
            format!("--shapes {surface}"),
            &["ball.obj", "no morph targets"],
        ),
        (
            format!("--scan {surface} --scan-reach -1"),
            &["--scan-reach -1"],
        ),
        (
            format!("--scan {}", tiny.path("none.obj").display()),
            &["none.obj"],
        ),
    ] {
        refused_and_unchanged(format!("{eval} {options} {to}"), &out, parts);
    }
    let ball = icosphere(3, 1.0);
    let large = ball.with_vertices(ball.vertices().iter().map(|x| x * 10.0).collect());
    write_obj(tiny.path("large.obj"), &large.unwrap()).unwrap();
    let line = format!("{eval} --scan {} {to}", tiny.path("large.obj").display());
    refused_and_unchanged(line, &out, &["large.obj", "scale it to cm"]);
    let lines = [
        format!("eval {} --scan {surface}", run.display()),
        format!("eval {} --fit-steps 3", run.display()),
    ];
    lines
        .iter()
        .for_each(|line| refused_and_unchanged(line, &out, &["required"]));

    let ran = check(format!("{eval} --shapes {other} --fit-steps 5 {to}")).succeeds();
    assert!(ran.stdout.contains("lean") && ran.stdout.contains("times less"));
    let files = tree(&out).into_keys();
    let names: Vec<_> = files.map(|p| p.file_name().unwrap().to_owned()).collect();
    assert_eq!(names, ["fit-sheet-1.png", "fit.glb", "fit.json"]);
    let text = std::fs::read_to_string(out.join("fit.json")).unwrap();
    let numbers: serde_json::Value = serde_json::from_str(&text).unwrap();
    let shape = &numbers["shapes"][0];
    assert_eq!(shape["latent"].as_array().unwrap().len(), 32);
    assert!(shape["joint"].is_null() && shape["left_out"].is_null());
    assert!(shape["loss_after"].as_f64() <= shape["loss_before"].as_f64());
    assert!(shape["simulations"].as_u64() <= Some(7));
    let fitted = read_surface(out.join("fit.glb")).unwrap();
    assert_eq!(fitted.targets[0].name, "lean");

    // A scan with more triangles than the body has; the run itself is as it was.
    write_obj(tiny.path("scan.obj"), &ball).unwrap();
    let scan = tiny.path("scan.obj").display().to_string();
    let ran = check(format!("{eval} --scan {scan} --fit-steps 2 {to}")).succeeds();
    assert!(ran.stdout.contains("from neutral") && ran.stdout.contains("left out"));
    assert!(tree(&run) == before);
}
