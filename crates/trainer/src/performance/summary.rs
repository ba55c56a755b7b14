//! What a performance amounts to.

use super::{Performance, PerformedFrame, Source, Start};
use crate::table::mean_of;
use pd_solver::Status;

/// What a performance amounts to, in a few lines.
pub fn summary(performance: &Performance) -> String {
    let frames = &performance.frames;
    let results = || frames.iter().map(|f| &f.result);
    let mean = mean_of(results().map(|r| r.mean_error_percent));
    let target = match performance.source {
        Source::Curves(_) => "the linear blend of each frame's shapes",
        Source::Path(_) => {
            "the linear blend of the two shapes around each frame (codes between have no target)"
        }
    };
    let seconds: f64 = results().map(|r| r.seconds).sum();
    let iterations: usize = results().map(|r| r.iterations).sum();
    let mut lines = vec![format!(
        "{} frames, {:.2} s at {} frames a second; simulated in {seconds:.2} s with {iterations} iterations",
        frames.len(),
        frames.len() as f64 / performance.fps,
        performance.fps,
    )];
    let far = |f: &&PerformedFrame| f.result.mean_error_percent;
    let worst = frames.iter().max_by(|a, b| far(a).total_cmp(&far(b)));
    if let Some(worst) = worst {
        lines.push(format!(
            "mean error {mean:.3} % of the diagonal against {target}; worst {:.3} % in frame {}",
            far(&worst),
            worst.frame,
        ));
    }
    let numbers = |wanted: &dyn Fn(&PerformedFrame) -> bool| -> Vec<usize> {
        let found = frames.iter().filter(|f| wanted(f));
        found.map(|f| f.frame).collect()
    };
    let inverted = numbers(&|f| f.result.inverted_elements > 0);
    if inverted.is_empty() {
        lines.push("no frame has inverted elements".into());
    } else {
        let most = results().map(|r| r.inverted_elements).max().unwrap_or(0);
        let which = listed(&inverted);
        lines.push(format!("inverted elements in {which}, {most} at most"));
    }
    let again = numbers(&|f| f.start == Start::RestAfterPrevious);
    if !again.is_empty() {
        let which = listed(&again);
        lines.push(format!(
            "started again from rest, as the frame before was no start that converged: {which}"
        ));
    }
    let open = numbers(&|f| f.result.status != Status::Converged);
    if !open.is_empty() {
        lines.push(format!("NOT CONVERGED, even from rest: {}", listed(&open)));
    }
    lines.join("\n")
}

/// `frames 1, 2, 3 and 9 more`.
fn listed(numbers: &[usize]) -> String {
    const SHOWN: usize = 8;
    let shown: Vec<String> = numbers.iter().take(SHOWN).map(usize::to_string).collect();
    let what = if numbers.len() == 1 {
        "frame"
    } else {
        "frames"
    };
    let more = match numbers.len().saturating_sub(SHOWN) {
        0 => String::new(),
        left => format!(" and {left} more"),
    };
    format!("{what} {}{more}", shown.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;
    use crate::shapes::ShapeSet;

    #[test]
    fn the_summary_says_what_went_wrong() {
        let frame = |i: usize| PerformedFrame {
            frame: i,
            time: (i - 1) as f64 / 24.0,
            start: Start::Previous,
            result: fixture::result("long", ShapeSet::Blend),
        };
        let mut performance = Performance {
            frames: (1..=12).map(frame).collect(),
            source: Source::Curves("f.csv".into()),
            fps: 24.0,
            diagonal: 2.0,
            unit: "cm".into(),
            folder: "performance".into(),
        };
        let text = summary(&performance);
        assert!(
            text.starts_with("12 frames, 0.50 s at 24 frames a second"),
            "{text}"
        );
        assert!(text.contains("no frame has inverted elements"), "{text}");
        assert!(
            !text.contains("started again") && !text.contains("NOT CONVERGED"),
            "{text}"
        );
        for frame in &mut performance.frames {
            frame.result.inverted_elements = frame.frame;
        }
        performance.frames[2].start = Start::RestAfterPrevious;
        performance.frames[2].result.status = Status::Stalled;
        performance.frames[2].result.mean_error_percent = 3.0;
        let text = summary(&performance);
        for part in [
            "frames 1, 2, 3, 4, 5, 6, 7, 8 and 4 more, 12 at most",
            "no start that converged: frame 3",
            "NOT CONVERGED, even from rest: frame 3",
            "worst 3.000 % in frame 3",
        ] {
            assert!(text.contains(part), "{text}");
        }
    }
}
