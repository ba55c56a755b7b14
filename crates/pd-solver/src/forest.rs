//! Triangular solves with a supernodal Cholesky factor, in parallel over independent subtrees of its elimination forest.
//!
//! A subtree touches its own rows and those of its ancestors, nothing else (Liu 1990, "The role of elimination trees in sparse
//! factorization"). Every subtree of about equal work is a task with private memory: what it takes from its ancestors' rows is
//! kept there, and the parent adds its children's shares in their order. The tasks do not depend on the number of threads, and
//! so neither do the results, to the last bit.

use crate::assembly::LowerTriangle;
use crate::multifrontal::{Update, eliminate};
use crate::panel::{Block, FrontBlock, Panel, WIDTH};
use crate::symbolic::{Symbolic, SymbolicNode};
use faer::MatRef;
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;
use std::ops::Range;

/// The values of a row for the three axes.
pub(crate) type Row = [f64; 3];

/// A subtree becomes one task when it holds at most this share of the factor ...
const TASKS: usize = 32;
/// ... or at most this many entries: less work than waking a thread costs.
const SMALL: usize = 1 << 15;

/// A supernode within its task.
struct Supernode {
    panel: Panel,
    /// Place of its first column in the task's rows.
    first: usize,
    /// Places of the rows below, as a range of [`Task::below`].
    below: Range<usize>,
    /// Its blocks, as a range of [`Task::values`].
    values: Range<usize>,
}

/// A run of supernodes that is worked on by one thread: a whole subtree, or one supernode above such subtrees.
struct Task {
    children: Vec<Task>,
    /// Columns eliminated here.
    columns: Range<usize>,
    /// Place in the parent's rows of each row that is touched but not eliminated here.
    outer: Vec<u32>,
    supernodes: Vec<Supernode>,
    below: Vec<u32>,
    values: Vec<Block>,
    /// The columns' values, then those of the outer rows.
    rows: Vec<Row>,
    /// The rows of one supernode, by axis.
    front: Vec<FrontBlock>,
}

/// The factor, packed for the solve.
pub(crate) struct Forest {
    roots: Vec<Task>,
    entries: usize,
    arch: Arch,
}

impl Forest {
    /// Factors a matrix and packs the factor.
    ///
    /// # Errors
    /// The column of the matrix whose pivot is not positive.
    pub(crate) fn factor(matrix: &LowerTriangle, symbolic: &Symbolic) -> Result<Self, usize> {
        let entries = symbolic.entries();
        let builder = Builder {
            matrix,
            symbolic,
            limit: SMALL.max(entries / TASKS),
        };
        let roots = builder.tasks(symbolic.roots(), None)?;
        Ok(Self {
            roots: roots.into_iter().map(|(task, _)| task).collect(),
            entries,
            arch: Arch::new(),
        })
    }

    /// Stored entries.
    pub(crate) fn entries(&self) -> usize {
        self.entries
    }

    /// Solves `L L^T x = b` in the order of the factor. `b` is asked for every row, from several threads; `x` is given every row.
    pub(crate) fn solve(
        &mut self,
        b: &(impl Fn(usize) -> Row + Sync),
        mut x: impl FnMut(usize, Row),
    ) {
        let arch = self.arch;
        self.roots.par_iter_mut().for_each(|t| t.forward(arch, b));
        self.roots
            .par_iter_mut()
            .for_each(|t| t.backward(arch, &[]));
        self.roots.iter().for_each(|t| t.give(&mut x));
    }
}

impl Task {
    fn forward(&mut self, arch: Arch, b: &(impl Fn(usize) -> Row + Sync)) {
        self.children
            .par_iter_mut()
            .for_each(|c| c.forward(arch, b));
        let (own, outer) = self.rows.split_at_mut(self.columns.len());
        for (row, column) in own.iter_mut().zip(self.columns.clone()) {
            *row = b(column);
        }
        outer.fill([0.0; 3]);
        for child in &self.children {
            let share = &child.rows[child.columns.len()..];
            for (share, &place) in share.iter().zip(&child.outer) {
                let row = &mut self.rows[place as usize];
                *row = std::array::from_fn(|axis| row[axis] + share[axis]);
            }
        }
        arch.dispatch(Forward(self));
    }

    fn backward(&mut self, arch: Arch, parent: &[Row]) {
        let outer = &mut self.rows[self.columns.len()..];
        for (row, &place) in outer.iter_mut().zip(&self.outer) {
            *row = parent[place as usize];
        }
        arch.dispatch(Backward(self));
        let rows = &self.rows;
        self.children
            .par_iter_mut()
            .for_each(|c| c.backward(arch, rows));
    }

    fn give(&self, x: &mut impl FnMut(usize, Row)) {
        self.children.iter().for_each(|c| c.give(x));
        for (column, row) in self.columns.clone().zip(&self.rows) {
            x(column, *row);
        }
    }
}

struct Forward<'a>(&'a mut Task);

impl WithSimd for Forward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Task {
            supernodes,
            below,
            values,
            rows,
            front,
            ..
        } = self.0;
        for node in &*supernodes {
            let front = &mut front[..node.panel.row_blocks()];
            node.load_columns(rows, front);
            front[node.panel.groups()..].fill([Block::ZERO; 3]);
            node.panel
                .forward(simd, &values[node.values.clone()], front);
            node.store_columns(front, rows);
            let shares = &front[node.panel.groups()..];
            for (chunk, share) in below[node.below.clone()].chunks(WIDTH).zip(shares) {
                for (lane, &place) in chunk.iter().enumerate() {
                    let row = &mut rows[place as usize];
                    *row = std::array::from_fn(|axis| row[axis] + share[axis].0[lane]);
                }
            }
        }
    }
}

struct Backward<'a>(&'a mut Task);

impl WithSimd for Backward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Task {
            supernodes,
            below,
            values,
            rows,
            front,
            ..
        } = self.0;
        for node in supernodes.iter().rev() {
            let front = &mut front[..node.panel.row_blocks()];
            node.load_columns(rows, front);
            let given = &mut front[node.panel.groups()..];
            for (chunk, given) in below[node.below.clone()].chunks(WIDTH).zip(given) {
                *given = [Block::ZERO; 3];
                for (lane, &place) in chunk.iter().enumerate() {
                    let row = &rows[place as usize];
                    (0..3).for_each(|axis| given[axis].0[lane] = row[axis]);
                }
            }
            node.panel
                .backward(simd, &values[node.values.clone()], front);
            node.store_columns(front, rows);
        }
    }
}

impl Supernode {
    #[inline(always)]
    fn load_columns(&self, rows: &[Row], front: &mut [FrontBlock]) {
        let own = &rows[self.first..][..self.panel.columns];
        for (chunk, block) in own.chunks(WIDTH).zip(front) {
            *block = [Block::ZERO; 3];
            for (lane, row) in chunk.iter().enumerate() {
                (0..3).for_each(|axis| block[axis].0[lane] = row[axis]);
            }
        }
    }

    #[inline(always)]
    fn store_columns(&self, front: &[FrontBlock], rows: &mut [Row]) {
        let own = &mut rows[self.first..][..self.panel.columns];
        for (chunk, block) in own.chunks_mut(WIDTH).zip(front) {
            for (lane, row) in chunk.iter_mut().enumerate() {
                *row = std::array::from_fn(|axis| block[axis].0[lane]);
            }
        }
    }
}

/// What building a task needs to know.
struct Builder<'a> {
    matrix: &'a LowerTriangle,
    symbolic: &'a Symbolic,
    /// Largest number of entries of a task with a whole subtree.
    limit: usize,
}

impl<'a> Builder<'a> {
    /// The tasks of some subtrees and what they leave for their parent.
    fn tasks(
        &self,
        roots: &[usize],
        parent: Option<&SymbolicNode>,
    ) -> Result<Vec<(Task, Update<'a>)>, usize> {
        // Of several errors the first in order is told, whichever came first in time.
        let tasks: Vec<_> = roots.par_iter().map(|&s| self.task(s, parent)).collect();
        tasks.into_iter().collect()
    }

    fn task(
        &self,
        root: usize,
        parent: Option<&SymbolicNode>,
    ) -> Result<(Task, Update<'a>), usize> {
        let nodes = self.symbolic.nodes();
        let top = &nodes[root];
        let whole = top.run_start.filter(|_| top.subtree_entries <= self.limit);
        let run = whole.unwrap_or(root)..root + 1;
        let (children, updates) = match whole {
            Some(_) => (Vec::new(), Vec::new()),
            None => self.tasks(&top.children, Some(top))?.into_iter().unzip(),
        };
        let mut updates: Vec<Option<Update>> = updates.into_iter().map(Some).collect();
        let columns = nodes[run.start].columns.start..top.columns.end;
        let blocks = nodes[run.clone()].iter().map(|n| n.panel().packed_blocks());
        let mut task = Task {
            children,
            outer: parent.map_or_else(Vec::new, |p| p.places(&top.below)),
            supernodes: Vec::with_capacity(run.len()),
            below: Vec::new(),
            values: Vec::with_capacity(blocks.sum()),
            rows: vec![[0.0; 3]; columns.len() + top.below.len()],
            front: Vec::new(),
            columns,
        };
        if whole.is_some() {
            updates.resize_with(run.len(), || None);
        }
        for s in run.clone() {
            let node = &nodes[s];
            let eliminated = match whole {
                Some(start) => {
                    let given = node.children.iter().map(|c| updates[c - start].take());
                    eliminate(self.matrix, node, given.flatten())?
                }
                None => eliminate(self.matrix, node, updates.drain(..).flatten())?,
            };
            task.push(node, top, eliminated.panel.as_ref());
            match whole {
                Some(start) => updates[s - start] = Some(eliminated.update),
                None => updates.push(Some(eliminated.update)),
            }
        }
        let front = task.supernodes.iter().map(|n| n.panel.row_blocks()).max();
        task.front = vec![[Block::ZERO; 3]; front.unwrap_or(0)];
        let update = updates.pop().flatten().expect("that of the root");
        Ok((task, update))
    }
}

impl Task {
    /// Appends a supernode of the subtree of `root`.
    fn push(&mut self, node: &SymbolicNode, root: &SymbolicNode, panel: MatRef<f64>) {
        let inside = node
            .below
            .partition_point(|&r| (r as usize) < self.columns.end);
        let (inside, outside) = node.below.split_at(inside);
        let (below, values) = (self.below.len(), self.values.len());
        let start = self.columns.start;
        self.below.extend(inside.iter().map(|&r| r - start as u32));
        let shift = (self.columns.len() - root.columns.len()) as u32;
        self.below
            .extend(root.places(outside).iter().map(|p| p + shift));
        let shape = node.panel();
        shape.pack(panel, &mut self.values);
        self.supernodes.push(Supernode {
            panel: shape,
            first: node.columns.start - start,
            below: below..self.below.len(),
            values: values..self.values.len(),
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assembly::ConstantMatrix;
    use crate::ordering::nested_dissection;
    use nalgebra::Vector3;

    /// Cells of a box without its core, and of a second box far from it: two components, the first not convex.
    fn matrix() -> (LowerTriangle, Vec<usize>) {
        let solid = |c: [i32; 3]| c[0] < 22 && !(1..3).all(|a| (5..12).contains(&c[a]));
        let second = |c: [i32; 3]| c[0] > 25 && c[1] < 4 && c[2] < 4;
        let mut nodes = std::collections::BTreeMap::new();
        let mut cells = Vec::new();
        for i in 0..32 * 17 * 17 {
            let c = [i / 289, i / 17 % 17, i % 17];
            if solid(c) || second(c) {
                cells.push([0, 1, 2, 3, 4, 5, 6, 7].map(|k| {
                    let node = [c[0] + (k & 1), c[1] + (k >> 1 & 1), c[2] + (k >> 2)];
                    let next = nodes.len() as u32;
                    *nodes.entry(node).or_insert(next)
                }));
            }
        }
        let mut points = vec![Vector3::zeros(); nodes.len()];
        for (node, &index) in &nodes {
            points[index as usize] = Vector3::from(node.map(|v| f64::from(v) * 0.5));
        }
        let dissection = nested_dissection(&points, 0.5);
        let mut rows = vec![None; points.len()];
        for (row, &point) in dissection.order.iter().enumerate() {
            rows[point] = Some(row as u32);
        }
        let mut matrix = ConstantMatrix::new(rows);
        for (i, cell) in cells.iter().enumerate() {
            let stiffness = 1.0 + (i as f64).sin() * 0.5;
            matrix.add_block(
                cell,
                |a, b| if a == b { 8.0 * stiffness } else { -stiffness },
            );
        }
        (matrix.compress(), dissection.ends)
    }

    fn solve(matrix: &LowerTriangle, ends: &[usize], b: &[Row]) -> (Vec<Row>, usize) {
        let mut forest = Forest::factor(matrix, &Symbolic::new(matrix, ends)).unwrap();
        let mut x = vec![[f64::NAN; 3]; b.len()];
        forest.solve(&|row| b[row], |row, value| x[row] = value);
        // What a solve leaves behind does not reach the next one.
        let first = x.clone();
        forest.solve(&|row| b[row], |row, value| x[row] = value);
        assert_eq!(first, x);
        let tasks = forest.roots.iter().map(|t| t.children.len()).sum();
        (x, tasks)
    }

    #[test]
    fn solves_in_tasks_with_the_same_bits_for_any_number_of_threads() {
        let (matrix, ends) = matrix();
        let b: Vec<Row> = (0..matrix.size())
            .map(|i| [0.3, 0.7, 1.1].map(|k| (k * i as f64).sin()))
            .collect();
        let (x, tasks) = solve(&matrix, &ends, &b);
        assert!(tasks > 1, "nothing to solve in parallel");
        let mut residual = b.clone();
        for j in 0..matrix.size() {
            for (i, value) in matrix.column(j) {
                for axis in 0..3 {
                    residual[i][axis] -= value * x[j][axis];
                    if i != j {
                        residual[j][axis] -= value * x[i][axis];
                    }
                }
            }
        }
        let largest = residual
            .iter()
            .flatten()
            .fold(0.0, |m: f64, r| m.max(r.abs()));
        assert!(largest < 1e-11, "{largest:e}");
        for threads in [1, 2, 5] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let again = pool.unwrap().install(|| solve(&matrix, &ends, &b));
            assert_eq!(x, again.0);
        }
    }

    #[test]
    fn an_indefinite_matrix_is_refused_with_its_column() {
        let mut matrix = ConstantMatrix::new((0..3).map(Some).collect());
        matrix.add_outer(&[0, 2], &[1.0, -1.0], 1.0);
        matrix.add_outer(&[1], &[1.0], -1.0);
        let lower = matrix.compress();
        let symbolic = Symbolic::new(&lower, &[1, 2, 3]);
        assert_eq!(Forest::factor(&lower, &symbolic).err(), Some(1));
    }
}
