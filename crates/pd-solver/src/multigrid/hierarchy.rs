//! The grids of a body from fine to coarse, and which of their nodes are held.

use super::grid::{Coarsening, Grid};
use super::transfer::Transfer;
use hex_mesh::HexMesh;

/// The coarsest level is solved by a dense factor; with at most this many free nodes that costs next to nothing.
const COARSEST: usize = 40;
/// A coarsest level with more free nodes than this makes the whole hierarchy not worth its while.
const LARGEST_DENSE: usize = 250;

/// Grids from fine to coarse.
pub(crate) struct Hierarchy {
    pub(crate) grids: Vec<Grid>,
    /// Interpolation from grid `l + 1` to grid `l`.
    pub(crate) transfers: Vec<Transfer>,
    /// The element of grid `l + 1` that holds each element of grid `l`.
    pub(crate) parents: Vec<Vec<u32>>,
    /// Prescribed nodes of every grid: on coarse ones, those that coincide with one on the finest.
    pub(crate) held: Vec<Vec<bool>>,
}

impl Hierarchy {
    /// Coarsens a body until its free nodes are few. `None` where that leads nowhere: bodies that are small to begin with, or of
    /// very many pieces. `factors` are those on the stiffness of each element, where they differ.
    pub(crate) fn new(mesh: &HexMesh, prescribed: &[u32], factors: Option<&[f64]>) -> Option<Self> {
        let grid = Grid::from_mesh(mesh, factors);
        let mut held = vec![false; grid.node_count()];
        prescribed.iter().for_each(|&n| held[n as usize] = true);
        let mut all = Self {
            grids: vec![grid],
            transfers: Vec::new(),
            parents: Vec::new(),
            held: vec![held],
        };
        while all.free_on_coarsest() > COARSEST
            && let Some(coarser) = all.grids[all.grids.len() - 1].coarsen()
        {
            all.add(coarser);
        }
        (all.grids.len() > 1 && all.free_on_coarsest() <= LARGEST_DENSE).then_some(all)
    }

    fn add(&mut self, coarser: Coarsening) {
        let Coarsening {
            grid,
            parent,
            transfer,
        } = coarser;
        let mut held = vec![false; grid.node_count()];
        for (node, &is_held) in self.held[self.held.len() - 1].iter().enumerate() {
            if is_held && let Some(same) = transfer.coincident(node) {
                held[same as usize] = true;
            }
        }
        self.grids.push(grid);
        self.transfers.push(transfer);
        self.parents.push(parent);
        self.held.push(held);
    }

    fn free_on_coarsest(&self) -> usize {
        self.held[self.held.len() - 1]
            .iter()
            .filter(|h| !**h)
            .count()
    }

    /// Where an element of grid `level` lies in its parent, and which of its corners are held (one bit each).
    pub(super) fn place_in_parent(&self, level: usize, element: usize) -> ([[f64; 2]; 3], u8) {
        let parent = self.parents[level][element] as usize;
        let interval = self.grids[level].interval(element, &self.grids[level + 1], parent);
        let corners = self.grids[level].elements[element].iter().enumerate();
        let held = corners.fold(0, |bits, (n, &node)| {
            bits | u8::from(self.held[level][node as usize]) << n
        });
        (interval, held)
    }
}
