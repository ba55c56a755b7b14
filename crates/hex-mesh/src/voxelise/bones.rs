//! Cells inside bones, and the nodes that bones hold.

use surface_mesh::Surface;

use super::candidates::{Candidates, NONE};
use super::closed::check_closed;
use super::corners::Corners;
use super::grid::CellGrid;
use super::inside::{InsideVotes, PointGrid};
use super::number::NumberedParts;
use super::pieces::grid_position;
use crate::HexMeshError;

/// Refuses bones without an inside.
pub(crate) fn check_bones(bones: &[Surface]) -> Result<(), HexMeshError> {
    for (bone, surface) in bones.iter().enumerate() {
        check_closed(surface.vertices(), surface.triangles()).map_err(|source| {
            let source = Box::new(source);
            HexMeshError::Bone { bone, source }
        })?;
    }
    Ok(())
}

/// Which bone each lattice point lies in.
pub(crate) struct BonePoints {
    /// The first bone around each point, or [`NONE`]; empty without bones.
    bone_at: Vec<u32>,
    /// Points in more than one bone.
    pub shared: usize,
    count: usize,
}

impl BonePoints {
    /// Casts rays along the lattice through every bone.
    pub fn new(bones: &[Surface], grid: &CellGrid) -> Self {
        let lattice = PointGrid {
            first: grid.corner(grid.first_cell),
            spacing: grid.size,
            counts: grid.counts.map(|n| n + 1),
        };
        let points = lattice.counts.iter().product::<usize>();
        let mut found = Self {
            bone_at: vec![NONE; if bones.is_empty() { 0 } else { points }],
            shared: 0,
            count: bones.len(),
        };
        let mut is_shared = vec![false; found.bone_at.len()];
        for (bone, surface) in (0..).zip(bones) {
            let votes = InsideVotes::new(&lattice, surface.vertices(), surface.triangles());
            for (point, own) in found.bone_at.iter_mut().enumerate() {
                if !votes.is_inside(point) {
                } else if *own == NONE {
                    *own = bone;
                } else {
                    is_shared[point] = true;
                }
            }
        }
        found.shared = is_shared.into_iter().filter(|&shared| shared).count();
        found
    }

    fn at(&self, point: u32) -> u32 {
        self.bone_at.get(point as usize).copied().unwrap_or(NONE)
    }

    /// The bone in which all corners of each candidate's cell lie, or [`NONE`]. With `cover`, candidates beside which the body ends are
    /// in no bone.
    pub fn of_candidates(
        &self,
        candidates: &Candidates,
        corners: &Corners,
        grid: &CellGrid,
        cover: bool,
    ) -> Vec<u32> {
        let bone_of = |cell: u32| {
            let [first, others @ ..] = corners.points(cell).map(|point| self.at(point));
            let is_whole = first != NONE && others.iter().all(|&other| other == first);
            match is_whole && !(cover && is_outermost(cell as usize, candidates, grid)) {
                true => first,
                false => NONE,
            }
        };
        let cells = candidates.list.iter().map(|candidate| candidate.cell);
        cells.map(bone_of).collect()
    }

    /// The nodes of each bone, by rising index: those inside it.
    pub fn nodes(&self, numbered: &NumberedParts) -> Vec<Vec<u32>> {
        let mut nodes = vec![Vec::new(); self.count];
        for (node, &point) in (0..).zip(&numbered.points) {
            if let Some(own) = nodes.get_mut(self.at(point) as usize) {
                own.push(node);
            }
        }
        nodes
    }
}

/// Whether one of the 26 cells around a cell is none of the body's.
fn is_outermost(cell: usize, candidates: &Candidates, grid: &CellGrid) -> bool {
    let position = grid_position(cell, grid.counts);
    let around = |offset: usize| -> Option<usize> {
        let mut index = 0;
        let mut left = offset;
        for (place, count) in position.into_iter().zip(grid.counts) {
            let place = (place + left % 3).checked_sub(1)?;
            left /= 3;
            if place >= count {
                return None;
            }
            index = index * count + place;
        }
        Some(index)
    };
    (0..27).any(|offset| around(offset).is_none_or(|cell| !candidates.has(cell)))
}
