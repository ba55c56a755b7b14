//! Passes over the rows of a chunk of activations, `[points, width]` row-major, one function per instruction set.

use super::level::{InstructionSet, Level};
use super::sine::{fma, sine, sine_cosine};

/// Defines a pass that runs `$body` compiled for the instruction set of `level`.
macro_rules! per_instruction_set {
    ($(#[$doc:meta])* $name:ident, $body:ident, ($($arg:ident: $type:ty),*)) => {
        $(#[$doc])*
        pub(crate) fn $name(level: Level, $($arg: $type),*) {
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx512f,avx512dq,avx512bw,avx512vl,avx2,fma")]
            fn avx512($($arg: $type),*) {
                $body::<true>($($arg),*)
            }
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2,fma")]
            fn avx2($($arg: $type),*) {
                $body::<true>($($arg),*)
            }
            match level.0 {
                // SAFETY: a `Level` is made only after its features were detected.
                #[cfg(target_arch = "x86_64")]
                InstructionSet::Avx512 => unsafe { avx512($($arg),*) },
                // SAFETY: as above.
                #[cfg(target_arch = "x86_64")]
                InstructionSet::Avx2 => unsafe { avx2($($arg),*) },
                InstructionSet::Portable => $body::<false>($($arg),*),
            }
        }
    };
}

per_instruction_set! {
    /// `z = W x` for every point: `points` `[p, 3]`, `columns` the three columns of `W` one after another, `z` `[p, width]`.
    first_layer, first_layer_body, (points: &[f32], columns: &[f32], z: &mut [f32])
}

per_instruction_set! {
    /// `z = sin(z + bias)`, in place.
    sine_rows, sine_rows_body, (z: &mut [f32], bias: &[f32])
}

per_instruction_set! {
    /// `z = sin(z + bias)` in place, `cosine = cos(z + bias)`.
    sine_cosine_rows, sine_cosine_rows_body, (z: &mut [f32], cosine: &mut [f32], bias: &[f32])
}

per_instruction_set! {
    /// `bar *= factor` entry by entry, then adds the sum of the rows of `bar` to `sum`.
    scale_and_sum_rows, scale_and_sum_rows_body, (bar: &mut [f32], factor: &[f32], sum: &mut [f32])
}

#[inline(always)]
fn first_layer_body<const FMA: bool>(points: &[f32], columns: &[f32], z: &mut [f32]) {
    let width = columns.len() / 3;
    let (w0, rest) = columns.split_at(width);
    let (w1, w2) = rest.split_at(width);
    for (x, row) in points.chunks_exact(3).zip(z.chunks_exact_mut(width)) {
        let weights = w0.iter().zip(w1).zip(w2);
        for (z, ((&w0, &w1), &w2)) in row.iter_mut().zip(weights) {
            *z = fma::<FMA>(x[0], w0, fma::<FMA>(x[1], w1, x[2] * w2));
        }
    }
}

#[inline(always)]
fn sine_rows_body<const FMA: bool>(z: &mut [f32], bias: &[f32]) {
    for row in z.chunks_exact_mut(bias.len()) {
        for (z, &b) in row.iter_mut().zip(bias) {
            *z = sine::<FMA>(*z + b);
        }
    }
}

#[inline(always)]
fn sine_cosine_rows_body<const FMA: bool>(z: &mut [f32], cosine: &mut [f32], bias: &[f32]) {
    let width = bias.len();
    for (row, cosine) in z
        .chunks_exact_mut(width)
        .zip(cosine.chunks_exact_mut(width))
    {
        for ((z, c), &b) in row.iter_mut().zip(cosine).zip(bias) {
            (*z, *c) = sine_cosine::<FMA>(*z + b);
        }
    }
}

#[inline(always)]
fn scale_and_sum_rows_body<const FMA: bool>(bar: &mut [f32], factor: &[f32], sum: &mut [f32]) {
    let width = sum.len();
    for (row, factor) in bar.chunks_exact_mut(width).zip(factor.chunks_exact(width)) {
        for ((bar, &f), sum) in row.iter_mut().zip(factor).zip(sum.iter_mut()) {
            *bar *= f;
            *sum += *bar;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whole numbers and a width that no vector length divides.
    const WIDTH: usize = 21;

    fn entries(count: usize, seed: usize) -> Vec<f32> {
        (0..count)
            .map(|i| ((i * 7 + seed) % 11) as f32 - 5.0)
            .collect()
    }

    /// Largest absolute errors of sine and cosine over `arguments`.
    fn sine_errors(level: Level, arguments: impl Iterator<Item = f32>) -> [f64; 2] {
        let x: Vec<f32> = arguments.collect();
        let (mut sine, mut cosine) = (x.clone(), x.clone());
        sine_cosine_rows(level, &mut sine, &mut cosine, &[0.0; 1]);
        let mut alone = x.clone();
        sine_rows(level, &mut alone, &[0.0; 1]);
        assert_eq!(sine, alone, "both passes give the same sine");
        let error = |found: &[f32], exact: fn(f64) -> f64| {
            let pairs = found.iter().zip(&x);
            pairs.fold(0.0, |worst: f64, (f, x)| {
                worst.max((f64::from(*f) - exact(f64::from(*x))).abs())
            })
        };
        [error(&sine, f64::sin), error(&cosine, f64::cos)]
    }

    #[test]
    #[cfg_attr(miri, ignore = "millions of arguments take an interpreter for ever")]
    fn sine_and_cosine_are_accurate_up_to_300() {
        for level in Level::available() {
            let grid = (-2_000_000..=2_000_000).map(|i| i as f32 * 1.5e-4);
            let [sine, cosine] = sine_errors(level, grid);
            println!("{level:?}: sine {sine:.2e}, cosine {cosine:.2e}");
            assert!(sine < 1.25e-7, "{level:?}: {sine:e}");
            assert!(cosine < 1.8e-7, "{level:?}: {cosine:e}");
        }
    }

    #[test]
    fn small_arguments_keep_their_relative_accuracy() {
        for level in Level::available() {
            for exponent in -120..-12 {
                let x = 1.3 * 2.0f32.powi(exponent);
                let mut z = [x];
                sine_rows(level, &mut z, &[0.0]);
                assert!((z[0] / x - 1.0).abs() < 2e-7, "{x:e} -> {:e}", z[0]);
            }
        }
    }

    #[test]
    fn huge_arguments_stay_bounded_and_nan_stays_nan() {
        for level in Level::available() {
            for x in [1e5, 1e9, -3e20, f32::MAX] {
                let (mut s, mut c) = ([x], [0.0]);
                sine_cosine_rows(level, &mut s, &mut c, &[0.0]);
                assert!(s[0].abs() < 1.01 && c[0].abs() < 1.01, "{x:e}: {s:?} {c:?}");
            }
            for x in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
                let (mut s, mut c) = ([x], [0.0]);
                sine_cosine_rows(level, &mut s, &mut c, &[0.0]);
                assert!(s[0].is_nan() && c[0].is_nan(), "{x}: {s:?} {c:?}");
            }
        }
    }

    #[test]
    fn the_first_layer_is_a_matrix_product() {
        let (points, columns) = (entries(3 * 5, 1), entries(3 * WIDTH, 2));
        for level in Level::available() {
            let mut z = vec![f32::NAN; 5 * WIDTH];
            first_layer(level, &points, &columns, &mut z);
            for (index, found) in z.iter().enumerate() {
                let (p, j) = (index / WIDTH, index % WIDTH);
                let exact: f32 = (0..3)
                    .map(|axis| points[3 * p + axis] * columns[axis * WIDTH + j])
                    .sum();
                assert_eq!(*found, exact);
            }
        }
    }

    #[test]
    fn scaling_and_summing_equals_the_double_loop() {
        let factor = entries(4 * WIDTH, 2);
        for level in Level::available() {
            let mut bar = entries(4 * WIDTH, 1);
            let mut sum = entries(WIDTH, 3);
            scale_and_sum_rows(level, &mut bar, &factor, &mut sum);
            let (before, start) = (entries(4 * WIDTH, 1), entries(WIDTH, 3));
            for j in 0..WIDTH {
                let mut expected = start[j];
                for p in 0..4 {
                    let product = before[p * WIDTH + j] * factor[p * WIDTH + j];
                    assert_eq!(bar[p * WIDTH + j], product);
                    expected += product;
                }
                assert_eq!(sum[j], expected);
            }
        }
    }
}
