//! Which elements share the node at a lattice point.
//!
//! Around a lattice point lie eight cells. Their parts fall into classes: parts are of one class when material connects them through
//! the faces between these eight cells, be it by parts that are no elements. Each class has a node of its own.

use std::collections::HashMap;

use rayon::prelude::*;

use super::candidates::Candidates;
use super::cut::{CutCells, flat};
use super::links::FaceLinks;
use super::pieces::grid_position;
use crate::corner_offset;

/// The lattice points at which elements of more than one class meet. At all others there is one node.
pub(crate) struct Corners {
    counts: [usize; 3],
    /// Steps of the flat index of points from a cell's lowest corner to each of its corners.
    steps: [usize; 8],
    /// Per cell: whether one of its corners is a split point; empty when there is none at all.
    touches_split: Vec<bool>,
    split: HashMap<u32, Vec<Member>>,
}

/// A candidate at a lattice point, and its class there.
struct Member {
    cell: u32,
    part: u8,
    class: u8,
}

impl Corners {
    /// One node at every lattice point of a grid of `counts` cells.
    pub fn whole(counts: [usize; 3]) -> Self {
        let points = counts.map(|n| n + 1);
        Self {
            counts,
            steps: std::array::from_fn(|corner| flat(corner_offset(corner), points)),
            touches_split: Vec::new(),
            split: HashMap::new(),
        }
    }

    /// Finds the lattice points at which the candidates' nodes must be apart.
    pub fn new(cut: &CutCells, links: &FaceLinks, candidates: &Candidates) -> Self {
        let mut corners = Self::whole(cut.counts);
        let points_of =
            |&cell: &u32| -> [u32; 8] { std::array::from_fn(|corner| corners.point(cell, corner)) };
        let mut points: Vec<u32> = cut.cells.iter().flat_map(points_of).collect();
        points.par_sort_unstable();
        points.dedup();
        let members = |&point: &u32| {
            let members = corners.members(point as usize, cut, links, candidates);
            Some((point, members?))
        };
        let split: Vec<_> = points
            .par_iter()
            .with_min_len(256)
            .filter_map(members)
            .collect();
        if !split.is_empty() {
            corners.touches_split = vec![false; cut.counts.iter().product()];
        }
        for member in split.iter().flat_map(|(_, members)| members) {
            corners.touches_split[member.cell as usize] = true;
        }
        corners.split = split.into_iter().collect();
        corners
    }

    /// Number of lattice points.
    pub fn point_count(&self) -> usize {
        self.counts.iter().map(|n| n + 1).product()
    }

    /// Position in the grid of a lattice point.
    pub fn position(&self, point: usize) -> [usize; 3] {
        grid_position(point, self.counts.map(|n| n + 1))
    }

    /// The lattice point at a corner of a cell.
    pub fn point(&self, cell: u32, corner: usize) -> u32 {
        self.points(cell)[corner]
    }

    /// The lattice points at the corners of a cell.
    pub fn points(&self, cell: u32) -> [u32; 8] {
        let position = grid_position(cell as usize, self.counts);
        let lowest = flat(position, self.counts.map(|n| n + 1));
        self.steps.map(|step| (lowest + step) as u32)
    }

    /// Whether a cell has a corner at which classes are apart. Most have not, and need not be looked at further.
    #[inline]
    pub fn touches_split(&self, cell: u32) -> bool {
        !self.touches_split.is_empty() && self.touches_split[cell as usize]
    }

    /// The class of a candidate at a corner of its cell: 0 where there is one node only.
    pub fn class(&self, cell: u32, corner: usize, part: u8) -> u8 {
        if !self.touches_split(cell) {
            return 0;
        }
        let members = self.split.get(&self.point(cell, corner));
        let mut members = members.into_iter().flatten();
        let found = members.find(|member| member.cell == cell && member.part == part);
        found.map_or(0, |member| member.class)
    }

    /// The candidates around a point with their classes, if there are several.
    fn members(
        &self,
        point: usize,
        cut: &CutCells,
        links: &FaceLinks,
        candidates: &Candidates,
    ) -> Option<Vec<Member>> {
        let position = self.position(point);
        // The cell whose corner `corner` lies at the point.
        let cells: [Option<usize>; 8] = std::array::from_fn(|corner| {
            let offset = corner_offset(corner);
            let inside =
                |a: usize| position[a] >= offset[a] && position[a] - offset[a] < self.counts[a];
            (0..3).all(inside).then(|| {
                flat(
                    std::array::from_fn(|a| position[a] - offset[a]),
                    self.counts,
                )
            })
        });
        let mut first = [0; 9];
        for corner in 0..8 {
            first[corner + 1] = first[corner] + cells[corner].map_or(0, |c| cut.part_count(c));
        }
        let mut sets: Vec<usize> = (0..first[8]).collect();
        for (axis, bit) in [4, 2, 1].into_iter().enumerate() {
            // The point lies on the upper side of the lower cell.
            for corner in (0..8).filter(|corner| corner & bit != 0) {
                let (Some(lower), Some(upper)) = (cells[corner], cells[corner ^ bit]) else {
                    continue;
                };
                for &[a, b] in links.between(cut, lower, upper, axis) {
                    let a = root(&sets, first[corner] + usize::from(a));
                    let b = root(&sets, first[corner ^ bit] + usize::from(b));
                    sets[a.max(b)] = a.min(b);
                }
            }
        }
        let mut roots = Vec::new();
        let mut members = Vec::new();
        for (corner, cell) in cells.into_iter().enumerate() {
            let Some(cell) = cell else { continue };
            for part in 0..first[corner + 1] - first[corner] {
                if !candidates.is_candidate(cut, cell, part as u8) {
                    continue;
                }
                let root = root(&sets, first[corner] + part);
                let known = roots.iter().position(|&other| other == root);
                let class = known.unwrap_or_else(|| {
                    roots.push(root);
                    roots.len() - 1
                });
                members.push(Member {
                    cell: cell as u32,
                    part: part as u8,
                    class: class as u8,
                });
            }
        }
        (roots.len() > 1).then_some(members)
    }
}

/// The lowest member of a set; sets are small, so paths are not shortened.
fn root(sets: &[usize], mut member: usize) -> usize {
    while sets[member] != member {
        member = sets[member];
    }
    member
}
