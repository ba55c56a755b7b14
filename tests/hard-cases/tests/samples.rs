//! Every class of single samples, in brief: nothing that must hold is broken.

use myofield_hard_cases::{Effort, Section, catalogue};

#[test]
fn what_must_hold_of_every_sample_holds() {
    let mut classes = 0;
    let mut broken = String::new();
    for case in catalogue() {
        if case.section != Section::Samples {
            continue;
        }
        classes += 1;
        for what in case.run(&Effort::QUICK).broken {
            broken.push_str(&format!("{}: {what}\n", case.name));
        }
    }
    assert!(broken.is_empty(), "{broken}");
    assert!(classes > 30, "{classes} classes");
}
