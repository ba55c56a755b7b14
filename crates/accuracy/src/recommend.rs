//! Which settings a budget or a target calls for.

use crate::choice::Choice;
use crate::error::{AccuracyError, Result};
use crate::study::{Question, Row};
use serde::{Deserialize, Serialize};

/// What the user can say.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Wish {
    /// At most so many seconds for a shape.
    Budget(f64),
    /// At most this far from the reference, in diagonals.
    Target(f64),
}

/// A choice that is recommended, and what was measured of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Recommendation {
    /// The settings.
    pub choice: Choice,
    /// Distance from the reference, in diagonals.
    pub error: f64,
    /// Seconds per shape.
    pub seconds: f64,
}

/// A slower choice that takes away less than the rest of this share of the error is not worth its time.
const WORTH: f64 = 0.97;

/// Rows of the matrix that no other beats in both error and time, the fastest first.
pub fn front(rows: &[Row]) -> Vec<&Row> {
    let usable = |row: &&Row| row.question == Question::Matrix && row.failed == 0;
    let mut all: Vec<&Row> = rows.iter().filter(usable).collect();
    all.sort_by(|a, b| a.split.simulation().total_cmp(&b.split.simulation()));
    let mut best = f64::INFINITY;
    all.retain(|row| {
        let is_better = row.error < WORTH * best;
        if is_better {
            best = row.error;
        }
        is_better
    });
    all
}

/// The most accurate choice within a budget, or the fastest within a target.
///
/// # Errors
/// When there is none.
pub fn recommend(rows: &[Row], wish: Wish, diagonal: f64) -> Result<Recommendation> {
    let front = front(rows);
    let chosen = match wish {
        Wish::Budget(budget) => { front.iter().rev() }
            .find(|row| row.split.simulation() <= budget)
            .ok_or_else(|| AccuracyError::Budget {
                budget,
                fastest: front.first().map_or(f64::NAN, |r| r.split.simulation()),
            })?,
        Wish::Target(target) => { front.iter() }
            .find(|row| row.error <= target)
            .ok_or_else(|| AccuracyError::Target {
                target: target * diagonal,
                nearest: front.last().map_or(f64::NAN, |r| r.error * diagonal),
            })?,
    };
    Ok(Recommendation {
        choice: chosen.choice.clone(),
        error: chosen.error,
        seconds: chosen.split.simulation(),
    })
}

/// The settings as a scene has them, to paste.
pub fn snippet(choice: &Choice, diagonal: f64) -> String {
    let actuation = serde_json::to_string(&choice.actuation).expect("plain data serialises");
    let method = serde_json::to_string(&choice.method).expect("plain data serialises");
    format!(
        "[mesh]\nelement_size = {:.4}\nsamples = {}\nactuation = {actuation}\n\n[evaluation]\naccuracy = {:e}\nmethod = {method}\n",
        choice.element_size * diagonal,
        choice.samples,
        choice.accuracy
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::choice::Split;
    use actuation_net::Width;
    use pd_solver::Method;
    use trainer::scene::ActuationPer;

    fn row(seconds: f64, error: f64, failed: usize) -> Row {
        Row {
            question: Question::Matrix,
            choice: Choice {
                element_size: error,
                samples: 8,
                actuation: ActuationPer::Sample,
                width: Width::W64,
                method: Method::Automatic,
                accuracy: 1e-4,
            },
            elements: 1,
            error,
            estimated: 0.0,
            setup: 0.0,
            split: Split {
                network: 0.5 * seconds,
                global: 0.5 * seconds,
                adjoint: 100.0,
                ..Split::default()
            },
            iterations: 1.0,
            failed,
        }
    }

    #[test]
    fn the_front_has_what_nothing_beats_and_wishes_choose_from_it() {
        let rows = [
            row(4.0, 1e-3, 0),
            row(1.0, 1e-2, 0),
            row(2.0, 2e-2, 0),
            row(0.5, 1e-4, 1),
            row(3.0, 2e-3, 0),
        ];
        let errors: Vec<f64> = front(&rows).iter().map(|r| r.error).collect();
        assert_eq!(errors, [1e-2, 2e-3, 1e-3]);
        let of = |wish| recommend(&rows, wish, 2.0).map(|r| r.error);
        assert_eq!(of(Wish::Budget(3.5)).unwrap(), 2e-3);
        assert_eq!(of(Wish::Budget(100.0)).unwrap(), 1e-3);
        assert_eq!(of(Wish::Target(5e-3)).unwrap(), 2e-3);
        let message = of(Wish::Target(1e-4)).unwrap_err().to_string();
        assert!(
            message.contains("2.000e-4") && message.contains("2.000e-3"),
            "{message}"
        );
        let message = of(Wish::Budget(0.1)).unwrap_err().to_string();
        assert!(message.contains("1.000e0"), "{message}");
    }

    #[test]
    fn the_snippet_is_a_part_of_a_scene() {
        let text = snippet(&row(1.0, 0.02, 0).choice, 2.0);
        let table: toml::Table = toml::from_str(&text).unwrap();
        assert_eq!(table["mesh"]["element_size"].as_float(), Some(0.04));
        assert_eq!(table["mesh"]["actuation"].as_str(), Some("sample"));
        assert_eq!(table["evaluation"]["accuracy"].as_float(), Some(1e-4));
        assert_eq!(table["evaluation"]["method"].as_str(), Some("automatic"));
    }
}
