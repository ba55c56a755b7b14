//! One supernode of a Cholesky factor, packed for triangular solves with three right-hand sides.
//!
//! A supernode's columns share their rows, so its part of the factor is one dense panel. Here it is cut into blocks of eight
//! rows, one widest register each, and groups of eight columns; the triangle in which a group meets itself is kept inverted, so
//! that no operation waits for a division or for the row before it. Both sweeps read every value once, in the order in which
//! it is stored (or group by group in reverse), and the three axes share each load.

use faer::MatRef;
use pulp::Simd;

/// Rows of a block and columns of a group.
pub(crate) const WIDTH: usize = 8;

/// Eight values, on a boundary of eight: one load of the widest registers never touches two cache lines.
#[derive(Clone, Copy)]
#[repr(align(64))]
pub(crate) struct Block(pub(crate) [f64; WIDTH]);

impl Block {
    pub(crate) const ZERO: Self = Self([0.0; WIDTH]);
}

/// A block of each axis for the same eight rows.
pub(crate) type FrontBlock = [Block; 3];

/// The shape of a panel; its values are kept by the caller.
#[derive(Clone, Copy)]
pub(crate) struct Panel {
    /// Columns, and rows of the diagonal block.
    pub(crate) columns: usize,
    /// Rows below the diagonal block.
    pub(crate) below: usize,
}

impl Panel {
    /// Groups of columns, which is also the number of row blocks of the diagonal part.
    pub(crate) fn groups(self) -> usize {
        self.columns.div_ceil(WIDTH)
    }

    /// Row blocks: those of the columns, then those of the rows below, each filled up with zeros.
    pub(crate) fn row_blocks(self) -> usize {
        self.groups() + self.below.div_ceil(WIDTH)
    }

    /// Entries of the factor, the square diagonal block included.
    pub(crate) fn entries(self) -> usize {
        self.columns * (self.columns + self.below)
    }

    /// Appends the values of a panel `[columns + below, columns]`, of which the lower trapezium is read.
    ///
    /// Per group: eight columns of the inverse of its triangle, eight rows of the same, then for each row block after the
    /// group its eight columns. Columns that only fill up a group are those of the identity.
    pub(crate) fn pack(self, panel: MatRef<f64>, values: &mut Vec<Block>) {
        let place = |block: usize, lane: usize| {
            if block < self.groups() {
                let row = block * WIDTH + lane;
                (row < self.columns).then_some(row)
            } else {
                let row = (block - self.groups()) * WIDTH + lane;
                (row < self.below).then_some(self.columns + row)
            }
        };
        for group in 0..self.groups() {
            let first = group * WIDTH;
            let width = WIDTH.min(self.columns - first);
            let inverse = inverse_of_triangle(|i, j| {
                if i < width && j < width {
                    panel[(first + i, first + j)]
                } else {
                    f64::from(u8::from(i == j))
                }
            });
            values.extend(inverse.map(Block));
            values.extend((0..WIDTH).map(|i| Block(inverse.map(|column| column[i]))));
            for block in group + 1..self.row_blocks() {
                let start = values.len();
                values.resize(start + WIDTH, Block::ZERO);
                let blocks = &mut values[start..];
                // A run of rows within a block is a run of the panel's column, too.
                let Some(row) = place(block, 0) else { continue };
                let rows = (0..WIDTH).take_while(|&l| place(block, l).is_some());
                let rows = rows.count();
                for (j, out) in blocks.iter_mut().enumerate().take(width) {
                    for (l, value) in out.0.iter_mut().enumerate().take(rows) {
                        *value = panel[(row + l, first + j)];
                    }
                }
            }
        }
    }

    /// Blocks that [`Self::pack`] appends.
    pub(crate) fn packed_blocks(self) -> usize {
        let (groups, rows) = (self.groups(), self.row_blocks());
        (0..groups).map(|g| (rows - g + 1) * WIDTH).sum()
    }

    /// Solves with the diagonal block for the front's first row blocks, and takes their multiples from the rows below.
    #[inline(always)]
    pub(crate) fn forward<S: Simd>(self, simd: S, values: &[Block], front: &mut [FrontBlock]) {
        let mut values = values;
        for group in 0..self.groups() {
            let (own, after) = front[group..self.row_blocks()].split_at_mut(1);
            let (triangle, rest) = values.split_at(2 * WIDTH);
            let (rest, next) = rest.split_at(after.len() * WIDTH);
            values = next;
            own[0] = combine(simd, &triangle[..WIDTH], &own[0]);
            let factors = own[0].map(|b| b.0.map(|v| simd.splat_f64s(-v)));
            for (columns, rows) in rest.as_chunks::<WIDTH>().0.iter().zip(after) {
                for (factors, rows) in factors.iter().zip(rows) {
                    let rows = S::as_mut_simd_f64s(&mut rows.0).0;
                    for (part, row) in rows.iter_mut().enumerate() {
                        let mut sum = *row;
                        for (column, factor) in columns.iter().zip(factors) {
                            let column = S::as_simd_f64s(&column.0).0[part];
                            sum = simd.mul_add_e_f64s(column, *factor, sum);
                        }
                        *row = sum;
                    }
                }
            }
        }
    }

    /// Solves with the transposed panel for the front's first row blocks; the rows below are given.
    #[inline(always)]
    pub(crate) fn backward<S: Simd>(self, simd: S, values: &[Block], front: &mut [FrontBlock]) {
        let mut values = values;
        for group in (0..self.groups()).rev() {
            let (own, after) = front[group..self.row_blocks()].split_at_mut(1);
            let (before, last) = values.split_at(values.len() - (after.len() + 2) * WIDTH);
            values = before;
            let (triangle, rest) = last.split_at(2 * WIDTH);
            let rest = rest.as_chunks::<WIDTH>().0;
            // As many sums as there are registers for.
            if S::F64_LANES == WIDTH {
                subtract_products::<S, WIDTH>(simd, rest, after, 0, &mut own[0]);
            } else {
                for first in [0, 4] {
                    subtract_products::<S, 4>(simd, rest, after, first, &mut own[0]);
                }
            }
            own[0] = combine(simd, &triangle[WIDTH..], &own[0]);
        }
    }
}

/// `out_axis = sum_j columns_j x_axis_j`.
#[inline(always)]
fn combine<S: Simd>(simd: S, columns: &[Block], x: &FrontBlock) -> FrontBlock {
    let mut out = [Block::ZERO; 3];
    for (out, x) in out.iter_mut().zip(x) {
        for (part, sum) in S::as_mut_simd_f64s(&mut out.0).0.iter_mut().enumerate() {
            for (column, value) in columns.iter().zip(&x.0) {
                let column = S::as_simd_f64s(&column.0).0[part];
                *sum = simd.mul_add_e_f64s(column, simd.splat_f64s(*value), *sum);
            }
        }
    }
    out
}

/// Takes the product of each of `N` columns, from `first` on, with the rows from the entries of `out`.
#[inline(always)]
fn subtract_products<S: Simd, const N: usize>(
    simd: S,
    columns: &[[Block; WIDTH]],
    rows: &[FrontBlock],
    first: usize,
    out: &mut FrontBlock,
) {
    let mut sums = [[simd.splat_f64s(0.0); N]; 3];
    for (columns, rows) in columns.iter().zip(rows) {
        for part in 0..WIDTH / S::F64_LANES {
            let rows = [0, 1, 2].map(|axis: usize| S::as_simd_f64s(&rows[axis].0).0[part]);
            for j in 0..N {
                let column = S::as_simd_f64s(&columns[first + j].0).0[part];
                for axis in 0..3 {
                    sums[axis][j] = simd.mul_add_e_f64s(column, rows[axis], sums[axis][j]);
                }
            }
        }
    }
    for (out, sums) in out.iter_mut().zip(sums) {
        for (value, sum) in out.0[first..].iter_mut().zip(sums) {
            *value -= simd.reduce_sum_f64s(sum);
        }
    }
}

/// The inverse, by columns, of the lower triangle `entry(i, j)`.
fn inverse_of_triangle(entry: impl Fn(usize, usize) -> f64) -> [[f64; WIDTH]; WIDTH] {
    std::array::from_fn(|j| {
        let mut column = [0.0; WIDTH];
        column[j] = 1.0 / entry(j, j);
        for i in j + 1..WIDTH {
            let products = column[j..i].iter().zip(j..).map(|(c, k)| entry(i, k) * c);
            column[i] = -products.sum::<f64>() / entry(i, i);
        }
        column
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use faer::Mat;
    use pulp::{Scalar, WithSimd};

    struct Sweeps<'a>(Panel, &'a [Block], &'a mut [FrontBlock], bool);

    impl WithSimd for Sweeps<'_> {
        type Output = ();

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) {
            match self.3 {
                true => self.0.forward(simd, self.1, self.2),
                false => self.0.backward(simd, self.1, self.2),
            }
        }
    }

    /// Runs a sweep with every instruction set that there is.
    fn sweep(
        panel: Panel,
        values: &[Block],
        front: &[FrontBlock],
        forward: bool,
    ) -> Vec<Vec<FrontBlock>> {
        let mut fronts = vec![front.to_vec(); 2];
        Sweeps(panel, values, &mut fronts[0], forward).with_simd(Scalar);
        pulp::Arch::new().dispatch(Sweeps(panel, values, &mut fronts[1], forward));
        #[cfg(target_arch = "x86_64")]
        if let Some(v3) = pulp::x86::V3::try_new() {
            let mut front = front.to_vec();
            pulp::Simd::vectorize(v3, Sweeps(panel, values, &mut front, forward));
            fronts.push(front);
        }
        fronts
    }

    /// Both sweeps against their definition, for shapes that fill their blocks and shapes that do not.
    #[test]
    fn sweeps_solve_with_the_panel() {
        for (columns, below) in [(1, 0), (8, 8), (5, 3), (19, 0), (24, 13), (9, 40)] {
            let shape = Panel { columns, below };
            let panel = Mat::from_fn(columns + below, columns, |i, j| {
                if i == j {
                    2.0 + 0.1 * i as f64
                } else {
                    ((3 * i + 7 * j) as f64).sin() * 0.3
                }
            });
            let mut values = Vec::new();
            shape.pack(panel.as_ref(), &mut values);
            assert_eq!(values.len(), shape.packed_blocks());
            let place = |row: usize| match row.checked_sub(columns) {
                None => (row / WIDTH, row % WIDTH),
                Some(k) => (shape.groups() + k / WIDTH, k % WIDTH),
            };
            let at = |front: &[FrontBlock], row: usize, axis: usize| {
                let (block, lane) = place(row);
                front[block][axis].0[lane]
            };
            let mut front = vec![[Block::ZERO; 3]; shape.row_blocks()];
            for row in 0..columns + below {
                let (block, lane) = place(row);
                (0..3).for_each(|a| front[block][a].0[lane] = (row as f64 + 0.7 * a as f64).cos());
            }
            for axis in 0..3 {
                for after in sweep(shape, &values, &front, true) {
                    for i in 0..columns + below {
                        let sum: f64 = (0..columns.min(i + 1))
                            .map(|j| panel[(i, j)] * at(&after, j, axis))
                            .sum();
                        let rest = if i < columns {
                            0.0
                        } else {
                            at(&after, i, axis)
                        };
                        assert!((sum + rest - at(&front, i, axis)).abs() < 1e-12);
                    }
                }
                for after in sweep(shape, &values, &front, false) {
                    for j in 0..columns {
                        let sum: f64 = (j..columns + below)
                            .map(|i| panel[(i, j)] * at(&after, i, axis))
                            .sum();
                        assert!((sum - at(&front, j, axis)).abs() < 1e-12);
                    }
                }
            }
        }
    }
}
