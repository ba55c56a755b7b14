//! Smaller inputs that do the same harm.

use crate::Target;
use crate::watch::{Harm, execute};

/// Executions that an input is worth.
const EFFORT: usize = 2000;

/// Takes away what is not needed for the harm: halves, then quarters, and so on to single bytes. A slow input is left as it is.
pub fn shrink(target: &Target, input: &[u8], harm: &Harm) -> Vec<u8> {
    let mut small = input.to_vec();
    if matches!(harm, Harm::Slow(_)) {
        return small;
    }
    let same = |input: &[u8]| {
        let again = execute(target, input).result;
        again.is_err_and(|h| h.cause() == harm.cause())
    };
    let mut left = EFFORT;
    let mut size = small.len() / 2;
    while size > 0 {
        let mut start = 0;
        while start < small.len() && left > 0 {
            left -= 1;
            let end = small.len().min(start + size);
            let shorter = [&small[..start], &small[end..]].concat();
            if same(&shorter) {
                small = shorter;
            } else {
                start = end;
            }
        }
        size /= 2;
    }
    small
}
