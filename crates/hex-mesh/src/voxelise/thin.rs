//! Elements for what is too thin to hold cell centres: fingers, the edge of an ear.

use std::collections::VecDeque;

use super::candidates::{Candidate, Candidates};
use super::cut::CutCells;
use super::links::FaceLinks;

/// Samples that a thin part must hold: fewer are a grazing corner.
const LEAST: u16 = 2;

/// Makes candidates of the parts that connect with none, and of those on the shortest ways from candidates to the bulk of the body.
pub(crate) fn cover_thin(candidates: &mut Candidates, cut: &CutCells, links: &FaceLinks) {
    let thin = all_parts(cut).filter(|&(cell, part, size)| {
        let mut around = links.around(cut, cell, part);
        size >= LEAST
            && !candidates.is_candidate(cut, cell, part)
            && !around.any(|(cell, part)| candidates.is_candidate(cut, cell, part))
    });
    let thin: Vec<_> = thin.map(|(cell, part, _)| candidate(cell, part)).collect();
    candidates.add(cut, thin.into_iter());
    let ways = ways_to_bulk(candidates, cut, links);
    candidates.add(cut, ways.into_iter());
}

fn candidate(cell: usize, part: u8) -> Candidate {
    let cell = cell as u32;
    Candidate { cell, part }
}

/// Cell, part and samples of all parts of cut cells.
fn all_parts(cut: &CutCells) -> impl Iterator<Item = (usize, u8, u16)> {
    cut.cells.iter().enumerate().flat_map(|(slot, &cell)| {
        let sizes = (0..).zip(cut.part_sizes(slot));
        sizes.map(move |(part, &size)| (cell as usize, part, size))
    })
}

/// The parts that are no candidates on the ways from all candidates to the largest set of linked candidates, with as few of them on
/// each way as possible.
fn ways_to_bulk(candidates: &Candidates, cut: &CutCells, links: &FaceLinks) -> Vec<Candidate> {
    let number = |cell: usize, part: u8| match cut.slot(cell) {
        Some(slot) => cut.first_part(slot) + usize::from(part),
        None => cut.total_parts() + cell,
    };
    let total = cut.total_parts() + cut.counts.iter().product::<usize>();
    // The largest set, by its first candidate.
    let mut seen = vec![false; total];
    let mut bulk = (0, None);
    for seed in &candidates.list {
        let mut stack = vec![(seed.cell as usize, seed.part)];
        if std::mem::replace(&mut seen[number(stack[0].0, seed.part)], true) {
            continue;
        }
        let mut size = 0;
        while let Some((cell, part)) = stack.pop() {
            size += 1;
            for (cell, part) in links.around(cut, cell, part) {
                let is_candidate = candidates.is_candidate(cut, cell, part);
                if is_candidate && !std::mem::replace(&mut seen[number(cell, part)], true) {
                    stack.push((cell, part));
                }
            }
        }
        if size > bulk.0 {
            bulk = (size, Some(*seed));
        }
    }
    let Some(seed) = bulk.1 else {
        return Vec::new();
    };

    // From there, candidates are reached at no cost, other parts at one each; the cheapest come first.
    let mut before: Vec<Option<(usize, u8)>> = vec![None; total];
    let mut done = vec![false; total];
    let start = (seed.cell as usize, seed.part);
    let mut queue = VecDeque::from([(start, start)]);
    let mut reached = Vec::new();
    while let Some((at, from)) = queue.pop_front() {
        let (cell, part) = at;
        if std::mem::replace(&mut done[number(cell, part)], true) {
            continue;
        }
        before[number(cell, part)] = Some(from);
        if candidates.is_candidate(cut, cell, part) {
            reached.push(at);
        }
        for next in links.around(cut, cell, part) {
            if candidates.is_candidate(cut, next.0, next.1) {
                queue.push_front((next, at));
            } else {
                queue.push_back((next, at));
            }
        }
    }
    let mut is_on_way = vec![false; total];
    let mut ways = Vec::new();
    for mut at in reached {
        while !std::mem::replace(&mut is_on_way[number(at.0, at.1)], true) {
            if !candidates.is_candidate(cut, at.0, at.1) {
                ways.push(candidate(at.0, at.1));
            }
            at = before[number(at.0, at.1)].unwrap_or(at);
        }
    }
    ways
}
