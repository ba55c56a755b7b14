//! Which parts of which cells become elements.

use super::corners::Corners;
use super::cut::CutCells;
use super::inside::InsideVotes;

/// One element to be: a cell, and the part of its material that the element stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Candidate {
    pub cell: u32,
    pub part: u8,
}

/// The elements to be, by rising cell and part.
pub(crate) struct Candidates {
    pub list: Vec<Candidate>,
    /// Per cell of the grid: its first candidate, or `NONE`.
    first: Vec<u32>,
    /// Per part of the cut cells: its candidate, or `NONE`.
    of_part: Vec<u32>,
}

pub(crate) const NONE: u32 = u32::MAX;

impl Candidates {
    /// A cell that holds several substantial parts becomes an element for each. All other cells become one element when their centre
    /// is inside; it stands for the largest part.
    ///
    /// A part is substantial when it fills `least_fraction` of its cell. Without `cut`, every cell whose centre is inside is one part.
    pub fn new(
        cells: usize,
        votes: &InsideVotes,
        cut: Option<&CutCells>,
        least_fraction: f64,
    ) -> Self {
        let mut candidates = Self {
            list: Vec::new(),
            first: vec![NONE; cells],
            of_part: vec![NONE; cut.map_or(0, CutCells::total_parts)],
        };
        let mut substantial = Vec::new();
        for cell in 0..cells {
            let slot = cut.and_then(|cut| Some((cut, cut.slot(cell)?)));
            let Some((cut, slot)) = slot else {
                if votes.is_inside(cell) {
                    candidates.push(cell, 0);
                }
                continue;
            };
            let sizes = cut.part_sizes(slot);
            let least = least_fraction * cut.samples.pow(3) as f64;
            substantial.clear();
            substantial.extend((0..sizes.len()).filter(|&part| f64::from(sizes[part]) >= least));
            if substantial.len() < 2 {
                substantial.clear();
                // The first among equals.
                let largest = (0..sizes.len()).rev().max_by_key(|&part| sizes[part]);
                substantial.extend(largest.filter(|_| votes.is_inside(cell)));
            }
            for &part in &substantial {
                candidates.of_part[cut.first_part(slot) + part] = candidates.list.len() as u32;
                candidates.push(cell, part as u8);
            }
        }
        candidates
    }

    /// Whether a cell has a candidate.
    pub fn has(&self, cell: usize) -> bool {
        self.first[cell] != NONE
    }

    /// Adds parts that are no candidates yet.
    pub fn add(&mut self, cut: &CutCells, parts: impl Iterator<Item = Candidate>) {
        self.list.extend(parts);
        self.list
            .sort_unstable_by_key(|candidate| (candidate.cell, candidate.part));
        self.first.fill(NONE);
        for (index, &Candidate { cell, part }) in (0..).zip(&self.list) {
            let first = &mut self.first[cell as usize];
            *first = index.min(*first);
            if let Some(slot) = cut.slot(cell as usize) {
                self.of_part[cut.first_part(slot) + usize::from(part)] = index;
            }
        }
    }

    fn push(&mut self, cell: usize, part: u8) {
        if self.first[cell] == NONE {
            self.first[cell] = self.list.len() as u32;
        }
        let cell = cell as u32;
        self.list.push(Candidate { cell, part });
    }

    /// The candidates of a cell.
    pub fn of_cell(&self, cell: usize) -> impl Iterator<Item = usize> + Clone {
        let first = Some(self.first[cell]).filter(|&first| first != NONE);
        let all = first.map_or(0..0, |first| first as usize..self.list.len());
        all.take_while(move |&candidate| self.list[candidate].cell as usize == cell)
    }

    /// Whether a part of a cell is a candidate.
    pub fn is_candidate(&self, cut: &CutCells, cell: usize, part: u8) -> bool {
        match cut.slot(cell) {
            Some(slot) => self.of_part[cut.first_part(slot) + usize::from(part)] != NONE,
            None => self.first[cell] != NONE,
        }
    }

    /// Makes one candidate of those in one cell that share all their corners: material that is parted within the cell, but so
    /// little that no corner opens.
    pub fn unite_inseparable(&mut self, corners: &Corners) {
        let mut into: Vec<u32> = Vec::with_capacity(self.list.len());
        let mut kept: Vec<Candidate> = Vec::with_capacity(self.list.len());
        for &candidate in &self.list {
            let same_cell = kept.iter().enumerate().rev();
            let same_cell = same_cell.take_while(|(_, other)| other.cell == candidate.cell);
            let twin = { same_cell }.find(|(_, other)| {
                let shared = |corner| {
                    let [a, b] = [candidate.part, other.part];
                    corners.class(candidate.cell, corner, a) == corners.class(other.cell, corner, b)
                };
                (0..8).all(shared)
            });
            into.push(twin.map_or(kept.len(), |(index, _)| index) as u32);
            if twin.is_none() {
                kept.push(candidate);
            }
        }
        self.list = kept;
        let indices = self.first.iter_mut().chain(&mut self.of_part);
        for index in indices.filter(|index| **index != NONE) {
            *index = into[*index as usize];
        }
    }

    /// For each part of the cut cells, what `of_candidate` says of its candidate, or [`NONE`].
    pub fn for_parts(&self, of_candidate: &[u32]) -> Vec<u32> {
        let of_part = |&candidate: &u32| match candidate {
            NONE => NONE,
            candidate => of_candidate[candidate as usize],
        };
        self.of_part.iter().map(of_part).collect()
    }
}
