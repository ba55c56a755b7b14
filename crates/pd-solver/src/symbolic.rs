//! Which entries the Cholesky factor of a sparse matrix has, by supernodes.
//!
//! The supernodes are given: the separators and leaves of the nested dissection. Each is treated as dense, so its rows are those
//! of its columns in the matrix together with those of its children in the elimination forest (Liu 1992, "The multifrontal
//! method for sparse matrix solution").

use crate::assembly::LowerTriangle;
use crate::panel::Panel;
use std::ops::Range;

/// The supernodes of a factor, their rows and their elimination forest.
pub(crate) struct Symbolic {
    nodes: Vec<SymbolicNode>,
    roots: Vec<usize>,
}

pub(crate) struct SymbolicNode {
    /// Columns of the factor.
    pub(crate) columns: Range<usize>,
    /// Rows below the diagonal block, rising.
    pub(crate) below: Vec<u32>,
    /// Supernodes whose first row below is one of the columns.
    pub(crate) children: Vec<usize>,
    /// Entries in the whole subtree.
    pub(crate) subtree_entries: usize,
    /// First supernode of the subtree, where the subtree is a run of supernodes.
    pub(crate) run_start: Option<usize>,
}

impl Symbolic {
    /// Analyses a matrix for supernodes that end before the given columns; `ends` rises up to the size of the matrix.
    pub(crate) fn new(matrix: &LowerTriangle, ends: &[usize]) -> Self {
        let mut owner = vec![0; matrix.size()];
        let mut nodes: Vec<SymbolicNode> = Vec::with_capacity(ends.len());
        let mut start = 0;
        for (s, &end) in ends.iter().enumerate() {
            owner[start..end].fill(s);
            nodes.push(SymbolicNode {
                columns: start..end,
                below: Vec::new(),
                children: Vec::new(),
                subtree_entries: 0,
                run_start: None,
            });
            start = end;
        }
        let mut roots = Vec::new();
        let (mut first, mut size) = ((0..ends.len()).collect::<Vec<_>>(), vec![1; ends.len()]);
        let mut seen = vec![usize::MAX; matrix.size()];
        for s in 0..nodes.len() {
            let mut below = Vec::new();
            let columns = nodes[s].columns.clone();
            let mut add = |row: usize| {
                if row >= columns.end && std::mem::replace(&mut seen[row], s) != s {
                    below.push(row as u32);
                }
            };
            let entries = columns.clone().flat_map(|j| matrix.column(j));
            entries.for_each(|(row, _)| add(row));
            for &child in &nodes[s].children {
                let rows = nodes[child].below.iter();
                rows.for_each(|&row| add(row as usize));
            }
            below.sort_unstable();
            let node = &mut nodes[s];
            node.below = below;
            node.subtree_entries += node.panel().entries();
            node.run_start = (s + 1 - first[s] == size[s]).then_some(first[s]);
            let entries = node.subtree_entries;
            // The first row below is the first column that this supernode changes.
            if let Some(&row) = node.below.first() {
                let parent = owner[row as usize];
                nodes[parent].children.push(s);
                nodes[parent].subtree_entries += entries;
                first[parent] = first[parent].min(first[s]);
                size[parent] += size[s];
            } else {
                roots.push(s);
            }
        }
        Self { nodes, roots }
    }

    /// The supernodes, by rising columns.
    pub(crate) fn nodes(&self) -> &[SymbolicNode] {
        &self.nodes
    }

    /// Supernodes without a parent.
    pub(crate) fn roots(&self) -> &[usize] {
        &self.roots
    }

    /// Entries of the factor, the diagonal blocks counted as squares.
    pub(crate) fn entries(&self) -> usize {
        (self.roots.iter())
            .map(|&r| self.nodes[r].subtree_entries)
            .sum()
    }
}

impl SymbolicNode {
    /// Shape of the supernode's panel.
    pub(crate) fn panel(&self) -> Panel {
        Panel {
            columns: self.columns.len(),
            below: self.below.len(),
        }
    }

    /// Places of rising rows, all of them columns or rows of this supernode, in its columns and then its rows below.
    pub(crate) fn places(&self, rows: &[u32]) -> Vec<u32> {
        let mut below = self.below.iter().enumerate();
        let place = |&row: &u32| {
            if (row as usize) < self.columns.end {
                row - self.columns.start as u32
            } else {
                let (k, _) = below
                    .find(|(_, r)| **r == row)
                    .expect("a row of the parent");
                (self.columns.len() + k) as u32
            }
        };
        rows.iter().map(place).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assembly::ConstantMatrix;

    /// A path 0 - 3 - 1 and an edge 2 - 4, one supernode for columns 0, 1 and one for each other column.
    #[test]
    fn forest_of_two_components() {
        let mut matrix = ConstantMatrix::new((0..5).map(Some).collect());
        for edge in [[0, 3], [1, 3], [2, 4]] {
            matrix.add_outer(&edge, &[1.0, -1.0], 1.0);
        }
        let symbolic = Symbolic::new(&matrix.compress(), &[2, 3, 4, 5]);
        assert_eq!(symbolic.roots(), [2, 3]);
        let below: Vec<_> = symbolic.nodes().iter().map(|n| n.below.clone()).collect();
        assert_eq!(below, [vec![3], vec![4], vec![], vec![]]);
        let runs: Vec<_> = symbolic.nodes().iter().map(|n| n.run_start).collect();
        assert_eq!(runs, [Some(0), Some(1), None, None]);
        assert_eq!(symbolic.entries(), (2 * 3 + 1) + (2 + 1));
        assert_eq!(symbolic.nodes()[0].places(&[1, 3]), [1, 2]);
    }
}
