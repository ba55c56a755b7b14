//! What was measured, in words.

use crate::estimates::{BOUNDS, Estimates, Told};
use crate::manufactured::Convergence;
use crate::recommend::front;
use crate::study::{Question, Row, words};
use crate::training::Course;
use crate::transfer::{Errors, Transfer};
use std::fmt::Write;

/// Lengths of a scene.
#[derive(Debug, Clone)]
pub struct Units {
    /// Name of the unit.
    pub name: String,
    /// Diagonal of the body's bounding box.
    pub diagonal: f64,
}

/// Questions that vary one knob, in the order in which they are told.
pub const SINGLE: [Question; 6] = [
    Question::Discretisation,
    Question::Quadrature,
    Question::Points,
    Question::Solver,
    Question::Method,
    Question::Network,
];

/// The knobs by themselves, and the choices that nothing beats, as Markdown.
pub fn study_table(rows: &[Row], units: &Units) -> String {
    let mut text = String::new();
    let name = &units.name;
    let _ = writeln!(
        text,
        "| what is varied | choice | elements | error ({name}) | s per shape | setup s | steps |\n|---|---|---|---|---|---|---|"
    );
    for question in SINGLE {
        for row in rows.iter().filter(|r| r.question == question) {
            let _ = writeln!(
                text,
                "{}",
                line(words(question), &value(row, units), row, units)
            );
        }
    }
    let _ = writeln!(
        text,
        "\nNothing that was tried is both faster and more accurate than these:\n\n| | choice | elements | error ({name}) | s per shape | setup s | steps |\n|---|---|---|---|---|---|---|"
    );
    for row in front(rows) {
        let choice = format!(
            "{}, {:e}",
            row.choice.words(units.diagonal),
            row.choice.accuracy
        );
        let _ = writeln!(text, "{}", line("front", &choice, row, units));
    }
    text
}

fn line(first: &str, choice: &str, row: &Row, units: &Units) -> String {
    let failed = match row.failed {
        0 => String::new(),
        n => format!(" ({n} not converged)"),
    };
    format!(
        "| {first} | {choice} | {} | {:.3e}{failed} | {:.3} | {:.2} | {:.0} |",
        row.elements,
        row.error * units.diagonal,
        row.split.simulation(),
        row.setup,
        row.iterations
    )
}

/// The value of the knob that a row varies.
pub fn value(row: &Row, units: &Units) -> String {
    let choice = &row.choice;
    match row.question {
        Question::Matrix => choice.words(units.diagonal),
        Question::Discretisation => {
            format!("{:.4} {}", choice.element_size * units.diagonal, units.name)
        }
        Question::Quadrature => format!("{} samples", choice.samples),
        Question::Points => "one actuation per element".into(),
        Question::Solver => format!("{:.1e} {}", choice.accuracy * units.diagonal, units.name),
        Question::Method => serde_json::to_value(choice.method)
            .ok()
            .and_then(|v| v.as_str().map(str::to_string))
            .unwrap_or_default(),
        Question::Network => format!("width {} (from the targets)", choice.width.size()),
    }
}

/// Errors of the case with a known answer.
pub fn convergence_table(convergence: &Convergence) -> String {
    let mut text =
        "| elements along an edge | rms error (edges) | largest |\n|---|---|---|\n".to_string();
    for grid in &convergence.grids {
        let cells = 1.0 / grid.element_size;
        let _ = writeln!(
            text,
            "| {cells:.0} | {:.3e} | {:.3e} |",
            grid.rms_error, grid.max_error
        );
    }
    let _ = writeln!(text, "\nOrder {:.2}.", convergence.order);
    text
}

/// What each tightness of training costs and reaches.
pub fn courses_table(courses: &[Course], units: &Units) -> String {
    let name = &units.name;
    let mut text = format!(
        "| tightness | angle of the gradient (degrees) | seconds | loss, last pass | error after ({name}) | dropped |\n|---|---|---|---|---|---|\n"
    );
    for course in courses {
        let (seconds, loss) = course.passes.last().copied().unwrap_or_default();
        let _ = writeln!(
            text,
            "| {} | {:.3} | {seconds:.1} | {loss:.3e} | {:.3e} | {} |",
            course.tightness.name,
            course.angle,
            course.error * units.diagonal,
            course.dropped
        );
    }
    text
}

/// The two directions of the figure, and the grids between.
pub fn transfer_table(transfer: &Transfer, units: &Units) -> String {
    let name = &units.name;
    let mut text = format!(
        "| samples | to | how | mean ({name}) | 99 % ({name}) | normals (degrees) |\n|---|---|---|---|---|---|\n"
    );
    for direction in &transfer.directions {
        for way in &direction.ways {
            let Errors { mean, p99, normals } = way.errors;
            let _ = writeln!(
                text,
                "| {} | {} | {} | {:.3e} | {:.3e} | {normals:.2} |",
                direction.from,
                direction.to,
                way.name,
                mean * units.diagonal,
                p99 * units.diagonal
            );
        }
    }
    let _ = writeln!(
        text,
        "\n| samples, not trained on | knows the spacing ({name}) | network of the finest grid | its actuation interpolated | trained for it alone |\n|---|---|---|---|---|"
    );
    for test in &transfer.tests {
        let of = |errors: &Errors| format!("{:.3e}", errors.mean * units.diagonal);
        let _ = writeln!(
            text,
            "| {} | {} | {} | {} | {} |",
            test.samples,
            of(&test.conditioned),
            of(&test.evaluated),
            of(&test.interpolated),
            test.alone.as_ref().map_or("-".into(), of)
        );
    }
    let _ = writeln!(
        text,
        "\nThe network that knows the spacing has {:.2} times the mean error of those trained for a grid alone.",
        transfer.ratio_to_alone()
    );
    text
}

/// Estimated beside true errors.
pub fn estimates_table(estimates: &Estimates) -> String {
    let mut text =
        "| case | asked | estimated | true | ratio | not measured | steps | inverted samples |\n|---|---|---|---|---|---|---|---|\n"
            .to_string();
    for case in &estimates.cases {
        let told = &case.measured;
        let estimated = told.estimated.map_or("-".into(), |e| format!("{e:.1e}"));
        let ratio = |told: &Told| told.ratio().map_or("-".into(), |r| format!("{r:.2}"));
        let _ = writeln!(
            text,
            "| {} | {:.0e} | {estimated} | {:.1e} | {} | {} | {} | {} |",
            case.name,
            case.asked,
            told.true_error,
            ratio(told),
            ratio(&case.unmeasured),
            case.iterations,
            case.inverted_samples
        );
    }
    let _ = writeln!(
        text,
        "\nEstimated over true error lies within {} and {} in {:.1} % of the cases that have both; in {:.1} % where the error is not \
         measured at the end of a solve. Lengths are shares of the diagonal.",
        BOUNDS.0,
        BOUNDS.1,
        100.0 * estimates.share_within,
        100.0 * estimates.share_within_unmeasured
    );
    text
}
