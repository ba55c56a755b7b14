//! The pictures of a run: comparison sheets and the course of the loss.

use crate::body::Body;
use crate::error::{Result, file_error};
use crate::evaluate::ShapeResult;
use crate::files::remove_beyond;
use crate::loss::distances;
use crate::run::Run;
use crate::scene::Scene;
use crate::shapes::ShapeSet;
use nalgebra::Vector3;
use report::{ComparisonSheet, LinePlot, Row, Series};
use std::path::Path;

/// Writes the sheets of an evaluation, `sheet-1.png` and so on: target, simulated, error in colour. Sheets of an earlier
/// evaluation with more pages are removed.
///
/// # Errors
/// When they cannot be drawn or written.
pub fn write(folder: &Path, scene: &Scene, body: &Body, results: &[ShapeResult]) -> Result<()> {
    let rows = results.iter().map(|result| Compared {
        name: result.name.clone(),
        target: &result.target,
        target_triangles: None,
        simulated: &result.surface,
        errors: distances(&result.surface, &result.target).2,
        note: note(result),
    });
    let title = format!("{}: target and simulation", scene.name);
    write_pages(
        folder,
        "sheet",
        title,
        scene,
        body,
        &rows.collect::<Vec<_>>(),
    )
}

/// A simulated surface beside what it should be.
pub(crate) struct Compared<'a> {
    /// What the row is called.
    pub name: String,
    /// The target's vertices.
    pub target: &'a [Vector3<f64>],
    /// Triangles of a target that is another mesh than the body's surface.
    pub target_triangles: Option<&'a [[u32; 3]]>,
    /// The simulated vertices of the body's surface.
    pub simulated: &'a [Vector3<f64>],
    /// Error of each of them, scene unit.
    pub errors: Vec<f64>,
    /// Anything else to be said.
    pub note: String,
}

/// Writes pages `PREFIX-1.png` and so on; pages of that prefix beyond the last are removed.
///
/// # Errors
/// When they cannot be drawn or written.
pub(crate) fn write_pages(
    folder: &Path,
    prefix: &str,
    title: String,
    scene: &Scene,
    body: &Body,
    rows: &[Compared],
) -> Result<()> {
    let (direction, up) = view(body);
    let mut sheet = ComparisonSheet::new(title, &scene.unit)
        .view(direction, up)
        .rows_per_page(6);
    for row in rows {
        sheet = sheet.row(Row {
            name: &row.name,
            triangles: body.surface.triangles(),
            target_triangles: row.target_triangles,
            target: row.target,
            simulated: row.simulated,
            errors: &row.errors,
            note: &row.note,
        });
    }
    let pages = sheet.render()?;
    let name = |number: usize| format!("{prefix}-{number}.png");
    for (i, page) in pages.iter().enumerate() {
        page.write_png(folder.join(name(i + 1)))?;
    }
    remove_beyond(folder, prefix, pages.len(), name)
}

fn note(result: &ShapeResult) -> String {
    let set = match result.set {
        ShapeSet::Train => "trained",
        ShapeSet::HeldOut => "held out",
        ShapeSet::Blend => "blend",
    };
    format!("{set}, {:.2} % mean", result.mean_error_percent)
}

/// Flat bodies are seen from above at a slant, all others from the front.
pub fn view(body: &Body) -> (Vector3<f64>, Vector3<f64>) {
    let (min, max) = body.surface.bounding_box();
    let size = max - min;
    if size.y < 0.5 * size.x.min(size.z) {
        (Vector3::new(-0.25, -0.8, -0.75), Vector3::y())
    } else {
        (Vector3::new(-0.25, -0.15, -1.0), Vector3::y())
    }
}

/// Draws the loss of both stages from the metrics of a run: `loss-1.png` and `loss-2.png`, with the same as SVG.
///
/// # Errors
/// When the metrics cannot be read or a picture cannot be written.
pub fn write_losses(run: &Run) -> Result<()> {
    let path = run.metrics_path();
    let text = std::fs::read_to_string(&path).map_err(file_error("read", &path))?;
    for (stage, title, y_label) in [
        (
            1,
            "Stage 1: actuation of pulled shapes",
            "mean squared error of A",
        ),
        (
            2,
            "Stage 2: through the simulator",
            "mean error, % of diagonal",
        ),
    ] {
        let points = loss_points(&text, stage);
        if points.is_empty() {
            continue;
        }
        let plot = LinePlot {
            title: title.into(),
            x_label: "epoch".into(),
            y_label: y_label.into(),
            series: vec![Series::new("training shapes", points)],
            log_x: false,
            log_y: true,
            markers: false,
            labels: Vec::new(),
        };
        plot.write_png(run.folder().join(format!("loss-{stage}.png")))?;
        plot.write_svg(run.folder().join(format!("loss-{stage}.svg")))?;
    }
    Ok(())
}

/// What of a line of metrics goes into the plots. Whatever else stands there is passed over, and takes no memory.
#[derive(serde::Deserialize)]
struct MetricsLine {
    stage: u64,
    epoch: f64,
    loss: Option<f64>,
    mean_error_percent: Option<f64>,
}

/// Epochs of a stage (1 or 2) and what they are measured by: the loss of stage 1, the mean error of stage 2 in percent, where that is above zero.
/// Lines that are no JSON are passed over: a process that was killed may have left half of one.
pub fn loss_points(metrics: &str, stage: u64) -> Vec<(f64, f64)> {
    let lines = metrics
        .lines()
        .filter_map(|line| serde_json::from_str::<MetricsLine>(line).ok());
    let of_stage = lines.filter(|line| line.stage == stage);
    let points = of_stage.filter_map(|line| {
        let value = match stage {
            1 => line.loss,
            _ => line.mean_error_percent,
        };
        Some((line.epoch, value?))
    });
    points.filter(|p| p.1 > 0.0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;

    #[test]
    fn notes_say_what_a_shape_is_for_and_how_far_off_it_is() {
        let of = |set| note(&fixture::result("long", set));
        assert_eq!(of(ShapeSet::Train), "trained, 1.00 % mean");
        assert_eq!(of(ShapeSet::HeldOut), "held out, 1.00 % mean");
        assert_eq!(of(ShapeSet::Blend), "blend, 1.00 % mean");
    }

    #[test]
    fn pages_of_an_earlier_evaluation_go() {
        let folder = tempfile::tempdir().unwrap();
        let scene = fixture::scene("");
        let body = fixture::body(&scene);
        // One is gone already: a process was killed while it removed them. The last two are nobody's page.
        let stale = ["2", "4", "12", "02", "x"].map(|n| format!("sheet-{n}.png"));
        for name in &stale {
            std::fs::write(folder.path().join(name), "old").unwrap();
        }
        let rest = body.surface.vertices().to_vec();
        let mut result = fixture::result("long", ShapeSet::Train);
        result.surface.clone_from(&rest);
        result.target = rest;
        write(folder.path(), &scene, &body, &[result]).unwrap();
        let files = std::fs::read_dir(folder.path()).unwrap();
        let mut names: Vec<_> = files.map(|f| f.unwrap().file_name()).collect();
        names.sort();
        assert_eq!(names, ["sheet-02.png", "sheet-1.png", "sheet-x.png"]);
    }

    #[test]
    fn a_stage_without_points_has_no_plot() {
        let folder = tempfile::tempdir().unwrap();
        let run = Run::create(
            folder.path(),
            fixture::SCENE,
            &fixture::inputs(),
            &crate::rig::Rig::default(),
            None,
        )
        .unwrap();
        let text = "{\"stage\":1,\"epoch\":1,\"loss\":0.5}\n{\"stage\":1,\"epoch\":2,\"loss\":0.1}\n\
                    {\"stage\":2,\"step\":0,\"dropped\":\"long: the equilibrium is Stalled\"}\n{\"sta";
        std::fs::write(run.metrics_path(), text).unwrap();
        write_losses(&run).unwrap();
        assert!(folder.path().join("loss-1.png").exists());
        assert!(folder.path().join("loss-1.svg").exists());
        assert!(!folder.path().join("loss-2.png").exists());
    }
}
