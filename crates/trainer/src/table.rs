//! The table of errors that training and evaluation end with.

use crate::checkpoint::StageError;
use crate::evaluate::ShapeResult;
use crate::shapes::ShapeSet;
use std::borrow::Borrow;
use surface_mesh::printable;

/// Mean of some numbers; 0 of none.
pub fn mean_of(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0), |(s, n), v| (s + v, n + 1));
    if count == 0 { 0.0 } else { sum / count as f64 }
}

/// One line: how far the nodes are from their places, as the solver estimates.
pub fn accuracy_reached<R: Borrow<ShapeResult>>(results: &[R], unit: &str) -> String {
    let all = results.iter().map(Borrow::borrow);
    let estimated = all.filter_map(|r| Some((r.estimated_error?, r.name.as_str())));
    let worst = estimated.max_by(|a, b| a.0.total_cmp(&b.0));
    worst.map_or("solved exactly: nothing moves".into(), |(error, name)| {
        format!(
            "solved to {error:.1e} {unit} or better at every node, as estimated (worst in {})",
            printable(name)
        )
    })
}

/// The table that training and evaluation end with.
pub fn table<R: Borrow<ShapeResult>>(
    results: &[R],
    stage1: &[StageError],
    diagonal: f64,
    unit: &str,
) -> String {
    use std::fmt::Write;
    let results: Vec<&ShapeResult> = results.iter().map(Borrow::borrow).collect();
    let percent = 100.0 / diagonal;
    let width = results
        .iter()
        .map(|r| printable(&r.name).chars().count())
        .max()
        .unwrap_or(5)
        .max(5);
    let after1 = |name: &str| stage1.iter().find(|e| e.name == name);
    let mut out = String::new();
    let first = if stage1.is_empty() {
        ""
    } else {
        "  stage 1 mean %"
    };
    let _ = writeln!(
        out,
        "{:width$}  {:8}{first}  mean {unit:<6}  mean %  max {unit:<6}   max %     energy  iterations  seconds  inverted",
        "shape", "set",
    );
    for r in &results {
        let before = match (stage1.is_empty(), after1(&r.name)) {
            (true, _) => String::new(),
            (false, Some(e)) => format!("  {:14.3}", e.mean * percent),
            (false, None) => format!("  {:>14}", "-"),
        };
        let unfinished = if r.status == pd_solver::Status::Converged {
            ""
        } else {
            "  not converged"
        };
        let _ = writeln!(
            out,
            "{:width$}  {:8}{before}  {:11.5}  {:6.3}  {:10.5}  {:6.3}  {:9.3e}  {:10}  {:7.2}  {:8}{unfinished}",
            printable(&r.name),
            r.set.label(),
            r.mean_error,
            r.mean_error_percent,
            r.max_error,
            r.max_error_percent,
            r.energy,
            r.iterations,
            r.seconds,
            r.inverted_elements,
        );
    }
    for set in [ShapeSet::Train, ShapeSet::HeldOut, ShapeSet::Blend] {
        let of_set = || results.iter().filter(|r| r.set == set);
        if of_set().count() == 0 {
            continue;
        }
        let mean = mean_of(of_set().map(|r| r.mean_error_percent));
        let _ = write!(
            out,
            "{:>width$}  {:8} mean error {mean:.3} % of the diagonal",
            "",
            set.label()
        );
        if set == ShapeSet::Train && !stage1.is_empty() {
            let before = percent * mean_of(stage1.iter().map(|e| e.mean));
            let _ = write!(
                out,
                " ({before:.3} % after stage 1, {:.1} times as much)",
                before / mean
            );
        }
        out.push('\n');
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::result;
    use pd_solver::Status;

    #[test]
    fn the_table_sums_up_each_set_and_compares_the_stages() {
        let mut unfinished = result("both", ShapeSet::HeldOut);
        unfinished.status = Status::IterationLimit;
        let results = [result("long", ShapeSet::Train), unfinished];
        let stage1 = StageError {
            name: "long".into(),
            mean: 0.05,
            max: 0.1,
        };
        let text = table(&results, &[stage1], 2.0, "cm");
        let lines: Vec<&str> = text.lines().collect();
        assert!(lines[0].contains("stage 1 mean %") && lines[0].contains("mean cm"));
        assert!(lines[1].starts_with("long") && lines[1].contains(" 2.500 "));
        assert!(!lines[1].contains("not converged"));
        assert!(lines[2].starts_with("both") && lines[2].ends_with("not converged"));
        assert!(lines[3].ends_with(
            "mean error 1.000 % of the diagonal (2.500 % after stage 1, 2.5 times as much)"
        ));
        assert!(lines[4].ends_with("held out mean error 1.000 % of the diagonal"));
        assert_eq!(lines.len(), 5);
        assert!(!table(&results, &[], 2.0, "cm").contains("stage 1"));
    }

    #[test]
    fn the_mean_of_nothing_is_zero() {
        assert_eq!(mean_of([].into_iter()), 0.0);
        assert_eq!(mean_of([1.0, 3.0].into_iter()), 2.0);
    }
}
