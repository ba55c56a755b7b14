//! Text in pictures, in a fixed-width font.

use crate::image::{Image, Rgb};
use noto_sans_mono_bitmap::{
    FontWeight, RasterHeight, RasterizedChar, get_raster, get_raster_width,
};

/// A size and weight of the built-in font.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Font {
    /// 16 pixels a line.
    Plain,
    /// 16 pixels a line, bold.
    Bold,
    /// 24 pixels a line, bold.
    Title,
}

impl Font {
    fn face(self) -> (FontWeight, RasterHeight) {
        match self {
            Font::Plain => (FontWeight::Regular, RasterHeight::Size16),
            Font::Bold => (FontWeight::Bold, RasterHeight::Size16),
            Font::Title => (FontWeight::Bold, RasterHeight::Size24),
        }
    }

    /// Height of a line in pixels.
    pub fn line_height(self) -> usize {
        self.face().1.val()
    }

    /// Width of `characters` characters in pixels.
    pub fn width_of(self, characters: usize) -> usize {
        let (weight, height) = self.face();
        characters * get_raster_width(weight, height)
    }

    /// How many characters fit into `width` pixels.
    pub fn fitting(self, width: usize) -> usize {
        width / self.width_of(1)
    }

    /// The character, or a question mark for one the font lacks.
    fn glyph(self, character: char) -> RasterizedChar {
        let (weight, height) = self.face();
        get_raster(character, weight, height)
            .or_else(|| get_raster('?', weight, height))
            .expect("the font holds ASCII")
    }
}

/// Writes one line with its top left corner at (x, y); what lies outside the picture is left away.
pub(crate) fn draw(image: &mut Image, font: Font, x: usize, y: usize, text: &str, colour: Rgb) {
    for (place, character) in text.chars().enumerate() {
        let left = x + font.width_of(place);
        for (row, line) in font.glyph(character).rows().enumerate() {
            for (column, &coverage) in line.iter().enumerate() {
                if coverage > 0 {
                    image.blend(left + column, y + row, colour, coverage);
                }
            }
        }
    }
}

/// Writes one line centred about `x`.
pub(crate) fn draw_centred(
    image: &mut Image,
    font: Font,
    x: usize,
    y: usize,
    text: &str,
    colour: Rgb,
) {
    let width = font.width_of(text.chars().count());
    draw(image, font, x.saturating_sub(width / 2), y, text, colour);
}

/// The text, or its beginning and three dots where it has more than `limit` characters.
pub(crate) fn shorten(text: &str, limit: usize) -> String {
    if text.chars().count() <= limit {
        return text.to_owned();
    }
    let dots = limit.min(3);
    let kept: String = text.chars().take(limit - dots).collect();
    format!("{}{}", kept.trim_end(), &"..."[..dots])
}

/// Lines of at most `limit` characters, broken between words where possible; the last one shortened when more than
/// `line_limit` would be needed.
///
/// # Panics
/// When `limit` is 0.
pub(crate) fn wrap(text: &str, limit: usize, line_limit: usize) -> Vec<String> {
    assert!(limit > 0, "a line holds at least one character");
    let mut lines: Vec<String> = Vec::new();
    for paragraph in text.lines() {
        let mut line = String::new();
        for word in paragraph.split_whitespace() {
            let needed =
                line.chars().count() + usize::from(!line.is_empty()) + word.chars().count();
            if needed <= limit {
                if !line.is_empty() {
                    line.push(' ');
                }
                line.push_str(word);
                continue;
            }
            if !line.is_empty() {
                lines.push(std::mem::take(&mut line));
            }
            let letters: Vec<char> = word.chars().collect();
            let mut pieces: Vec<String> = letters
                .chunks(limit)
                .map(|piece| piece.iter().collect())
                .collect();
            line = pieces.pop().unwrap_or_default();
            lines.append(&mut pieces);
        }
        lines.push(line);
    }
    if lines.len() > line_limit {
        let rest = lines.split_off(line_limit);
        if let Some(last) = lines.last_mut() {
            *last = shorten(&format!("{last} {}", rest.join(" ")), limit);
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrapping_keeps_words_and_limits() {
        assert_eq!(
            wrap("a smile to the left", 8, 9),
            ["a smile", "to the", "left"]
        );
        assert_eq!(wrap("mouthUpperUp_L", 6, 9), ["mouthU", "pperUp", "_L"]);
        assert_eq!(wrap("one two three four", 8, 2), ["one two", "three..."]);
        assert_eq!(wrap("one\ntwo", 8, 9), ["one", "two"]);
        assert_eq!(wrap("one two three", 8, 0), Vec::<String>::new());
    }

    #[test]
    fn shortening_never_exceeds_the_limit() {
        for limit in 0..20 {
            assert!(shorten("a rather long line", limit).chars().count() <= limit);
        }
        assert_eq!(shorten("short", 5), "short");
        assert_eq!(shorten("longer", 5), "lo...");
    }

    #[test]
    fn characters_outside_the_font_become_question_marks() {
        let picture = |text| {
            let mut image = Image::new(40, 20, [255; 3]);
            draw(&mut image, Font::Plain, 2, 2, text, [0; 3]);
            image
        };
        assert_eq!(picture("\u{4e2d}"), picture("?"));
        assert_ne!(picture("\u{b5}"), picture("?"));
    }
}
