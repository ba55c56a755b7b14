//! The catalogue, with as little of each case as still means something.

use myofield_hard_cases::{Effort, Section, catalogue};
use std::collections::HashSet;

fn holds(section: Section) {
    let mut cases = 0;
    for case in catalogue().into_iter().filter(|c| c.section == section) {
        let finding = case.run(&Effort::QUICK);
        assert!(
            finding.broken.is_empty(),
            "{}: {:?}",
            case.name,
            finding.broken
        );
        cases += 1;
    }
    assert!(cases > 0, "no case in {section:?}");
}

#[test]
fn solves_find_back_from_hopeless_starts() {
    holds(Section::Starts);
}

#[test]
fn actuations_that_no_muscle_has_are_solved() {
    holds(Section::Actuations);
}

#[test]
fn bodies_that_hardly_hang_together_are_solved() {
    holds(Section::Bodies);
}

#[test]
fn effects_at_their_worst_are_solved() {
    holds(Section::Effects);
}

#[test]
fn gradients_are_right_or_come_with_a_warning() {
    holds(Section::Adjoints);
}

#[test]
fn names_of_cases_are_unique() {
    let mut seen = HashSet::new();
    for case in catalogue() {
        assert!(seen.insert(case.name.clone()), "{} stands twice", case.name);
    }
}
