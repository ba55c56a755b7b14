//! A bounds-checked face on the single-threaded matrix product of the `gemm` crate.

/// A row-major matrix, or the transpose of one.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MatrixView<'a> {
    data: &'a [f32],
    rows: usize,
    columns: usize,
    row_stride: usize,
    column_stride: usize,
}

impl<'a> MatrixView<'a> {
    /// The row-major matrix with `columns` columns that fills `data`.
    ///
    /// # Panics
    /// If `data` is not a whole number of rows.
    pub fn new(data: &'a [f32], columns: usize) -> Self {
        assert_eq!(data.len() % columns, 0, "matrix rows must be whole");
        Self {
            data,
            rows: data.len() / columns,
            columns,
            row_stride: columns,
            column_stride: 1,
        }
    }

    /// The transpose, without moving anything.
    pub fn transposed(self) -> Self {
        Self {
            data: self.data,
            rows: self.columns,
            columns: self.rows,
            row_stride: self.column_stride,
            column_stride: self.row_stride,
        }
    }
}

/// What a product does to its destination.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Update {
    /// Replace it.
    Overwrite,
    /// Add to it.
    Add,
}

/// `out = lhs rhs` or `out += lhs rhs`, `out` row-major, on the calling thread.
///
/// # Panics
/// If the shapes do not fit.
pub(crate) fn multiply(out: &mut [f32], update: Update, lhs: MatrixView, rhs: MatrixView) {
    let (m, k, n) = (lhs.rows, lhs.columns, rhs.columns);
    assert_eq!(k, rhs.rows, "inner sizes of a matrix product");
    assert_eq!(out.len(), m * n, "destination of a matrix product");
    let read_out = update == Update::Add;
    let keep = if read_out { 1.0 } else { 0.0 };
    // SAFETY: a view's data holds exactly rows * columns entries and its strides address those (`new` and `transposed` are
    // the only constructors), `out` holds m * n entries addressed row-major, and `&mut` rules out overlap.
    unsafe {
        gemm::gemm(
            m,
            n,
            k,
            out.as_mut_ptr(),
            1,
            n as isize,
            read_out,
            lhs.data.as_ptr(),
            lhs.column_stride as isize,
            lhs.row_stride as isize,
            rhs.data.as_ptr(),
            rhs.column_stride as isize,
            rhs.row_stride as isize,
            keep,
            1.0,
            false,
            false,
            false,
            gemm::Parallelism::None,
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whole numbers, so that every order of summation gives the same answer.
    fn entries(count: usize, seed: usize) -> Vec<f32> {
        (0..count)
            .map(|i| ((i * 7 + seed) % 11) as f32 - 5.0)
            .collect()
    }

    fn entry(view: &MatrixView, row: usize, column: usize) -> f32 {
        view.data[row * view.row_stride + column * view.column_stride]
    }

    #[test]
    fn products_equal_the_triple_loop_for_all_layouts() {
        for (m, k, n) in [(1, 1, 1), (5, 3, 64), (37, 64, 6), (64, 130, 3), (6, 1, 9)] {
            let (a, b) = (entries(m * k, 1), entries(k * n, 2));
            let lhs = [MatrixView::new(&a, k), MatrixView::new(&a, m).transposed()];
            let rhs = [MatrixView::new(&b, n), MatrixView::new(&b, k).transposed()];
            for (lhs, rhs) in lhs.iter().flat_map(|l| rhs.iter().map(move |r| (*l, *r))) {
                for update in [Update::Overwrite, Update::Add] {
                    let mut out = vec![2.0; m * n];
                    multiply(&mut out, update, lhs, rhs);
                    let start = if update == Update::Add { 2.0 } else { 0.0 };
                    for (index, found) in out.iter().enumerate() {
                        let (row, column) = (index / n, index % n);
                        let sum: f32 = (0..k)
                            .map(|i| entry(&lhs, row, i) * entry(&rhs, i, column))
                            .sum();
                        assert_eq!(*found, start + sum);
                    }
                }
            }
        }
    }

    #[test]
    #[should_panic(expected = "inner sizes")]
    fn a_wrong_shape_is_refused() {
        let data = [0.0; 6];
        multiply(
            &mut [0.0; 4],
            Update::Overwrite,
            MatrixView::new(&data, 3),
            MatrixView::new(&data, 3),
        );
    }
}
