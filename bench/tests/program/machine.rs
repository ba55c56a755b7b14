//! What `kernels` and `roofline` write.

use crate::common::{Place, number};
use serde_json::Value;

fn list<'a>(report: &'a Value, key: &str) -> &'a [Value] {
    report[key].as_array().unwrap()
}

#[test]
fn kernels_are_measured_on_every_instruction_set_and_give_rotations() {
    let line = "kernels --count 13 --cells 4,2,2 --milliseconds 1 --runs 3";
    let report = Place::new().measure(line);
    // A whole number of blocks of eight.
    assert_eq!(number(&report, "count"), 16.0);
    let kernels = list(&report, "per_matrix");
    for class in ["deformed", "inverted"] {
        let of_class = kernels.iter().filter(|k| k["class"] == class);
        let names: Vec<_> = of_class
            .clone()
            .map(|k| k["kernel"].as_str().unwrap())
            .collect();
        for name in [
            "nalgebra SVD",
            "polar_rotation_lanes",
            "batch::polar_rotations",
        ] {
            assert!(names.contains(&name), "{name} in {names:?}");
        }
        let mut sets = of_class.filter(|k| k["kernel"] == "polar_rotation_lanes");
        assert!(sets.any(|k| k["instruction_set"] == "portable"));
    }
    for kernel in kernels.iter().chain(list(&report, "per_sample")) {
        let time = number(kernel, "nanoseconds");
        assert!(0.0 < time && time < 1e6, "{kernel}");
        if let Some(defect) = kernel["orthogonality"].as_f64() {
            assert!(defect < 1e-14, "{kernel}");
        }
    }
    assert_eq!(list(&report, "per_sample").len(), 2);
}

#[test]
fn the_roofline_has_every_size_and_number_of_threads() {
    let report = Place::new().measure("roofline --megabytes 1,2 --counts 1,2 --runs 1");
    let read = list(&report, "read");
    let pairs: Vec<_> = read
        .iter()
        .map(|r| (number(r, "megabytes"), number(r, "threads")))
        .collect();
    assert_eq!(pairs, [(1.0, 1.0), (1.0, 2.0), (2.0, 1.0), (2.0, 2.0)]);
    for entry in read {
        let rate = number(entry, "gigabytes_per_second");
        assert!((0.01..10_000.0).contains(&rate), "{entry}");
    }
    let multiply_add = list(&report, "multiply_add");
    let kinds: Vec<_> = multiply_add
        .iter()
        .map(|r| r["number"].as_str().unwrap())
        .collect();
    assert_eq!(kinds, ["f64", "f32", "f64", "f32"]);
    for entry in multiply_add {
        assert!((0.01..1e5).contains(&number(entry, "gigaflops")), "{entry}");
    }
}
