//! Contact sheets: many small pictures of one object in a grid, each with its name.

use crate::camera::Camera;
use crate::colour_map::ColourScale;
use crate::error::ReportError;
use crate::image::{Image, check_size};
use crate::render::{BACKGROUND, Colours, Mesh, render};
use crate::sheet::{FAINT, GAP, INK};
use crate::text::{self, Font};
use nalgebra::Vector3;

/// One picture of a contact sheet.
#[derive(Clone, Copy, Debug)]
pub struct Panel<'a> {
    /// Name written below the picture.
    pub name: &'a str,
    /// A second line below the name; may be empty.
    pub note: &'a str,
    /// Vertex positions, in length units.
    pub vertices: &'a [Vector3<f64>],
    /// Triangles, three vertices each.
    pub triangles: &'a [[u32; 3]],
    /// Its colour, [`crate::CLAY`] or one for each vertex.
    pub colours: Colours<'a>,
}

/// A page of pictures seen by one camera, row by row from the top left.
///
/// ```
/// use nalgebra::Vector3;
/// use report::{CLAY, Camera, Colours, ContactSheet, Panel};
///
/// let first = [Vector3::zeros(), Vector3::x(), Vector3::y()];
/// let second = [Vector3::zeros(), Vector3::x(), Vector3::y() * 1.5];
/// let camera = Camera::framing(first.iter().chain(&second), -Vector3::z(), Vector3::y())?;
/// let colours = Colours::Uniform(CLAY);
/// let panel = |name, vertices| Panel { name, note: "", vertices, triangles: &[[0, 1, 2]], colours };
/// let sheet = ContactSheet::new("A triangle that grows", camera)
///     .panel(panel("short", &first))
///     .panel(panel("long", &second))
///     .render()?;
/// assert!(sheet.width() > sheet.height());
/// # Ok::<(), report::ReportError>(())
/// ```
#[derive(Clone, Debug)]
pub struct ContactSheet<'a> {
    title: String,
    camera: Camera,
    panels: Vec<Panel<'a>>,
    columns: usize,
    panel_width: usize,
    scale: Option<ColourScale>,
}

impl<'a> ContactSheet<'a> {
    /// An empty sheet whose pictures are taken by `camera`.
    pub fn new(title: impl Into<String>, camera: Camera) -> Self {
        Self {
            title: title.into(),
            camera,
            panels: Vec::new(),
            columns: 6,
            panel_width: 240,
            scale: None,
        }
    }

    /// Adds a picture.
    #[must_use]
    pub fn panel(mut self, panel: Panel<'a>) -> Self {
        self.panels.push(panel);
        self
    }

    /// Sets how many pictures stand in a row (6 unless set); at least 1 is taken. Fewer pictures than that make a narrower sheet.
    #[must_use]
    pub fn columns(mut self, columns: usize) -> Self {
        self.columns = columns.max(1);
        self
    }

    /// Sets the width of a picture in pixels (240 unless set); 120 to 2000 is taken.
    #[must_use]
    pub fn panel_width(mut self, width: usize) -> Self {
        self.panel_width = width.clamp(120, 2000);
        self
    }

    /// Draws a scale beside the pictures, for those that are coloured by it. Without it there is none.
    #[must_use]
    pub fn scale(mut self, scale: ColourScale) -> Self {
        self.scale = Some(scale);
        self
    }

    /// Draws the sheet.
    ///
    /// # Errors
    /// [`ReportError::EmptySheet`] without pictures, [`ReportError::Row`] with the place of one that cannot be drawn, and
    /// [`ReportError::PictureSize`] when a side would be above [`crate::SIDE_LIMIT`].
    pub fn render(&self) -> Result<Image, ReportError> {
        if self.panels.is_empty() {
            return Err(ReportError::EmptySheet);
        }
        let columns = self.columns.min(self.panels.len());
        let fitted = (self.panel_width as f64 / self.camera.aspect()).round() as usize;
        let panel = [self.panel_width, fitted.clamp(80, 2 * self.panel_width)];
        let label = Font::Bold.line_height() + Font::Plain.line_height() + 4;
        let cell = [panel[0] + GAP, panel[1] + label + GAP];
        let top = GAP + Font::Title.line_height() + GAP;
        let scale_left = GAP + columns * cell[0];
        let scale_width = |scale: &ColourScale| scale.drawn_width() + GAP;
        let width = scale_left + self.scale.as_ref().map_or(0, scale_width);
        let height = top + self.panels.len().div_ceil(columns) * cell[1];
        check_size(width, height)?;
        let mut image = Image::new(width, height, BACKGROUND);
        let title = text::shorten(&self.title, Font::Title.fitting(width - 2 * GAP));
        text::draw(&mut image, Font::Title, GAP, GAP, &title, INK);
        if let Some(scale) = &self.scale {
            scale.draw(&mut image, scale_left, top, panel[1], INK);
        }
        for (index, content) in self.panels.iter().enumerate() {
            let mesh = Mesh {
                vertices: content.vertices,
                triangles: content.triangles,
                colours: content.colours,
            };
            let picture = render(&mesh, &self.camera, panel[0], panel[1]);
            let picture = picture.map_err(|source| ReportError::Row {
                row: index,
                name: content.name.to_owned(),
                source: Box::new(source),
            })?;
            let left = GAP + index % columns * cell[0];
            let below = top + index / columns * cell[1];
            image.paste(&picture, left, below);
            let middle = left + panel[0] / 2;
            let mut line = below + panel[1] + 2;
            for (font, words, colour) in [
                (Font::Bold, content.name, INK),
                (Font::Plain, content.note, FAINT),
            ] {
                let words = text::shorten(words, font.fitting(panel[0]));
                text::draw_centred(&mut image, font, middle, line, &words, colour);
                line += font.line_height();
            }
        }
        Ok(image)
    }
}
