//! Repeating and the median.

use crate::options::RepeatArgs;
use std::time::Instant;

/// Seconds that one call takes.
pub fn timed<T>(call: impl FnOnce() -> T) -> (f64, T) {
    let clock = Instant::now();
    let result = call();
    (clock.elapsed().as_secs_f64(), result)
}

/// The median of a list; the mean of the middle two where there are two.
///
/// # Panics
/// When the list is empty.
pub fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let middle = sorted.len() / 2;
    if sorted.len() % 2 == 1 {
        sorted[middle]
    } else {
        0.5 * (sorted[middle - 1] + sorted[middle])
    }
}

/// Whether a step that has taken `seconds` so far is to be done again.
pub fn again(seconds: &[f64], args: &RepeatArgs) -> bool {
    seconds.is_empty() || (seconds.len() < args.runs && seconds.iter().sum::<f64>() < args.budget)
}

#[cfg(test)]
mod tests {
    use super::median;

    #[test]
    fn medians() {
        assert_eq!(median(&[3.0]), 3.0);
        assert_eq!(median(&[4.0, 1.0, 3.0]), 3.0);
        assert_eq!(median(&[4.0, 1.0, 3.0, 2.0]), 2.5);
    }
}
