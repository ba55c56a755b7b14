//! Comparison sheets: target, simulation and error side by side, one shape a row.

use crate::camera::Camera;
use crate::colour_map::ColourScale;
use crate::error::ReportError;
use crate::image::{Image, Rgb};
use crate::render::{BACKGROUND, CLAY, Colours, Mesh, check_mesh, render};
use crate::text::{self, Font};
use nalgebra::Vector3;

/// Colour of what is to be read first.
pub(crate) const INK: Rgb = [38, 40, 46];
/// Colour of what explains.
pub(crate) const FAINT: Rgb = [104, 108, 118];
const RULE: Rgb = [222, 224, 229];
/// Free space around the sheet and between its parts, in pixels.
pub(crate) const GAP: usize = 16;
/// Width of the column with the names, in pixels.
const LABEL_WIDTH: usize = 208;
/// A panel is never lower than this, so that its row's label has room.
const PANEL_HEIGHT_LEAST: usize = 160;
const COLUMNS: usize = 3;

/// One shape of a comparison sheet.
#[derive(Clone, Copy, Debug)]
pub struct Row<'a> {
    /// Name of the shape.
    pub name: &'a str,
    /// Triangles of the simulated surface, and of the target unless that has its own.
    pub triangles: &'a [[u32; 3]],
    /// Triangles of a target that is another mesh, such as a scan: it may then have any number of vertices.
    pub target_triangles: Option<&'a [[u32; 3]]>,
    /// Vertices wanted, in length units.
    pub target: &'a [Vector3<f64>],
    /// Vertices reached.
    pub simulated: &'a [Vector3<f64>],
    /// Error of each vertex, in the unit of the sheet.
    pub errors: &'a [f64],
    /// Anything else to be said; may be empty.
    pub note: &'a str,
}

impl<'a> Row<'a> {
    fn target_mesh(&self) -> (&'a [Vector3<f64>], &'a [[u32; 3]]) {
        (self.target, self.target_triangles.unwrap_or(self.triangles))
    }
}

/// Pages of rows `target | simulated | error in colour`, with one camera and one colour scale for all of them.
///
/// ```
/// use nalgebra::Vector3;
/// use report::{ComparisonSheet, Row};
///
/// let target = [Vector3::zeros(), Vector3::x(), Vector3::y()];
/// let simulated = [Vector3::zeros(), Vector3::x() * 1.1, Vector3::y()];
/// let pages = ComparisonSheet::new("One triangle", "mm")
///     .row(Row {
///         name: "stretched",
///         triangles: &[[0, 1, 2]],
///         target_triangles: None,
///         target: &target,
///         simulated: &simulated,
///         errors: &[0.0, 0.1, 0.0],
///         note: "",
///     })
///     .render()?;
/// assert_eq!(pages.len(), 1);
/// # Ok::<(), report::ReportError>(())
/// ```
#[derive(Clone, Debug)]
pub struct ComparisonSheet<'a> {
    title: String,
    unit: String,
    rows: Vec<Row<'a>>,
    direction: Vector3<f64>,
    up: Vector3<f64>,
    scale_end: Option<f64>,
    panel_width: usize,
    rows_per_page: usize,
}

impl<'a> ComparisonSheet<'a> {
    /// An empty sheet; `unit` is that of the errors.
    pub fn new(title: impl Into<String>, unit: impl Into<String>) -> Self {
        Self {
            title: title.into(),
            unit: unit.into(),
            rows: Vec::new(),
            direction: -Vector3::z(),
            up: Vector3::y(),
            scale_end: None,
            panel_width: 300,
            rows_per_page: 8,
        }
    }

    /// Adds a shape.
    #[must_use]
    pub fn row(mut self, row: Row<'a>) -> Self {
        self.rows.push(row);
        self
    }

    /// Looks along `direction` (from the viewer into the scene) with `up` upwards. Without it the viewer looks along -z and y is
    /// up.
    #[must_use]
    pub fn view(mut self, direction: Vector3<f64>, up: Vector3<f64>) -> Self {
        self.direction = direction;
        self.up = up;
        self
    }

    /// Ends the colour scale at `end`; larger errors get the last colour, and the sheet says so. Without it the scale holds
    /// the largest error.
    #[must_use]
    pub fn scale_end(mut self, end: f64) -> Self {
        self.scale_end = Some(end);
        self
    }

    /// Sets the width of a panel in pixels (300 unless set); at least 120 is taken.
    #[must_use]
    pub fn panel_width(mut self, width: usize) -> Self {
        self.panel_width = width.clamp(120, 2000);
        self
    }

    /// Sets how many rows a page holds at most (8 unless set); at least 1 is taken.
    #[must_use]
    pub fn rows_per_page(mut self, rows: usize) -> Self {
        self.rows_per_page = rows.max(1);
        self
    }

    /// Draws all pages.
    ///
    /// # Errors
    /// When there are no rows, a row's counts differ, an error is negative or not finite, a surface cannot be drawn, the
    /// view is degenerate, or a page would be higher than [`crate::SIDE_LIMIT`].
    pub fn render(&self) -> Result<Vec<Image>, ReportError> {
        if self.rows.is_empty() {
            return Err(ReportError::EmptySheet);
        }
        for (index, row) in self.rows.iter().enumerate() {
            check_row(index, row)?;
        }
        let points = self
            .rows
            .iter()
            .flat_map(|row| row.target.iter().chain(row.simulated));
        let camera = Camera::framing(points, self.direction, self.up)?;
        let errors = || self.rows.iter().flat_map(|row| row.errors.iter().copied());
        let scale = match self.scale_end {
            Some(end) => ColourScale::new(end, self.unit.as_str())?,
            None => ColourScale::holding(errors(), self.unit.as_str())?,
        };
        let largest = errors().fold(0.0, f64::max);
        let layout = Layout::new(self, &camera, &scale, largest);
        let pages = self.rows.len().div_ceil(self.rows_per_page);
        self.rows
            .chunks(self.rows_per_page)
            .enumerate()
            .map(|(page, rows)| layout.page(rows, page + 1, pages))
            .collect()
    }
}

fn check_row(index: usize, row: &Row) -> Result<(), ReportError> {
    let (target, simulated, errors) = (row.target.len(), row.simulated.len(), row.errors.len());
    let target_fits = target == simulated || row.target_triangles.is_some();
    if !target_fits || simulated != errors {
        return Err(ReportError::RowCount {
            row: index,
            name: row.name.to_owned(),
            target,
            simulated,
            errors,
        });
    }
    if let Some(vertex) = row
        .errors
        .iter()
        .position(|value| !(*value >= 0.0 && value.is_finite()))
    {
        return Err(ReportError::RowError {
            row: index,
            name: row.name.to_owned(),
            vertex,
            value: row.errors[vertex],
        });
    }
    for (vertices, triangles) in [row.target_mesh(), (row.simulated, row.triangles)] {
        let mesh = Mesh {
            vertices,
            triangles,
            colours: Colours::Uniform(CLAY),
        };
        check_mesh(&mesh).map_err(|source| ReportError::Row {
            row: index,
            name: row.name.to_owned(),
            source: Box::new(source),
        })?;
    }
    Ok(())
}

/// Where things go on a page, and what all pages share.
struct Layout<'a> {
    title: &'a str,
    camera: &'a Camera,
    scale: &'a ColourScale,
    /// What the scale says about itself, line by line.
    scale_note: Vec<String>,
    panel: [usize; 2],
    width: usize,
    /// Where the first row starts.
    top: usize,
    scale_left: usize,
}

impl<'a> Layout<'a> {
    fn new(
        sheet: &'a ComparisonSheet,
        camera: &'a Camera,
        scale: &'a ColourScale,
        largest: f64,
    ) -> Self {
        let fitted = (sheet.panel_width as f64 / camera.aspect()).round() as usize;
        let panel = [
            sheet.panel_width,
            fitted.clamp(PANEL_HEIGHT_LEAST, 2 * sheet.panel_width),
        ];
        let scale_left = GAP + LABEL_WIDTH + COLUMNS * (panel[0] + GAP) + GAP;
        let unit = scale.unit();
        let mut scale_note = vec!["largest".to_owned(), format!("{} {unit}", number(largest))];
        // The automatic end may fall short of the largest error by its own rounding.
        if largest > scale.end() * (1.0 + 1e-9) {
            scale_note.extend([
                "(beyond the".to_owned(),
                "scale: last".to_owned(),
                "colour)".to_owned(),
            ]);
        }
        let note_width = scale_note
            .iter()
            .map(|line| Font::Plain.width_of(line.chars().count()))
            .max();
        let scale_width = scale.drawn_width().max(note_width.unwrap_or(0));
        Self {
            title: &sheet.title,
            camera,
            scale,
            scale_note,
            panel,
            width: scale_left + scale_width + GAP,
            top: GAP + Font::Title.line_height() + GAP + Font::Bold.line_height() + GAP,
            scale_left,
        }
    }

    fn column_left(&self, column: usize) -> usize {
        GAP + LABEL_WIDTH + column * (self.panel[0] + GAP)
    }

    fn page(&self, rows: &[Row], page: usize, pages: usize) -> Result<Image, ReportError> {
        let row_height = self.panel[1] + GAP;
        let scale_height = self.panel[1].clamp(200, 320);
        let note_height = (self.scale_note.len() + 1) * Font::Plain.line_height();
        let height =
            (self.top + rows.len() * row_height).max(self.top + scale_height + note_height) + GAP;
        crate::image::check_size(self.width, height)?;
        let mut image = Image::new(self.width, height, BACKGROUND);
        self.draw_heading(&mut image, page, pages);
        self.draw_scale(&mut image, scale_height);
        for (index, row) in rows.iter().enumerate() {
            let top = self.top + index * row_height;
            image.fill(GAP, top - GAP / 2, self.scale_left - 3 * GAP, 1, RULE);
            self.draw_label(&mut image, row, top + GAP / 2);
            self.draw_panels(&mut image, row, top)?;
        }
        Ok(image)
    }

    fn draw_heading(&self, image: &mut Image, page: usize, pages: usize) {
        let of_pages = if pages > 1 {
            format!("page {page} of {pages}")
        } else {
            String::new()
        };
        let page_width = Font::Plain.width_of(of_pages.chars().count());
        let room = Font::Title.fitting(self.width - 3 * GAP - page_width);
        text::draw(
            image,
            Font::Title,
            GAP,
            GAP,
            &text::shorten(self.title, room),
            INK,
        );
        text::draw(
            image,
            Font::Plain,
            self.width - GAP - page_width,
            GAP + 6,
            &of_pages,
            FAINT,
        );
        let below = GAP + Font::Title.line_height() + GAP;
        let error = format!("error ({})", self.scale.unit());
        for (column, heading) in ["target", "simulated", error.as_str()]
            .into_iter()
            .enumerate()
        {
            let middle = self.column_left(column) + self.panel[0] / 2;
            let heading = text::shorten(heading, Font::Bold.fitting(self.panel[0]));
            text::draw_centred(image, Font::Bold, middle, below, &heading, INK);
        }
    }

    fn draw_scale(&self, image: &mut Image, height: usize) {
        self.scale
            .draw(image, self.scale_left, self.top, height, INK);
        for (index, line) in self.scale_note.iter().enumerate() {
            let y = self.top + height + (index + 1) * Font::Plain.line_height();
            text::draw(image, Font::Plain, self.scale_left, y, line, FAINT);
        }
    }

    fn draw_label(&self, image: &mut Image, row: &Row, top: usize) {
        let line_height = Font::Plain.line_height() + 2;
        let room = (self.panel[1] - GAP / 2) / line_height;
        let limit = Font::Plain.fitting(LABEL_WIDTH - GAP);
        let mut lines: Vec<(String, Font, Rgb)> = Vec::new();
        lines.extend(
            text::wrap(row.name, limit, 3)
                .into_iter()
                .map(|line| (line, Font::Bold, INK)),
        );
        let unit = self.scale.unit();
        let count = row.errors.len().max(1) as f64;
        let mean = row.errors.iter().sum::<f64>() / count;
        let max = row.errors.iter().copied().fold(0.0, f64::max);
        for (what, value) in [("mean", mean), ("max", max)] {
            let line = text::shorten(&format!("{what:<4} {} {unit}", number(value)), limit);
            lines.push((line, Font::Plain, INK));
        }
        let left = room.saturating_sub(lines.len());
        lines.extend(
            text::wrap(row.note, limit, left)
                .into_iter()
                .map(|line| (line, Font::Plain, FAINT)),
        );
        for (index, (line, font, colour)) in lines.iter().enumerate() {
            text::draw(image, *font, GAP, top + index * line_height, line, *colour);
        }
    }

    fn draw_panels(&self, image: &mut Image, row: &Row, top: usize) -> Result<(), ReportError> {
        let colours = self.scale.colours(row.errors);
        let simulated = (row.simulated, row.triangles);
        let panels = [
            (row.target_mesh(), Colours::Uniform(CLAY)),
            (simulated, Colours::Uniform(CLAY)),
            (simulated, Colours::PerVertex(&colours)),
        ];
        for (column, ((vertices, triangles), colours)) in panels.into_iter().enumerate() {
            let mesh = Mesh {
                vertices,
                triangles,
                colours,
            };
            let panel = render(&mesh, self.camera, self.panel[0], self.panel[1])?;
            image.paste(&panel, self.column_left(column), top);
        }
        Ok(())
    }
}

/// Three significant digits, in plain notation where that stays short.
fn number(value: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    // Rounding first keeps 0.9996 from showing four digits.
    let rounded: f64 = format!("{value:.2e}").parse().unwrap_or(value);
    let power = rounded.abs().log10().floor() as i32;
    match power {
        -4..=2 => format!("{rounded:.*}", (2 - power) as usize),
        3..=5 => format!("{rounded:.0}"),
        _ => format!("{rounded:.2e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::number;

    #[test]
    fn numbers_have_three_digits() {
        let cases = [
            (0.0, "0"),
            (0.012_345, "0.0123"),
            (0.999_6, "1.00"),
            (9.996, "10.0"),
            (123.4, "123"),
            (12_345.0, "12300"),
            (1.234e-7, "1.23e-7"),
            (1.234e9, "1.23e9"),
        ];
        for (value, text) in cases {
            assert_eq!(number(value), text);
        }
    }
}
