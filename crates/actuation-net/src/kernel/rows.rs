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
