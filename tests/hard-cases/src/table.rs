//! What was found, in words.

use crate::body::{METHODS, name};
use crate::case::{Finding, Section};
use std::fmt::Write;

/// A case that was run.
pub struct Run {
    /// Its chapter.
    pub section: Section,
    /// Its name.
    pub name: String,
    /// Its story.
    pub story: &'static str,
    /// What was found.
    pub finding: Finding,
    /// Seconds that it took.
    pub seconds: f64,
}

impl Run {
    /// One line for the terminal.
    pub fn line(&self) -> String {
        let f = &self.finding;
        let mark = if f.broken.is_empty() { "ok" } else { "BROKEN" };
        format!(
            "{mark:>6} {:<40} {:<28} {:>6} it  {:>8.1e}  {:>8}  {:>4}  {:.1} s",
            self.name,
            f.status,
            f.iterations,
            f.residual,
            pair_sum(f),
            curvature(f),
            self.seconds
        )
    }
}

fn pair_sum(finding: &Finding) -> String {
    let sum = finding.smallest_pair_sum;
    sum.map_or("-".into(), |s| format!("{s:.1e}"))
}

fn curvature(finding: &Finding) -> &'static str {
    if finding.negative_curvature {
        "yes"
    } else {
        "no"
    }
}

/// How many cases hold, and what is broken.
pub fn summary(runs: &[Run]) -> String {
    let broken: Vec<&Run> = runs
        .iter()
        .filter(|r| !r.finding.broken.is_empty())
        .collect();
    let mut text = format!("{} cases, {} broken\n", runs.len(), broken.len());
    for run in broken {
        for what in &run.finding.broken {
            let _ = writeln!(text, "  {}: {what}", run.name);
        }
    }
    text
}

/// The catalogue as a page.
pub fn markdown(runs: &[Run]) -> String {
    let mut text = String::from(
        "# Hard cases\n\nEvery case of the catalogue (`tests/hard-cases`), as `cargo xtask hard-cases` found it. In all of them no number came out that is not finite, the \
         energy never rose, and the status told the truth; what else must hold is in the story.\n",
    );
    for section in Section::ALL {
        let of: Vec<&Run> = runs.iter().filter(|r| r.section == section).collect();
        if of.is_empty() {
            continue;
        }
        let _ = writeln!(text, "\n## {}\n", section.title());
        text.push_str(
            "| case | story | holds | status | iterations | worst residual | smallest s_i + s_j | negative curvature | seconds |\n\
             |---|---|---|---|---|---|---|---|---|\n",
        );
        for run in &of {
            let f = &run.finding;
            let holds = if f.broken.is_empty() {
                "yes".to_string()
            } else {
                format!("NO: {}", f.broken.join("; "))
            };
            let _ = writeln!(
                text,
                "| {} | {} | {holds} | {} | {} | {:.1e} | {} | {} | {:.1} |",
                run.name,
                run.story,
                f.status,
                f.iterations,
                f.residual,
                pair_sum(f),
                curvature(f),
                run.seconds
            );
        }
        for run in &of {
            for note in &run.finding.notes {
                let _ = writeln!(text, "\n- {}: {note}", run.name);
            }
        }
        text.push_str(&recovery(&of));
    }
    text
}

/// The share of starts that each method recovers from, where the section has any.
fn recovery(runs: &[&Run]) -> String {
    let mut text = String::new();
    for method in METHODS {
        let all = runs.iter().flat_map(|r| &r.finding.recovered);
        let (found, tried) = all
            .filter(|(m, ..)| *m == method)
            .fold((0, 0), |(f, t), (_, found, tried)| (f + found, t + tried));
        if tried > 0 {
            let _ = writeln!(text, "| {} | {found} of {tried} |", name(method));
        }
    }
    if text.is_empty() {
        text
    } else {
        format!(
            "\nStarts from which each method finds the answer again:\n\n| method | recovered |\n|---|---|\n{text}"
        )
    }
}
