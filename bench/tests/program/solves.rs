//! What `box`, `body`, `methods`, `warm`, `effects` and `threads` write: complete, in agreement with one another, and with another code
//! for the same box.

use crate::common::{Place, number, numbers, run};
use serde_json::Value;

/// Everything that a measurement tells.
const KEYS: [&str; 23] = [
    "cells",
    "elements",
    "method",
    "setup_s",
    "forward_s",
    "first_forward_s",
    "backward_s",
    "iterations",
    "adjoint_iterations",
    "energy",
    "residual",
    "estimated_error",
    "true_error",
    "tip",
    "mean",
    "peak_mb",
    "threads",
    "load",
    "status",
    "adjoint_status",
    "adjoint_residual",
    "positions_hash",
    "stats",
];

/// All keys are there, and what can be told without solving is right.
#[track_caller]
fn check_measurement(m: &Value) {
    for key in KEYS {
        assert!(m.get(key).is_some(), "{key} is absent");
    }
    for step in ["setup", "forward", "backward"] {
        let median = number(m, &format!("{step}_s"));
        let all = numbers(m, &format!("all_{step}_s"));
        let (low, high) = all.iter().fold((f64::MAX, 0.0), |(l, h): (f64, f64), &s| {
            (l.min(s), h.max(s))
        });
        assert!(
            0.0 < low && low <= median && median <= high,
            "{step}: {all:?}"
        );
    }
    assert_eq!(m["status"], "converged");
    assert_eq!(m["adjoint_status"], "converged");
    // The solver promises the same bits for the same input, whatever it solved before.
    let many = numbers(m, "all_forward_s").len() > 1;
    assert_eq!(
        m["repeatable"],
        if many { Value::Bool(true) } else { Value::Null }
    );
    assert!(number(m, "residual") <= number(m, "relative_gradient"));
    assert!(number(m, "adjoint_residual") <= number(m, "adjoint_tolerance"));
    assert!(number(m, "iterations") > 0.0 && number(m, "adjoint_iterations") > 0.0);
}

#[track_caller]
fn near(a: f64, b: f64, tolerance: f64) {
    assert!((a - b).abs() <= tolerance, "{a} and {b}");
}

/// The tip of the box of 32 x 16 x 16 elements as another code found it, to 6 decimals; and the energy as local/global and
/// Newton agree on it.
#[test]
fn the_box_agrees_with_an_independent_code() {
    let m = Place::new().measure("box --cells 32,16,16 --runs 2 --relative-gradient 1e-6");
    check_measurement(&m);
    assert_eq!(number(&m, "elements"), 8192.0);
    near(number(&m, "energy"), 0.996_839_58, 1e-7);
    let tip = numbers(&m, "tip");
    for (found, expected) in tip.into_iter().zip([0.322_272, 0.151_897, -0.060_911]) {
        near(found, expected, 2e-6);
    }
}

#[test]
fn a_tighter_solve_is_nearer_to_the_reference() {
    let place = Place::new();
    let error = |tolerance: &str| {
        let m = place.measure(&format!(
            "box --cells 4,2,2 --runs 2 --reference --relative-gradient {tolerance}"
        ));
        check_measurement(&m);
        assert!(number(&m["reference"], "energy") <= number(&m, "energy") * (1.0 + 1e-12));
        number(&m, "true_error") / number(&m, "extent")
    };
    let (loose, tight) = (error("1e-2"), error("1e-6"));
    assert!(
        loose < 0.05 && tight < 1e-5 && tight < 0.01 * loose,
        "{loose:e} {tight:e}"
    );
}

#[test]
fn runs_threads_and_amplitude_are_what_was_asked() {
    let place = Place::new();
    let m = place.measure("box --cells 4,2,2 --runs 3 --threads 1 --amplitude 0.5");
    check_measurement(&m);
    assert_eq!(numbers(&m, "all_forward_s").len(), 3);
    assert_eq!(number(&m, "threads"), 1.0);
    let still = place.measure("box --cells 4,2,2 --runs 1 --amplitude 0");
    // Without actuation the box stays where it is.
    near(number(&still, "energy"), 0.0, 1e-12);
    for (found, expected) in numbers(&still, "tip").into_iter().zip([0.04, 0.02, 0.02]) {
        near(found, expected, 1e-12);
    }
    assert!(number(&m, "energy") > 1e-4);
    // A budget that one run exceeds leaves one of each.
    let m = place.measure("box --cells 4,2,2 --runs 9 --budget 1e-9");
    assert_eq!(numbers(&m, "all_setup_s").len(), 1);
    assert_eq!(numbers(&m, "all_backward_s").len(), 1);
}

#[test]
fn a_solve_that_does_not_converge_says_so() {
    let place = Place::new();
    let json = place.path("out.json");
    let ran = run(&format!(
        "box --cells 4,2,2 --runs 1 --max-iterations 1 --json {}",
        json.display()
    ));
    assert_eq!(ran.code, Some(3), "{ran:?}");
    let m = place.read(&json);
    assert_eq!(m["status"], "iteration_limit");
    assert_eq!(m["adjoint_status"], "forward_not_converged");
    assert_eq!(m["adjoint_residual"], Value::Null);
}

#[test]
fn all_methods_find_the_same_energy() {
    let table = Place::new().measure("methods --sizes 4x2x2,6x3x3 --runs 1 --limit 100");
    let methods = table["methods"].as_array().unwrap();
    assert!(methods.len() >= 3, "{methods:?}");
    let cells = table["table"].as_array().unwrap();
    assert_eq!(cells.len(), 2 * methods.len());
    for (i, cell) in cells.iter().enumerate() {
        let m = &cell["measurement"];
        check_measurement(m);
        assert_eq!(m["method"], methods[i / 2]);
        assert_eq!(cell["size"], ["4x2x2", "6x3x3"][i % 2]);
        let first = number(&cells[i % 2]["measurement"], "energy");
        near(number(m, "energy"), first, 1e-5 * first);
    }
}

#[test]
fn a_method_over_the_limit_is_ended_and_not_tried_on_larger_boxes() {
    let line = "methods --sizes 4x2x2,6x3x3 --methods lbfgs --runs 1 --limit 1e-3";
    let table = Place::new().measure(line);
    assert_eq!(table["table"][0]["absent"], "over 0.001 s");
    assert_eq!(
        table["table"][1]["absent"],
        "skipped: over 0.001 s at 4x2x2"
    );
    assert_eq!(table["table"][1]["measurement"], Value::Null);
}

#[test]
fn a_body_is_compared_with_a_box_of_as_many_elements() {
    let place = Place::new();
    let line = format!(
        "body --surface {} --element-size 0.4 --runs 2",
        place.ball().display()
    );
    let m = place.measure(&line);
    check_measurement(&m);
    let solid_box = &m["solid_box"];
    check_measurement(solid_box);
    let ratio = number(solid_box, "elements") / number(&m, "elements");
    assert!((0.7..1.4).contains(&ratio), "{ratio}");
    let per_element = |m: &Value| number(m, "forward_s") / number(m, "elements");
    let expected = per_element(&m) / per_element(solid_box);
    near(
        number(&m["ratio_to_box"], "forward"),
        expected,
        1e-9 * expected,
    );
    let microseconds = number(&m["per_element_us"], "forward");
    near(microseconds, 1e6 * per_element(&m), 1e-6 * microseconds);
    // Another choice of what is held, and another actuation, are other problems.
    let held = place.measure(&format!("{line} --fix z<0"));
    let seeded = place.measure(&format!("{line} --seed 2"));
    let energies = [&m, &held, &seeded].map(|m| number(m, "energy"));
    assert!(
        energies[0] != energies[1] && energies[0] != energies[2],
        "{energies:?}"
    );
}

#[test]
fn a_warm_start_needs_fewer_iterations() {
    let r = Place::new().measure("warm --cells 6,3,3 --runs 2 --relative-gradient 1e-6");
    assert!(number(&r, "warm_iterations") < number(&r, "cold_iterations"));
    assert!(number(&r, "warm_iterations") > 0.0);
    let energy = number(&r, "cold_energy");
    near(number(&r, "warm_energy"), energy, 1e-8 * energy);
    assert!(number(&r, "distance") < 1e-5);
    let share = number(&r, "warm_s") / number(&r, "cold_s");
    near(number(&r, "share"), share, 1e-9 * share);
    assert_eq!(numbers(&r, "all_warm_s").len(), 2);
    assert_eq!(r["cells"], serde_json::json!([6, 3, 3]));
}

/// The body and the actuation are those that `body` measures.
#[test]
fn a_warm_start_of_a_body_inside_a_surface() {
    let place = Place::new();
    let options = format!(
        "--surface {} --element-size 0.4 --amplitude 0.1 --relative-gradient 1e-6 --runs 1",
        place.ball().display()
    );
    let same = place.measure(&format!("body {options}"));
    let r = place.measure(&format!("warm --change 0 {options}"));
    assert_eq!(r["cells"], Value::Null);
    assert_eq!(r["elements"], same["elements"]);
    assert_eq!(r["cold_energy"], same["energy"]);
    assert_eq!(r["warm_iterations"], 0);
    let changed = place.measure(&format!("warm {options}"));
    assert!(number(&changed, "warm_iterations") < number(&changed, "cold_iterations"));
}

#[test]
fn every_effect_is_measured_beside_none() {
    let r = Place::new().measure("effects --cells 6,3,3 --runs 2");
    let lists = r["lists"].as_array().unwrap();
    assert_eq!(lists[0]["list"], "none");
    let refused = r["refused"].as_array().unwrap().len();
    assert_eq!(lists.len() + refused, 14);
    for list in lists {
        assert_eq!(list["status"], "converged", "{list}");
        assert_eq!(numbers(list, "all_solve_s").len(), 2);
        assert!(number(&list["ratios"], "evaluation") > 0.0);
        let bytes = number(&list["counts"], "effect_bytes");
        assert!(bytes >= number(&lists[0]["counts"], "effect_bytes"));
    }
    assert!(number(&r["dispatch"], "paired_ratio") > 0.0);
}

#[test]
fn threads_do_not_change_a_bit() {
    let r = Place::new().measure("threads --cells 6,3,3 --runs 1 --counts 1,2,3");
    assert_eq!(r["same_bits"], true);
    let measurements = r["measurements"].as_array().unwrap();
    let threads: Vec<_> = measurements.iter().map(|m| number(m, "threads")).collect();
    assert_eq!(threads, [1.0, 2.0, 3.0]);
    measurements.iter().for_each(check_measurement);
    let speedup = number(&measurements[0], "forward_s") / number(&measurements[2], "forward_s");
    near(numbers(&r, "forward_speedup")[2], speedup, 1e-9 * speedup);
}
