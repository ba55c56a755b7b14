//! One 3x3 matrix at a time, through every function of `polar-grad`, one by one and in batches.
//!
//! Every class of samples is drawn at random around a planted answer. Decompositions, derivatives and batches are checked on every draw;
//! spectra, filters and energies on every fourth; dense eigenvalues and finite differences on one of 256. A draw is given by its class and number alone, and what is found does not depend on the number
//! of threads.

mod batches;
mod classes;
mod cores;
mod decompositions;
mod derivatives;
mod draws;
mod energies;
mod invalid;
mod tally;

use crate::case::{Case, Effort, Section};
use classes::{CLASSES, Class};
use draws::Draw;
use rayon::prelude::*;
use tally::Tally;

/// Draws that are batched together; odd, so that registers and blocks are left half full.
const CHUNK: usize = 1021;
/// Dear checks are done on one draw of so many.
const THINNING: u64 = 256;
/// Spectra, filters and energies are checked on one draw of so many.
const CORES: u64 = 4;

pub fn cases() -> Vec<Case> {
    let classes = CLASSES.iter().map(|class| {
        Case::new(
            Section::Samples,
            format!("sample {}", class.name),
            class.story,
            move |effort: &Effort| tally(class, effort.draws).finding(effort.draws),
        )
    });
    classes.chain([invalid::case()]).collect()
}

/// What is found of the first draws of a class.
fn tally(class: &Class, draws: usize) -> Tally {
    let parts: Vec<Tally> = (0..draws.div_ceil(CHUNK))
        .into_par_iter()
        .map(|chunk| {
            let first = chunk * CHUNK;
            let count = CHUNK.min(draws - first);
            part(class, first as u64, count)
        })
        .collect();
    let mut sum = Tally::default();
    for part in &parts {
        sum.merge(part);
    }
    sum
}

/// What is found of some draws, one by one and together.
fn part(class: &Class, first: u64, count: usize) -> Tally {
    let mut tally = Tally::default();
    let draws: Vec<Draw> = (0..count).map(|i| class.draw(first + i as u64)).collect();
    for (i, draw) in draws.iter().enumerate() {
        let number = first + i as u64;
        let dear = number.is_multiple_of(THINNING);
        let known = decompositions::check(&mut tally, number, draw);
        derivatives::check(&mut tally, number, draw, &known, dear);
        if number.is_multiple_of(CORES) {
            cores::check(&mut tally, number, draw, dear);
            energies::check(&mut tally, number, draw, dear);
        }
    }
    batches::check(&mut tally, first, &draws);
    tally
}

/// Whether all entries are finite.
fn finite(m: &nalgebra::Matrix3<f64>) -> bool {
    m.iter().all(|x| x.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_found_depends_on_the_number_of_the_draw_only() {
        let class = &CLASSES[5];
        let whole = tally(class, 2 * CHUNK).table();
        let mut parts = part(class, 0, CHUNK);
        parts.merge(&part(class, CHUNK as u64, CHUNK));
        assert_eq!(parts.table(), whole);
    }
}
