//! A tree of boxes around cells, for points far from all of them.

use nalgebra::Vector3;

/// A candidate for the nearest cell: squared distance in cells, then the element.
pub(crate) type Candidate = (f64, usize);

/// The better of two candidates; equals go to the lowest element.
pub(crate) fn nearer(a: Candidate, b: Candidate) -> Candidate {
    if (b.0, b.1) < (a.0, a.1) { b } else { a }
}

/// Squared distance, in cells, from a point in grid coordinates to the box of cells `min..=max`.
pub(crate) fn cell_distance(local: &Vector3<f64>, min: [i32; 3], max: [i32; 3]) -> f64 {
    let outside = |axis: usize| {
        let below = f64::from(min[axis]) - local[axis];
        let above = local[axis] - (f64::from(max[axis]) + 1.0);
        below.max(above).max(0.0)
    };
    (0..3).map(|axis| outside(axis).powi(2)).sum()
}

/// A binary tree that halves the cells across the longest side of their box, down to leaves of at most [`LEAF`] cells.
pub(crate) struct CellTree<'a> {
    cells: &'a [[i32; 3]],
    /// Elements, those of each subtree together.
    order: Vec<u32>,
    /// Subtrees in depth-first order: a left child follows its parent.
    nodes: Vec<TreeNode>,
}

struct TreeNode {
    min: [i32; 3],
    max: [i32; 3],
    /// Range of `order`.
    start: u32,
    end: u32,
    /// The right child, or 0 for a leaf.
    right: u32,
}

/// Scanning eight cells costs about as much as visiting two more boxes.
const LEAF: usize = 8;

impl<'a> CellTree<'a> {
    /// A tree of some of the cells, at least one, given by `elements`.
    pub fn new(cells: &'a [[i32; 3]], elements: Vec<u32>) -> Self {
        let count = elements.len();
        let mut tree = Self {
            cells,
            order: elements,
            nodes: Vec::new(),
        };
        tree.split(0, count);
        tree
    }

    /// Appends the subtree of `order[start..end]`.
    fn split(&mut self, start: usize, end: usize) {
        let cells = self.cells;
        let part = &mut self.order[start..end];
        let (mut min, mut max) = ([i32::MAX; 3], [i32::MIN; 3]);
        for &element in &*part {
            let cell = cells[element as usize];
            min = std::array::from_fn(|axis| min[axis].min(cell[axis]));
            max = std::array::from_fn(|axis| max[axis].max(cell[axis]));
        }
        let node = self.nodes.len();
        self.nodes.push(TreeNode {
            min,
            max,
            start: start as u32,
            end: end as u32,
            right: 0,
        });
        if part.len() <= LEAF {
            return;
        }
        let side = |axis: &usize| max[*axis].abs_diff(min[*axis]);
        let axis = (0..3).max_by_key(side).unwrap_or(0);
        let middle = part.len() / 2;
        part.select_nth_unstable_by_key(middle, |&element| {
            (cells[element as usize][axis], element)
        });
        self.split(start, start + middle);
        self.nodes[node].right = self.nodes.len() as u32;
        self.split(start + middle, end);
    }

    /// The cell nearest to a point in grid coordinates.
    pub fn nearest(&self, local: &Vector3<f64>) -> Candidate {
        self.search(0, local, (f64::INFINITY, usize::MAX))
    }

    fn search(&self, node: usize, local: &Vector3<f64>, mut best: Candidate) -> Candidate {
        let TreeNode {
            start, end, right, ..
        } = self.nodes[node];
        if right == 0 {
            for &element in &self.order[start as usize..end as usize] {
                let cell = self.cells[element as usize];
                best = nearer(best, (cell_distance(local, cell, cell), element as usize));
            }
            return best;
        }
        let mut children = [node + 1, right as usize].map(|child| {
            let TreeNode { min, max, .. } = self.nodes[child];
            (cell_distance(local, min, max), child)
        });
        if children[1].0 < children[0].0 {
            children.swap(0, 1);
        }
        for (distance, child) in children {
            // Equal distances are searched too: the lowest element wins.
            if distance <= best.0 {
                best = self.search(child, local, best);
            }
        }
        best
    }
}
