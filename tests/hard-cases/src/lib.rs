//! A catalogue of numerically hard cases: each has a name, a story, a generator, and what must hold. `cargo xtask hard-cases` runs all
//! of them and writes `docs/hard-cases.md`.
//!
//! What must hold everywhere: no number that is not finite comes out, the energy never rises in a monotone method, the status tells the
//! truth, derivatives are the slopes that finite differences find where there are any, and the answer is right where it is known.

mod actuations;
mod adjoints;
mod bodies;
mod body;
mod case;
mod check;
mod effects;
mod long;
mod samples;
mod starts;
mod table;

pub use case::{Case, Effort, Finding, Section};
pub use table::{Run, markdown, summary};

/// All cases, in the order of the catalogue.
pub fn catalogue() -> Vec<Case> {
    [
        samples::cases(),
        starts::cases(),
        actuations::cases(),
        bodies::cases(),
        effects::cases(),
        adjoints::cases(),
        long::cases(),
    ]
    .into_iter()
    .flatten()
    .collect()
}
