//! polar-grad by itself: a crate outside the workspace builds on it and runs, and it brings nothing but nalgebra along.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

fn workspace() -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    root.canonicalize().expect("the workspace")
}

/// Runs cargo without a network and returns what it wrote to its output.
fn cargo(folder: &Path, arguments: &[&str]) -> String {
    let output = Command::new(env!("CARGO"))
        .args(arguments)
        .arg("--offline")
        .current_dir(folder)
        .env("CARGO_TARGET_DIR", folder.join("target"))
        .output()
        .expect("cargo starts");
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "cargo {arguments:?}:\n{errors}");
    String::from_utf8(output.stdout).expect("text")
}

/// M(t) = R_z(1/2 + t) S turns as t grows, so the rotation of M(0) is R_z(1/2) and its derivative R_z'(1/2), whatever S.
const MAIN: &str = r#"
use nalgebra::{Matrix3, Rotation3, Vector3};
use polar_grad::{RotationGradient, polar_rotation};

fn main() {
    let stretch = Matrix3::new(2.0, 0.3, 0.0, 0.3, 1.0, -0.1, 0.0, -0.1, 0.5);
    let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), 0.5).into_inner();
    let m = turn * stretch;
    let d_m = Vector3::<f64>::z().cross_matrix() * m;
    let r = polar_rotation(&m);
    let d_r = RotationGradient::at(&m).apply(&d_m);
    println!("{} {} {} {}", r[(0, 0)], r[(1, 0)], d_r[(0, 0)], d_r[(1, 0)]);
}
"#;

#[test]
fn an_outside_crate_uses_polar_grad() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let root = workspace();
    let manifest = format!(
        r#"
[package]
name = "outside"
version = "0.1.0"
edition = "2024"

[workspace]

[dependencies]
nalgebra = {{ version = "0.35", default-features = false }}
polar-grad = {{ path = {:?} }}
"#,
        root.join("crates/polar-grad")
    );
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).expect("writes");
    fs::create_dir(folder.path().join("src")).expect("a new folder");
    write("Cargo.toml", &manifest);
    write("src/main.rs", MAIN);
    // The versions that the workspace was tested with: nothing is resolved anew.
    fs::copy(root.join("Cargo.lock"), folder.path().join("Cargo.lock")).expect("copies");

    let numbers = cargo(folder.path(), &["run", "--quiet"]);
    let numbers: Vec<f64> = numbers
        .split_whitespace()
        .map(|x| x.parse().expect("a number"))
        .collect();
    let (sin, cos) = 0.5f64.sin_cos();
    for (found, expected) in numbers.iter().zip([cos, sin, -sin, cos]) {
        assert!((found - expected).abs() < 1e-14, "{found} for {expected}");
    }
    assert_eq!(numbers.len(), 4);
}

#[test]
fn nalgebra_is_all_that_polar_grad_depends_on() {
    let arguments = "tree -p polar-grad -e normal --depth 1 --prefix none";
    let tree = cargo(&workspace(), &arguments.split(' ').collect::<Vec<_>>());
    let names: Vec<_> = tree
        .lines()
        .filter_map(|line| line.split(' ').next())
        .collect();
    assert_eq!(names, ["polar-grad", "nalgebra"], "{tree}");
}

/// Packing alone needs no build: the crate above is built from the same files.
#[test]
fn polar_grad_can_be_packed() {
    let target = tempfile::tempdir().expect("a temporary folder");
    let place = target.path().to_str().expect("a path in Unicode");
    let arguments = "package -p polar-grad --allow-dirty --no-verify --quiet --target-dir";
    let mut arguments: Vec<_> = arguments.split(' ').collect();
    arguments.push(place);
    cargo(&workspace(), &arguments);
    let package = format!("package/polar-grad-{}.crate", env!("CARGO_PKG_VERSION"));
    assert!(target.path().join(package).is_file());
}
