//! The passes and the product at all lengths and alignments: what lies beside a slice is neither read into the answer nor written.

use super::level::Level;
use super::{
    MatrixView, Update, first_layer, multiply, scale_and_sum_rows, sine_cosine_rows, sine_rows,
};

/// What stands around every slice.
const GUARD: f32 = 1.0e30;
/// More than a vector of any instruction set holds.
const MARGIN: usize = 19;

/// Numbers of a few binary digits: products and sums of them are exact, in every order.
fn entries(count: usize, seed: usize) -> Vec<f32> {
    (0..count)
        .map(|i| ((i * 7 + seed) % 11) as f32 - 5.0)
        .collect()
}

/// A slice that begins `offset` entries behind the start of an allocation, with guards on both sides.
struct Guarded {
    all: Vec<f32>,
    start: usize,
    length: usize,
}

impl Guarded {
    fn new(values: &[f32], offset: usize) -> Self {
        let start = MARGIN + offset;
        let mut all = vec![GUARD; start + values.len() + MARGIN];
        all[start..start + values.len()].copy_from_slice(values);
        Self {
            all,
            start,
            length: values.len(),
        }
    }

    fn slice(&self) -> &[f32] {
        &self.all[self.start..self.start + self.length]
    }

    fn slice_mut(&mut self) -> &mut [f32] {
        &mut self.all[self.start..self.start + self.length]
    }

    /// The contents, if nothing beside them was touched.
    #[track_caller]
    fn contents(&self) -> &[f32] {
        let (before, rest) = self.all.split_at(self.start);
        let after = &rest[self.length..];
        let is_whole = before.iter().chain(after).all(|&x| x == GUARD);
        assert!(is_whole, "written outside of the slice");
        self.slice()
    }
}

/// Widths and offsets: all of them; fewer where an interpreter runs this.
fn cases() -> impl Iterator<Item = (usize, usize)> {
    let (widths, offsets) = if cfg!(miri) { (18, 2) } else { (67, 17) };
    (1..=widths).flat_map(move |width| (0..offsets).map(move |offset| (width, offset)))
}

#[test]
fn the_first_layer_keeps_to_its_slices() {
    for level in Level::available() {
        for (width, offset) in cases() {
            let points = Guarded::new(&entries(3 * 3, 1), offset);
            let columns = Guarded::new(&entries(3 * width, 2), offset / 2);
            let mut z = Guarded::new(&vec![f32::NAN; 3 * width], offset);
            first_layer(level, points.slice(), columns.slice(), z.slice_mut());
            for (index, found) in z.contents().iter().enumerate() {
                let (p, j) = (index / width, index % width);
                let (x, w) = (points.slice(), columns.slice());
                let exact: f32 = (0..3).map(|k| x[3 * p + k] * w[k * width + j]).sum();
                assert_eq!(*found, exact, "{level:?}, width {width}, offset {offset}");
            }
        }
    }
}

#[test]
fn sines_keep_to_their_slices() {
    for level in Level::available() {
        for (width, offset) in cases() {
            let start: Vec<f32> = entries(3 * width, 1);
            let bias = Guarded::new(&entries(width, 5), offset / 3);
            let mut both = Guarded::new(&start, offset);
            let mut cosine = Guarded::new(&vec![f32::NAN; 3 * width], offset / 2);
            let mut alone = Guarded::new(&start, offset / 2);
            let b = bias.slice();
            sine_cosine_rows(level, both.slice_mut(), cosine.slice_mut(), b);
            sine_rows(level, alone.slice_mut(), b);
            let (sine, cosine) = (both.contents(), cosine.contents());
            assert_eq!(sine, alone.contents());
            for (index, z) in start.iter().enumerate() {
                let x = f64::from(z + b[index % width]);
                let off = (f64::from(sine[index]) - x.sin()).abs();
                let other = (f64::from(cosine[index]) - x.cos()).abs();
                assert!(off < 2e-7 && other < 2e-7, "{level:?}, width {width}");
            }
        }
    }
}

#[test]
fn scaling_and_summing_keeps_to_its_slices() {
    for level in Level::available() {
        for (width, offset) in cases() {
            let (before, start) = (entries(3 * width, 1), entries(width, 3));
            let factor = Guarded::new(&entries(3 * width, 2), offset / 2);
            let mut bar = Guarded::new(&before, offset);
            let mut sum = Guarded::new(&start, offset / 3);
            scale_and_sum_rows(level, bar.slice_mut(), factor.slice(), sum.slice_mut());
            let (bar, sum) = (bar.contents(), sum.contents());
            for j in 0..width {
                let mut expected = start[j];
                for p in 0..3 {
                    let index = p * width + j;
                    assert_eq!(bar[index], before[index] * factor.slice()[index]);
                    expected += bar[index];
                }
                assert_eq!(sum[j], expected, "{level:?}, width {width}");
            }
        }
    }
}

/// Sizes around those of the blocks that a product is cut into, and every small one.
#[test]
fn products_keep_to_their_slices() {
    let sizes: &[usize] = match cfg!(miri) {
        true => &[1, 2, 5],
        false => &[1, 2, 3, 4, 5, 6, 7, 8, 9, 12, 15, 16, 17, 31, 33],
    };
    for (i, &m) in sizes.iter().enumerate() {
        for (j, &k) in sizes.iter().enumerate() {
            for (l, &n) in sizes.iter().enumerate() {
                // Every offset meets every size.
                let offset = (i + 3 * j + 5 * l) % 17;
                let a = Guarded::new(&entries(m * k, 1), offset);
                let b = Guarded::new(&entries(k * n, 2), offset / 2);
                for is_turned in [false, true] {
                    check_product((m, k, n), (&a, &b), offset, is_turned);
                }
            }
        }
    }
}

#[track_caller]
fn check_product(
    (m, k, n): (usize, usize, usize),
    (a, b): (&Guarded, &Guarded),
    offset: usize,
    is_turned: bool,
) {
    // Turned, the same numbers are the transposes of a [k, m] and an [n, k] matrix.
    let (lhs, rhs) = match is_turned {
        false => (MatrixView::new(a.slice(), k), MatrixView::new(b.slice(), n)),
        true => (
            MatrixView::new(a.slice(), m).transposed(),
            MatrixView::new(b.slice(), k).transposed(),
        ),
    };
    let at = |i: usize, c: usize, j: usize| match is_turned {
        false => a.slice()[i * k + c] * b.slice()[c * n + j],
        true => a.slice()[c * m + i] * b.slice()[j * k + c],
    };
    for update in [Update::Overwrite, Update::Add] {
        let is_added = update == Update::Add;
        // What is overwritten must not be read.
        let before = if is_added { 2.0 } else { f32::NAN };
        let mut out = Guarded::new(&vec![before; m * n], offset);
        multiply(out.slice_mut(), update, lhs, rhs);
        for (index, found) in out.contents().iter().enumerate() {
            let (i, j) = (index / n, index % n);
            let sum: f32 = (0..k).map(|c| at(i, c, j)).sum();
            let start = if is_added { 2.0 } else { 0.0 };
            assert_eq!(*found, start + sum, "{m} x {k} x {n}, offset {offset}");
        }
    }
}
