//! Triangular solves with a supernodal Cholesky factor, for the three axes at once.
//!
//! faer factors well, but its solve multiplies general matrices, which for three right-hand sides packs more than it computes.
//! Here a row's three values lie side by side (with one of padding) and every entry of the factor is read once per sweep.

use faer::sparse::linalg::cholesky::supernodal::SupernodalLltRef;
use faer::sparse::linalg::cholesky::{SymbolicCholesky, SymbolicCholeskyRaw};
use pulp::Arch;

/// The three values of a row, padded to a register.
pub(crate) type Row = [f64; 4];

/// A run of columns that share their rows below the diagonal block.
struct Supernode {
    first: usize,
    columns: usize,
    /// Rows below the diagonal block, as a range of `rows`.
    below: std::ops::Range<usize>,
    /// Start of its values: the diagonal block, then the rows below, both row by row, `columns` wide.
    values: usize,
}

/// The factor, packed for the solve.
pub(crate) struct PanelFactor {
    supernodes: Vec<Supernode>,
    rows: Vec<u32>,
    values: Vec<f64>,
    arch: Arch,
}

impl PanelFactor {
    /// Packs a supernodal factor; `None` when it is not supernodal.
    pub(crate) fn new(symbolic: &SymbolicCholesky<usize>, values: &[f64]) -> Option<Self> {
        let SymbolicCholeskyRaw::Supernodal(raw) = symbolic.raw() else {
            return None;
        };
        let factor = SupernodalLltRef::<usize, f64>::new(raw, values);
        let mut packed = Self {
            supernodes: Vec::with_capacity(raw.n_supernodes()),
            rows: Vec::new(),
            values: Vec::with_capacity(values.len()),
            arch: Arch::new(),
        };
        for s in 0..raw.n_supernodes() {
            let node = factor.supernode(s);
            let block = node.val();
            let start = packed.rows.len();
            packed.rows.extend(node.pattern().iter().map(|&r| r as u32));
            packed.supernodes.push(Supernode {
                first: raw.supernode_begin()[s],
                columns: block.ncols(),
                below: start..packed.rows.len(),
                values: packed.values.len(),
            });
            for i in 0..block.nrows() {
                packed
                    .values
                    .extend((0..block.ncols()).map(|j| block[(i, j)]));
            }
        }
        Some(packed)
    }

    /// Stored entries.
    pub(crate) fn entries(&self) -> usize {
        self.values.len()
    }

    /// `x <- (L L^T)^-1 x`, in the order of the factor.
    pub(crate) fn solve(&self, x: &mut [Row]) {
        self.arch.dispatch(|| {
            for node in &self.supernodes {
                self.forward(node, x);
            }
            for node in self.supernodes.iter().rev() {
                self.backward(node, x);
            }
        });
    }

    #[inline(always)]
    fn forward(&self, node: &Supernode, x: &mut [Row]) {
        let n = node.columns;
        let (diagonal, rest) = self.values[node.values..].split_at(n * n);
        let (before, after) = x.split_at_mut(node.first + n);
        let own = &mut before[node.first..];
        for i in 0..n {
            let row = &diagonal[i * n..][..n];
            let sum = weighted_sum(&row[..i], &own[..i]);
            own[i] = std::array::from_fn(|k| (own[i][k] - sum[k]) / row[i]);
        }
        let below = &self.rows[node.below.clone()];
        for (row, &target) in rest.chunks_exact(n).zip(below) {
            let sum = weighted_sum(row, own);
            let target = &mut after[target as usize - node.first - n];
            *target = std::array::from_fn(|k| target[k] - sum[k]);
        }
    }

    #[inline(always)]
    fn backward(&self, node: &Supernode, x: &mut [Row]) {
        let n = node.columns;
        let (diagonal, rest) = self.values[node.values..].split_at(n * n);
        let (before, after) = x.split_at_mut(node.first + n);
        let own = &mut before[node.first..];
        let below = &self.rows[node.below.clone()];
        for (row, &source) in rest.chunks_exact(n).zip(below) {
            subtract_multiples(row, &after[source as usize - node.first - n], own);
        }
        for i in (0..n).rev() {
            let row = &diagonal[i * n..][..n];
            let value = own[i].map(|v| v / row[i]);
            own[i] = value;
            subtract_multiples(&row[..i], &value, &mut own[..i]);
        }
    }
}

/// `sum_j row_j x_j`, in four sums so that the additions do not wait for each other.
#[inline(always)]
fn weighted_sum(row: &[f64], x: &[Row]) -> Row {
    let mut sums = [[0.0; 4]; 4];
    let (row4, row_rest) = row.as_chunks::<4>();
    let (x4, x_rest) = x.as_chunks::<4>();
    for (row, x) in row4.iter().zip(x4) {
        for j in 0..4 {
            for k in 0..4 {
                sums[j][k] += row[j] * x[j][k];
            }
        }
    }
    for (l, x) in row_rest.iter().zip(x_rest) {
        for k in 0..4 {
            sums[0][k] += l * x[k];
        }
    }
    std::array::from_fn(|k| (sums[0][k] + sums[1][k]) + (sums[2][k] + sums[3][k]))
}

/// `x_j -= row_j value`.
#[inline(always)]
fn subtract_multiples(row: &[f64], value: &Row, x: &mut [Row]) {
    for (l, x) in row.iter().zip(x) {
        for k in 0..4 {
            x[k] -= l * value[k];
        }
    }
}
