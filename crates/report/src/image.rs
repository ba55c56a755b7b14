//! An 8-bit RGB picture and its PNG file.

use crate::error::ReportError;
use crate::files::write_whole;
use std::path::Path;

/// A colour as 8-bit sRGB red, green and blue.
pub type Rgb = [u8; 3];

/// The largest width and height of a picture in pixels.
pub const SIDE_LIMIT: usize = 16_384;

/// An 8-bit sRGB picture, row by row from the top left.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    width: usize,
    height: usize,
    pixels: Vec<Rgb>,
}

impl Image {
    /// A picture of one colour.
    ///
    /// # Panics
    /// When a side is 0 or above [`SIDE_LIMIT`].
    pub fn new(width: usize, height: usize, colour: Rgb) -> Self {
        check_size(width, height)
            .expect("a picture has at least one pixel and sides within the limit");
        Self {
            width,
            height,
            pixels: vec![colour; width * height],
        }
    }

    pub(crate) fn from_pixels(width: usize, height: usize, pixels: Vec<Rgb>) -> Self {
        assert_eq!(pixels.len(), width * height, "one colour for each pixel");
        Self {
            width,
            height,
            pixels,
        }
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// All pixels, row by row from the top left.
    pub fn pixels(&self) -> &[Rgb] {
        &self.pixels
    }

    /// The colour in column `x` and row `y`, counted from the top left.
    ///
    /// # Panics
    /// When the pixel is outside the picture.
    pub fn pixel(&self, x: usize, y: usize) -> Rgb {
        assert!(
            x < self.width && y < self.height,
            "pixel ({x}, {y}) is outside the picture"
        );
        self.pixels[y * self.width + x]
    }

    /// Fills the part of a rectangle that lies inside the picture; (x, y) is its top left corner.
    pub fn fill(&mut self, x: usize, y: usize, width: usize, height: usize, colour: Rgb) {
        let (left, right) = (x.min(self.width), (x + width).min(self.width));
        for row in y.min(self.height)..(y + height).min(self.height) {
            self.pixels[row * self.width + left..row * self.width + right].fill(colour);
        }
    }

    /// Copies `other` with its top left corner at (x, y); what lies outside is left away.
    pub fn paste(&mut self, other: &Image, x: usize, y: usize) {
        let columns = other.width.min(self.width.saturating_sub(x));
        for row in 0..other.height.min(self.height.saturating_sub(y)) {
            let target = (y + row) * self.width + x;
            let source = row * other.width;
            self.pixels[target..target + columns]
                .copy_from_slice(&other.pixels[source..source + columns]);
        }
    }

    /// Lays `colour` over one pixel with the given opacity (0 to 255).
    pub(crate) fn blend(&mut self, x: usize, y: usize, colour: Rgb, opacity: u8) {
        if x >= self.width || y >= self.height {
            return;
        }
        let pixel = &mut self.pixels[y * self.width + x];
        let over = u32::from(opacity);
        for (below, above) in pixel.iter_mut().zip(colour) {
            let mixed = u32::from(*below) * (255 - over) + u32::from(above) * over;
            *below = ((mixed + 127) / 255) as u8;
        }
    }

    /// The picture as the bytes of a PNG file (RGB, 8 bits, sRGB).
    ///
    /// # Errors
    /// When the encoder fails.
    pub fn to_png(&self) -> Result<Vec<u8>, ReportError> {
        let failed = |source| ReportError::Encode { source };
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width as u32, self.height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
        let mut writer = encoder.write_header().map_err(failed)?;
        writer
            .write_image_data(self.pixels.as_flattened())
            .map_err(failed)?;
        writer.finish().map_err(failed)?;
        Ok(bytes)
    }

    /// Writes a PNG file, which appears whole or not at all.
    ///
    /// # Errors
    /// When the encoder fails or the file cannot be written.
    pub fn write_png(&self, path: impl AsRef<Path>) -> Result<(), ReportError> {
        write_whole(path.as_ref(), &self.to_png()?)
    }
}

pub(crate) fn check_size(width: usize, height: usize) -> Result<(), ReportError> {
    let allowed = 1..=SIDE_LIMIT;
    if allowed.contains(&width) && allowed.contains(&height) {
        return Ok(());
    }
    Err(ReportError::PictureSize {
        width,
        height,
        limit: SIDE_LIMIT,
    })
}
