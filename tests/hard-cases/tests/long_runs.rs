//! In a process of its own: memory that other tests take would count as growth.

use myofield_hard_cases::{Effort, Section, catalogue};

#[test]
fn many_solves_neither_drift_nor_grow() {
    for case in catalogue() {
        if case.section == Section::LongRuns {
            let finding = case.run(&Effort::QUICK);
            assert!(
                finding.broken.is_empty(),
                "{}: {:?}",
                case.name,
                finding.broken
            );
        }
    }
}
