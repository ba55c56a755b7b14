//! Line plots, as SVG text and as PNG.

use crate::error::ReportError;
use crate::files::write_whole;
use kuva::PngBackend;
use kuva::backend::svg::SvgBackend;
use kuva::plot::annotations::TextAnnotation;
use kuva::plot::{LegendPosition, LinePlot as KuvaLine, ScatterPlot};
use kuva::render::layout::{Layout, TickFormat};
use kuva::render::plots::Plot;
use kuva::render::render::{Scene, render_multiple};
use std::path::Path;
use std::sync::Arc;

/// Okabe and Ito's colours, told apart with every common kind of colour vision, those that are faint on white last.
const COLOURS: [&str; 8] = [
    "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#000000", "#E69F00", "#56B4E9", "#A89C00",
];

/// How a series is drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SeriesStyle {
    /// A line through the points.
    #[default]
    Line,
    /// A dashed line, for what is not measured: a slope, a bound.
    Dashed,
    /// Dots alone.
    Dots,
}

/// A named line or cloud of dots.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Its name in the legend.
    pub name: String,
    /// Its points (x, y) in drawing order.
    pub points: Vec<(f64, f64)>,
    /// How it is drawn.
    pub style: SeriesStyle,
}

impl Series {
    /// A line through `points`.
    pub fn new(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Self {
            name: name.into(),
            points,
            style: SeriesStyle::Line,
        }
    }

    /// The same points in another style.
    #[must_use]
    pub fn with_style(self, style: SeriesStyle) -> Self {
        Self { style, ..self }
    }
}

/// Text at a place of a plot.
#[derive(Clone, Debug, PartialEq)]
pub struct PlotLabel {
    /// The text.
    pub text: String,
    /// Where it begins, in the units of the axes.
    pub at: (f64, f64),
}

/// A plot of lines with a legend, in colours that do not need full colour vision.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LinePlot {
    /// Text above the plot.
    pub title: String,
    /// Text below the x axis, with its unit.
    pub x_label: String,
    /// Text beside the y axis, with its unit.
    pub y_label: String,
    /// The lines.
    pub series: Vec<Series>,
    /// Logarithmic x axis.
    pub log_x: bool,
    /// Logarithmic y axis.
    pub log_y: bool,
    /// Dots at the points of lines, for measurements rather than curves.
    pub markers: bool,
    /// Texts within the plot.
    pub labels: Vec<PlotLabel>,
}

impl LinePlot {
    /// The plot as SVG text.
    ///
    /// # Errors
    /// When there are no points, one is not finite, or one is not positive on a logarithmic axis.
    pub fn svg(&self) -> Result<String, ReportError> {
        Ok(SvgBackend::default().render_scene(&self.scene()?))
    }

    /// The plot as the bytes of a PNG file, 1600 pixels wide or more.
    ///
    /// # Errors
    /// As [`LinePlot::svg`]; and when the plot library cannot draw it.
    pub fn png(&self) -> Result<Vec<u8>, ReportError> {
        PngBackend::new()
            .with_scale(2.0)
            .render_scene(&self.scene()?)
            .map_err(|reason| ReportError::PlotDrawing {
                title: self.title.clone(),
                reason,
            })
    }

    /// Writes the SVG text, which appears whole or not at all.
    ///
    /// # Errors
    /// As [`LinePlot::svg`]; and when the file cannot be written.
    pub fn write_svg(&self, path: impl AsRef<Path>) -> Result<(), ReportError> {
        write_whole(path.as_ref(), self.svg()?.as_bytes())
    }

    /// Writes the PNG file, which appears whole or not at all.
    ///
    /// # Errors
    /// As [`LinePlot::png`]; and when the file cannot be written.
    pub fn write_png(&self, path: impl AsRef<Path>) -> Result<(), ReportError> {
        write_whole(path.as_ref(), &self.png()?)
    }

    fn check(&self) -> Result<(), ReportError> {
        let shown =
            |value: f64, logarithmic: bool| value.is_finite() && (!logarithmic || value > 0.0);
        for series in &self.series {
            for (point, &(x, y)) in series.points.iter().enumerate() {
                if !(shown(x, self.log_x) && shown(y, self.log_y)) {
                    return Err(ReportError::PlotPoint {
                        series: series.name.clone(),
                        point,
                        x,
                        y,
                    });
                }
            }
        }
        if self.series.iter().all(|series| series.points.is_empty()) {
            return Err(ReportError::EmptyPlot {
                title: self.title.clone(),
            });
        }
        Ok(())
    }

    fn scene(&self) -> Result<Scene, ReportError> {
        self.check()?;
        let mut plots: Vec<Plot> = Vec::new();
        for (series, colour) in self.series.iter().zip(COLOURS.iter().cycle()) {
            let points = || series.points.iter().copied();
            let dots = ScatterPlot::new()
                .with_data(points())
                .with_color(*colour)
                .with_size(4.0);
            if series.style == SeriesStyle::Dots {
                plots.push(dots.with_legend(literal(&series.name)).into());
                continue;
            }
            let line = KuvaLine::new()
                .with_data(points())
                .with_color(*colour)
                .with_stroke_width(2.0)
                .with_legend(literal(&series.name));
            let is_dashed = series.style == SeriesStyle::Dashed;
            plots.push(if is_dashed { line.with_dashed() } else { line }.into());
            // A single point has no line to be seen by.
            if self.markers && !is_dashed || series.points.len() == 1 {
                plots.push(dots.into());
            }
        }
        let mut layout = Layout::auto_from_plots(&plots)
            .with_width(800.0)
            .with_height(500.0)
            .with_title(literal(&self.title))
            .with_x_label(literal(&self.x_label))
            .with_y_label(literal(&self.y_label))
            .with_legend_position(LegendPosition::OutsideRightTop)
            .with_tick_format(match self.log_x || self.log_y {
                true => TickFormat::Custom(Arc::new(tick)),
                false => TickFormat::Auto,
            });
        for label in &self.labels {
            let text = TextAnnotation::new(literal(&label.text), label.at.0, label.at.1);
            layout = layout.with_annotation(text);
        }
        if self.log_x {
            layout = layout.with_log_x();
        }
        if self.log_y {
            layout = layout.with_log_y();
        }
        Ok(render_multiple(plots, layout))
    }
}

/// A number at a logarithmic axis: as it is where it is short so.
fn tick(value: f64) -> String {
    let size = value.abs();
    match size == 0.0 || (1e-2..1e5).contains(&size) {
        true => value.to_string(),
        false => format!("{value:e}"),
    }
}

/// The plot library takes dollar signs for mathematics. Control characters would make the SVG no XML; as in pictures, a question mark stands
/// for what the font lacks.
fn literal(text: &str) -> String {
    text.replace(char::is_control, "?").replace('$', "\\$")
}
