//! Cells inside bones, and the nodes that bones hold.

use rayon::prelude::*;
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

/// The bone in which each candidate's centre lies, the first among several, or [`NONE`]. With `cover`, candidates beside which the body
/// ends are in no bone.
pub(crate) fn bones_of(
    candidates: &Candidates,
    bones: &[Surface],
    grid: &CellGrid,
    cover: bool,
) -> Vec<u32> {
    let votes = votes(&grid.centres(), bones);
    let bone_of = |cell: u32| {
        if cover && is_outermost(cell as usize, candidates, grid) {
            return NONE;
        }
        let bone = votes
            .iter()
            .position(|votes| votes.is_inside(cell as usize));
        bone.map_or(NONE, |bone| bone as u32)
    };
    candidates
        .list
        .iter()
        .map(|candidate| bone_of(candidate.cell))
        .collect()
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

/// The nodes of each bone, by rising index: the corners of the candidates that lie in it, and the nodes inside it. A node of several
/// bones goes to the one with most of these candidates around it, and that it is inside of counts as nine; the first among equals.
pub(crate) fn bone_nodes(
    bone_of: &[u32],
    bones: &[Surface],
    candidates: &Candidates,
    corners: &Corners,
    numbered: &NumberedParts,
    grid: &CellGrid,
) -> Vec<Vec<u32>> {
    let mut claims: Vec<(u32, u32)> = Vec::new();
    for (candidate, &bone) in candidates.list.iter().zip(bone_of) {
        if bone != NONE {
            let nodes = (0..8).filter_map(|corner| numbered.find(*candidate, corner, corners));
            claims.extend(nodes.map(|node| (node, bone)));
        }
    }
    let lattice = PointGrid {
        first: grid.corner(grid.first_cell),
        spacing: grid.size,
        counts: grid.counts.map(|n| n + 1),
    };
    // More than all the cells around a node.
    const INSIDE: usize = 9;
    for (bone, votes) in (0..).zip(votes(&lattice, bones)) {
        let nodes = (0..).zip(&numbered.points);
        let inside = nodes.filter(|(_, point)| votes.is_inside(**point as usize));
        claims.extend(inside.flat_map(|(node, _)| [(node, bone); INSIDE]));
    }
    claims.par_sort_unstable();
    let mut nodes = vec![Vec::new(); bones.len()];
    for claims in claims.chunk_by(|a, b| a.0 == b.0) {
        let each = claims.chunk_by(|a, b| a == b);
        // The last of equal maxima is the first bone.
        if let Some(most) = { each }.rev().max_by_key(|same| same.len()) {
            let (node, bone) = most[0];
            nodes[bone as usize].push(node);
        }
    }
    nodes
}

fn votes(grid: &PointGrid, bones: &[Surface]) -> Vec<InsideVotes> {
    let votes = |bone: &Surface| InsideVotes::new(grid, bone.vertices(), bone.triangles());
    bones.iter().map(votes).collect()
}
