//! Counts of what held and what did not, over the draws of a class.

use crate::case::Finding;

/// What is known of one identity.
#[derive(Debug, Clone, Default)]
struct Entry {
    /// Worst error relative to its condition; NaN once one was.
    worst: f64,
    /// Errors above the bound.
    failures: usize,
    /// The draw and the error of the first of them.
    first: Option<(u64, f64)>,
}

/// Identities by their names, in the order in which they were met.
#[derive(Debug, Clone, Default)]
struct Entries(Vec<(&'static str, Entry)>);

impl Entries {
    fn of(&mut self, name: &'static str) -> &mut Entry {
        // Dozens of look-ups per draw: the address is enough where it is the same.
        let place = self.0.iter().position(|(n, _)| std::ptr::eq(*n, name));
        let place = place.or_else(|| self.0.iter().position(|(n, _)| *n == name));
        let place = place.unwrap_or_else(|| {
            self.0.push((name, Entry::default()));
            self.0.len() - 1
        });
        &mut self.0[place].1
    }

    fn merge(&mut self, other: &Self) {
        for (name, entry) in &other.0 {
            self.of(name).merge(entry);
        }
    }
}

/// The identities of a class of samples.
#[derive(Debug, Clone, Default)]
pub struct Tally {
    exact: Entries,
    slopes: Entries,
    /// Finite differences that were taken.
    differences: usize,
    pair_sum: Option<f64>,
    negative: bool,
}

/// The larger of two errors; one that is not a number is the worst.
fn worse(a: f64, b: f64) -> f64 {
    if a.is_nan() || a > b { a } else { b }
}

impl Entry {
    fn see(&mut self, draw: u64, error: f64, bound: f64) {
        self.worst = worse(self.worst, error);
        if error.is_nan() || error > bound {
            self.failures += 1;
            self.first.get_or_insert((draw, error));
        }
    }

    fn merge(&mut self, other: &Self) {
        self.worst = worse(self.worst, other.worst);
        self.failures += other.failures;
        self.first = self.first.or(other.first);
    }
}

impl Tally {
    /// An identity that holds up to rounding: `error`, relative to what rounding may do, is at most `bound`.
    pub fn check(&mut self, draw: u64, name: &'static str, error: f64, bound: f64) {
        self.exact.of(name).see(draw, error, bound);
    }

    /// Something that is so or not.
    pub fn require(&mut self, draw: u64, name: &'static str, holds: bool) {
        let error = if holds { 0.0 } else { f64::INFINITY };
        self.check(draw, name, error, 0.0);
    }

    /// A derivative against the slope of finite differences.
    pub fn slope(&mut self, draw: u64, name: &'static str, error: f64, bound: f64) {
        self.differences += 1;
        self.slopes.of(name).see(draw, error, bound);
    }

    /// A linearisation and its smallest pair sum.
    pub fn see_pair_sum(&mut self, sum: f64) {
        self.pair_sum = Some(self.pair_sum.map_or(sum, |s| s.min(sum)));
    }

    /// The smallest eigenvalue of a core.
    pub fn see_curvature(&mut self, smallest: f64) {
        self.negative |= smallest < 0.0;
    }

    /// Takes in what was found in later draws of the same class.
    pub fn merge(&mut self, other: &Self) {
        self.exact.merge(&other.exact);
        self.slopes.merge(&other.slopes);
        self.differences += other.differences;
        if let Some(sum) = other.pair_sum {
            self.see_pair_sum(sum);
        }
        self.negative |= other.negative;
    }

    /// The finding of a class of which so many were drawn.
    pub fn finding(&self, draws: usize) -> Finding {
        let mut finding = Finding {
            status: format!("{draws} draws"),
            smallest_pair_sum: self.pair_sum,
            negative_curvature: self.negative,
            ..Finding::default()
        };
        for (name, entry) in self.exact.0.iter().chain(&self.slopes.0) {
            if let Some((draw, error)) = entry.first {
                finding.broken.push(format!(
                    "{name}: {} times, first at draw {draw} with {error:.1e}, worst {:.1e}",
                    entry.failures, entry.worst
                ));
            }
        }
        for (_, entry) in &self.exact.0 {
            finding.residual = worse(finding.residual, entry.worst);
        }
        if let Some(worst) = self.slopes.0.iter().map(|(_, e)| e.worst).reduce(worse) {
            finding.notes.push(format!(
                "{} finite differences, the worst {worst:.1e} off",
                self.differences
            ));
        } else {
            finding.notes.push("no finite differences exist".into());
        }
        finding
    }

    /// The worst error of every identity, one a line.
    #[cfg(test)]
    pub fn table(&self) -> String {
        use std::fmt::Write;
        let mut text = String::new();
        for (name, entry) in self.exact.0.iter().chain(&self.slopes.0) {
            let _ = writeln!(text, "  {name:<45} {:.1e}", entry.worst);
        }
        text
    }
}
