//! Plain tables for the terminal.

use crate::measure::Measurement;
use serde::Serialize;
use std::fmt::Write as _;
use std::io::Write as _;

/// Prints rows with aligned columns: the first one to the left, the others to the right.
pub fn print(rows: &[Vec<String>]) {
    say(&aligned(rows));
}

/// Prints a text. A reader that has gone (`| head`) is no reason to fail: the numbers are in the file by then.
pub fn say(text: &str) {
    let mut out = std::io::stdout().lock();
    out.write_all(text.as_bytes()).ok();
    out.flush().ok();
}

fn aligned(rows: &[Vec<String>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |column: usize| {
        let cells = rows.iter().filter_map(|row| row.get(column));
        cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let mut text = String::new();
    for row in rows {
        let mut line = String::new();
        for (column, (cell, width)) in row.iter().zip(&widths).enumerate() {
            // Writing to a string does not fail.
            let _ = match column {
                0 => write!(line, "{cell:<width$}"),
                _ => write!(line, "  {cell:>width$}"),
            };
        }
        text.push_str(line.trim_end());
        text.push('\n');
    }
    text
}

/// A row of texts.
pub fn row<const N: usize>(cells: [&str; N]) -> Vec<String> {
    cells.map(str::to_string).to_vec()
}

/// Seconds with three digits that count.
pub fn seconds(value: f64) -> String {
    match value {
        _ if value >= 100.0 => format!("{value:.0}"),
        _ if value >= 10.0 => format!("{value:.1}"),
        _ if value >= 1.0 => format!("{value:.2}"),
        _ if value >= 0.1 => format!("{value:.3}"),
        _ if value >= 0.01 => format!("{value:.4}"),
        _ => format!("{value:.3e}"),
    }
}

/// A number that may be absent.
pub fn optional(value: Option<f64>, format: impl Fn(f64) -> String) -> String {
    value.map_or_else(|| "-".into(), format)
}

/// The name that a plain enum has in files.
pub fn name(value: &impl Serialize) -> String {
    let value = serde_json::to_value(value).unwrap_or_default();
    value.as_str().unwrap_or("-").to_string()
}

/// Prints one measurement, a quantity per line.
pub fn print_measurement(m: &Measurement) {
    let short = |x: f64| format!("{x:.2e}");
    let point = |p: &[f64; 3]| format!("{:.6} {:.6} {:.6}", p[0], p[1], p[2]);
    let cells = m.cells.map(|[x, y, z]| format!("{x} x {y} x {z}"));
    let rows = [
        ("cells", cells.unwrap_or_else(|| "-".into())),
        ("elements", m.elements.to_string()),
        ("method", name(&m.method)),
        ("setup_s", seconds(m.setup_s)),
        ("forward_s", seconds(m.forward_s)),
        ("first_forward_s", seconds(m.first_forward_s)),
        ("backward_s", seconds(m.backward_s)),
        ("iterations", m.iterations.to_string()),
        ("adjoint_iterations", m.adjoint_iterations.to_string()),
        ("energy", format!("{:.9}", m.energy)),
        ("residual", optional(m.residual, short)),
        ("estimated_error", optional(m.estimated_error, short)),
        ("true_error", optional(m.true_error, short)),
        ("tip", point(&m.tip)),
        ("mean", point(&m.mean)),
        ("peak_mb", optional(m.peak_mb, |mb| format!("{mb:.0}"))),
        ("threads", m.threads.to_string()),
        ("load", optional(m.load, |load| format!("{load:.2}"))),
        ("status", name(&m.status)),
        ("adjoint_status", name(&m.adjoint_status)),
        ("adjoint_residual", short(m.adjoint_residual)),
        (
            "repeatable",
            m.repeatable.map_or("-".into(), |r| r.to_string()),
        ),
    ];
    let rows: Vec<_> = rows.map(|(key, value)| vec![key.into(), value]).into();
    print(&rows);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_aligned() {
        let rows = [row(["a", "1", "22"]), row(["long", "333"])];
        assert_eq!(aligned(&rows), "a       1  22\nlong  333\n");
    }

    #[test]
    fn three_digits_count() {
        assert_eq!(
            [123.4, 12.34, 1.234, 0.1234, 0.01234, 0.001234].map(seconds),
            ["123", "12.3", "1.23", "0.123", "0.0123", "1.234e-3"]
        );
    }
}
