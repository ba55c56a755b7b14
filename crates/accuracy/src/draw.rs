//! What was measured, in plots.

use crate::error::Result;
use crate::estimates::{BOUNDS, Estimates, Told};
use crate::manufactured::Convergence;
use crate::recommend::front;
use crate::study::{Question, Row, answers};
use crate::subject::Subject;
use crate::table::Units;
use crate::training::Course;
use crate::transfer::{Errors, TestGrid, Transfer};
use report::{
    Camera, ColourScale, Colours, ContactSheet, LinePlot, Panel, PlotLabel, Series, SeriesStyle,
};
use std::path::Path;
use trainer::loss::distances;

/// Error against seconds: every choice a dot, one colour for each number of samples, and a line through those that nothing beats.
pub fn pareto(rows: &[Row], units: &Units) -> LinePlot {
    let place = |row: &Row| (row.split.simulation(), row.error * units.diagonal);
    let front = front(rows);
    let line = front.iter().map(|row| place(row)).collect();
    let mut series = vec![Series::new("nothing is better", line)];
    let kinds = [(1, true), (8, true), (8, false), (27, false)];
    for (samples, is_shared) in kinds {
        let is_it = |row: &&Row| {
            let shared = row.choice.actuation == trainer::scene::ActuationPer::Element;
            (row.choice.samples, shared) == (samples, is_shared)
        };
        let matrix = answers(rows, Question::Matrix);
        let points: Vec<_> = matrix.filter(is_it).map(place).collect();
        if points.is_empty() {
            continue;
        }
        let name = match (samples, is_shared) {
            (1, _) => "1 sample".to_string(),
            (n, true) => format!("{n} samples, 1 point"),
            (n, false) => format!("{n} samples"),
        };
        series.push(Series::new(name, points).with_style(SeriesStyle::Dots));
    }
    // Each grid is named once, at its most accurate solve.
    let words = |row: &Row| row.choice.words(units.diagonal);
    let lasts = front.iter().enumerate().filter(|&(i, row)| {
        let next = front.get(i + 1);
        next.is_none_or(|next| words(next) != words(row))
    });
    let labels = lasts.map(|(_, row)| PlotLabel {
        text: words(row),
        at: place(row),
    });
    LinePlot {
        title: "What accuracy costs".into(),
        x_label: "seconds per shape".into(),
        y_label: format!("mean distance from the reference ({})", units.name),
        series,
        log_x: true,
        log_y: true,
        labels: labels.collect(),
        ..LinePlot::default()
    }
}

/// Measurements over logarithmic axes.
fn measured() -> LinePlot {
    LinePlot {
        log_x: true,
        log_y: true,
        markers: true,
        ..LinePlot::default()
    }
}

/// Where the time goes on finer and finer grids.
pub fn split(rows: &[Row]) -> LinePlot {
    let sized: Vec<&Row> = answers(rows, Question::Discretisation).collect();
    type Part = fn(&Row) -> f64;
    let parts: [(&str, Part); 6] = [
        ("setup, once", |r| r.setup),
        ("network", |r| r.split.network),
        ("local", |r| r.split.local),
        ("global", |r| r.split.global),
        ("adjoint", |r| r.split.adjoint),
        ("surface", |r| r.split.surface),
    ];
    let series = parts.map(|(name, part)| {
        let points = sized.iter().map(|row| (row.elements as f64, part(row)));
        Series::new(name, points.filter(|p| p.1 > 0.0).collect())
    });
    let series = series.into_iter().filter(|s| !s.points.is_empty());
    LinePlot {
        title: "Where the time goes (27 samples, solved tightly)".into(),
        x_label: "elements".into(),
        y_label: "seconds per shape".into(),
        series: series.collect(),
        ..measured()
    }
}

/// Error against element size, of the body and of the case with a known answer, in diagonals and edges.
pub fn discretisation(rows: &[Row], convergence: &Convergence, order: f64) -> LinePlot {
    let sized = answers(rows, Question::Discretisation);
    let body = sized.map(|r| (r.choice.element_size, r.error)).collect();
    let known = convergence.grids.iter();
    let known = known.map(|g| (g.element_size, g.rms_error)).collect();
    LinePlot {
        title: "Element size".into(),
        x_label: "element size (share of the body)".into(),
        y_label: "error (share of the body)".into(),
        series: vec![
            Series::new(format!("this body, order {order:.2}"), body),
            Series::new(
                format!("known answer, order {:.2}", convergence.order),
                known,
            ),
        ],
        ..measured()
    }
}

/// Loss against seconds, for one kind of knob at a time: those whose name begins so, beside the tightest.
pub fn courses(courses: &[Course], kind: &str, title: &str) -> LinePlot {
    let own = courses
        .iter()
        .filter(|c| c.tightness.name == "tight" || c.tightness.name.contains(kind));
    let series = own.map(|c| Series::new(c.tightness.name.clone(), c.passes.clone()));
    LinePlot {
        title: title.into(),
        x_label: "seconds".into(),
        y_label: "mean loss of a pass".into(),
        series: series.collect(),
        log_y: true,
        markers: true,
        ..LinePlot::default()
    }
}

/// Mean error on grids that were not trained on.
pub fn resolutions(transfer: &Transfer, units: &Units) -> LinePlot {
    type Kind = fn(&TestGrid) -> Option<Errors>;
    let kinds: [(&str, Kind, SeriesStyle); 4] = [
        (
            "knows the spacing",
            |t| Some(t.conditioned),
            SeriesStyle::Line,
        ),
        (
            "network of the finest grid",
            |t| Some(t.evaluated),
            SeriesStyle::Line,
        ),
        ("interpolated", |t| Some(t.interpolated), SeriesStyle::Line),
        ("trained for it alone", |t| t.alone, SeriesStyle::Dots),
    ];
    let series = kinds.map(|(name, of, style)| {
        let own = transfer
            .tests
            .iter()
            .filter_map(|t| Some((t.samples as f64, of(t)?.mean)));
        let points = own.map(|(n, e)| (n, e * units.diagonal)).collect();
        Series::new(name, points).with_style(style)
    });
    LinePlot {
        title: "One network on grids that it was not trained on".into(),
        x_label: "samples".into(),
        y_label: format!("mean error ({})", units.name),
        series: series
            .into_iter()
            .filter(|s| !s.points.is_empty())
            .collect(),
        ..measured()
    }
}

/// A row of pictures for each direction, coloured by the error: the grid trained on, and the ways to actuate the other.
///
/// # Errors
/// When the pictures cannot be drawn.
pub fn transfer_sheet(transfer: &Transfer, subject: &Subject, units: &Units) -> Result<Vec<u8>> {
    let shapes = subject.shapes()?;
    let shown = shapes.len() - 1;
    let (shape, _) = &shapes[shown];
    let body = subject.body(&subject.scene)?;
    let all = { transfer.directions.iter() }.flat_map(|d| &d.ways);
    let errors: Vec<Vec<f64>> = { all.clone() }
        .map(|way| distances(&way.surfaces[shown], &shape.positions).2)
        .collect();
    let scale = ColourScale::holding(errors.iter().flatten().copied(), units.name.as_str())?;
    let colours: Vec<_> = errors.iter().map(|e| scale.colours(e)).collect();
    let (direction, up) = trainer::sheets::view(&body);
    let points = all.clone().flat_map(|way| &way.surfaces[shown]);
    let camera = Camera::framing(points, direction, up)?;
    let columns = transfer.directions[0].ways.len();
    let notes: Vec<(String, String)> = { transfer.directions.iter() }
        .flat_map(|d| d.ways.iter().enumerate().map(move |(i, way)| (d, i, way)))
        .map(|(d, i, way)| {
            let samples = if i == 0 { d.from } else { d.to };
            let mean = way.errors.mean * units.diagonal;
            let note = format!("{samples}: {mean:.1e}, {:.1} deg", way.errors.normals);
            (way.name.to_string(), note)
        })
        .collect();
    let title = format!(
        "{}: {} on another grid than that of training",
        subject.scene.name, shape.name
    );
    let mut sheet = ContactSheet::new(title, camera)
        .columns(columns)
        .scale(scale);
    for ((way, colours), (name, note)) in all.zip(&colours).zip(&notes) {
        sheet = sheet.panel(Panel {
            name,
            note,
            vertices: &way.surfaces[shown],
            triangles: body.surface.triangles(),
            colours: Colours::PerVertex(colours),
        });
    }
    Ok(sheet.render()?.to_png()?)
}

/// Estimated against true errors, with the bounds between which they should lie.
pub fn scatter(estimates: &Estimates) -> LinePlot {
    let point = |told: &Told| {
        let estimated = told.estimated.filter(|_| told.ratio().is_some())?;
        Some((told.true_error, estimated))
    };
    let measured = |is_inverted: bool| {
        let own = estimates.cases.iter();
        let own = own.filter(|case| (case.inverted_samples > 0) == is_inverted);
        own.filter_map(|case| point(&case.measured)).collect()
    };
    let unmeasured = estimates.cases.iter().map(|case| &case.unmeasured);
    let kinds: [(_, Vec<_>); 3] = [
        ("not measured", unmeasured.filter_map(point).collect()),
        ("measured", measured(false)),
        ("measured, inverted samples", measured(true)),
    ];
    let errors: Vec<f64> = kinds.iter().flat_map(|k| &k.1).map(|p| p.0).collect();
    let low = errors.iter().copied().fold(f64::INFINITY, f64::min);
    let high = errors.iter().copied().fold(0.0, f64::max);
    let mut series: Vec<Series> = { kinds.into_iter() }
        .filter(|(_, points)| !points.is_empty())
        .map(|(name, points)| Series::new(name, points).with_style(SeriesStyle::Dots))
        .collect();
    for (name, factor) in [("half", BOUNDS.0), ("equal", 1.0), ("five times", BOUNDS.1)] {
        let line = vec![(low, factor * low), (high, factor * high)];
        series.push(Series::new(name, line).with_style(SeriesStyle::Dashed));
    }
    LinePlot {
        title: "Estimated and true error of a solve".into(),
        x_label: "true error (diagonals)".into(),
        y_label: "estimated error (diagonals)".into(),
        series,
        log_x: true,
        log_y: true,
        ..LinePlot::default()
    }
}

/// Writes a plot as PNG and as SVG.
///
/// # Errors
/// When it has no points or a file cannot be written.
pub fn write(plot: &LinePlot, folder: &Path, name: &str) -> Result<()> {
    plot.write_png(folder.join(format!("{name}.png")))?;
    plot.write_svg(folder.join(format!("{name}.svg")))?;
    Ok(())
}
