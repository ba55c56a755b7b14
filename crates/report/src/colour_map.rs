//! A perceptually uniform colour map for errors, and the scale that goes with it.

use crate::error::ReportError;
use crate::image::{Image, Rgb};
use crate::shade::{Linear, to_srgb};
use crate::text::{self, Font};
use std::sync::LazyLock;

/// Entries of the map.
const STEPS: usize = 256;

/// Control points in OKLab: pale blue-grey over yellow-green and orange to a deep wine red. Lightness only falls, so that the order is
/// seen without colour too, and no error looks like plain clay.
const PATH: [[f64; 3]; 6] = [
    [0.950, -0.012, 0.012],
    [0.865, -0.035, 0.110],
    [0.745, 0.055, 0.125],
    [0.610, 0.150, 0.090],
    [0.450, 0.155, 0.020],
    [0.290, 0.090, -0.020],
];

static MAP: LazyLock<[Rgb; STEPS]> = LazyLock::new(equal_steps);

/// The colour at `part` (clamped to 0 to 1) of a map whose equal steps look equally large (distance in OKLab, Ottosson 2020)
/// and whose lightness falls all the way.
pub fn error_colour(part: f64) -> Rgb {
    let part = if part.is_nan() {
        1.0
    } else {
        part.clamp(0.0, 1.0)
    };
    MAP[(part * (STEPS - 1) as f64).round() as usize]
}

/// A colour scale from 0 to a stated end.
#[derive(Clone, Debug, PartialEq)]
pub struct ColourScale {
    end: f64,
    unit: String,
}

impl ColourScale {
    /// A scale from 0 to `end` in `unit`; larger values get the last colour.
    ///
    /// # Errors
    /// When `end` is not positive and finite.
    pub fn new(end: f64, unit: impl Into<String>) -> Result<Self, ReportError> {
        if !(end > 0.0 && end.is_finite()) {
            return Err(ReportError::ScaleEnd { maximum: end });
        }
        Ok(Self {
            end,
            unit: unit.into(),
        })
    }

    /// A scale that holds all `values` and ends at 1, 2, 2.5 or 5 times a power of ten; ends at 1 where all are 0.
    ///
    /// # Errors
    /// When a value is not finite.
    pub fn holding(
        values: impl IntoIterator<Item = f64>,
        unit: impl Into<String>,
    ) -> Result<Self, ReportError> {
        let mut largest = 0.0_f64;
        for value in values {
            if !value.is_finite() {
                return Err(ReportError::ScaleEnd { maximum: value });
            }
            largest = largest.max(value);
        }
        Self::new(round_up(largest), unit)
    }

    /// The value that has the last colour.
    pub fn end(&self) -> f64 {
        self.end
    }

    /// The unit of the values.
    pub fn unit(&self) -> &str {
        &self.unit
    }

    /// The colour of a value.
    pub fn colour(&self, value: f64) -> Rgb {
        error_colour(value / self.end)
    }

    /// The colours of many values, as [`crate::Colours::PerVertex`] takes them.
    pub fn colours(&self, values: &[f64]) -> Vec<Rgb> {
        values.iter().map(|&value| self.colour(value)).collect()
    }

    /// Values at equal steps from 0 to the end, and their text.
    fn ticks(&self) -> Vec<(f64, String)> {
        let magnitude = 10_f64.powf(self.end.log10().floor());
        let mantissa = self.end / magnitude;
        let parts = match () {
            () if (mantissa - 1.0).abs() < 1e-9 => 5,
            () if (mantissa - 2.0).abs() < 1e-9 => 4,
            () => 5,
        };
        let step = self.end / parts as f64;
        (0..=parts)
            .map(|part| (part as f64 * step, tick_text(part as f64 * step, step)))
            .collect()
    }

    /// Width in pixels of what [`ColourScale::draw`] draws.
    pub(crate) fn drawn_width(&self) -> usize {
        let ticks = self.ticks();
        let longest = ticks
            .iter()
            .map(|(_, text)| text.chars().count())
            .max()
            .unwrap_or(0);
        let unit = Font::Bold.width_of(self.unit.chars().count());
        (BAR_WIDTH + TICK_LENGTH + 4 + Font::Plain.width_of(longest)).max(unit)
    }

    /// Draws an upright bar with its unit above and ticks beside; (x, y) is the top left corner of the whole.
    pub(crate) fn draw(&self, image: &mut Image, x: usize, y: usize, height: usize, ink: Rgb) {
        let line = Font::Plain.line_height();
        text::draw(image, Font::Bold, x, y, &self.unit, ink);
        let top = y + line + line / 2 + 4;
        let length = height.saturating_sub(line + line / 2 + 4 + line / 2).max(2);
        image.fill(x, top - 1, BAR_WIDTH, length + 2, ink);
        for row in 0..length {
            let part = 1.0 - (row as f64 + 0.5) / length as f64;
            image.fill(x + 1, top + row, BAR_WIDTH - 2, 1, error_colour(part));
        }
        for (value, text) in self.ticks() {
            let at = top + ((1.0 - value / self.end) * (length - 1) as f64).round() as usize;
            image.fill(x + BAR_WIDTH, at, TICK_LENGTH, 1, ink);
            text::draw(
                image,
                Font::Plain,
                x + BAR_WIDTH + TICK_LENGTH + 4,
                at - line / 2,
                &text,
                ink,
            );
        }
    }
}

const BAR_WIDTH: usize = 22;
const TICK_LENGTH: usize = 5;

/// The least of 1, 2, 2.5, 5 times a power of ten that is not below `value`.
fn round_up(value: f64) -> f64 {
    if value <= f64::MIN_POSITIVE * 1e3 {
        return 1.0;
    }
    let magnitude = 10_f64.powf(value.log10().floor());
    [1.0, 2.0, 2.5, 5.0, 10.0]
        .into_iter()
        .map(|step| step * magnitude)
        .find(|&end| end >= value * (1.0 - 1e-12))
        .unwrap_or(10.0 * magnitude)
}

/// The value with as many decimals as `step` needs.
fn tick_text(value: f64, step: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    if !(1e-4..1e6).contains(&step) {
        return format!("{value:.1e}");
    }
    let decimals = (0..8)
        .find(|&decimals| {
            let scaled = step * 10_f64.powi(decimals);
            (scaled - scaled.round()).abs() < 1e-6 * scaled
        })
        .unwrap_or(8);
    format!("{value:.*}", decimals as usize)
}

/// Walks the path and keeps colours at equal distances along it.
fn equal_steps() -> [Rgb; STEPS] {
    const FINE: usize = 8192;
    let points: Vec<[f64; 3]> = (0..=FINE)
        .map(|step| along_path(step as f64 / FINE as f64))
        .collect();
    let mut travelled = vec![0.0];
    for pair in points.windows(2) {
        let last = travelled[travelled.len() - 1];
        travelled.push(last + distance(pair[0], pair[1]));
    }
    let total = travelled[FINE];
    std::array::from_fn(|step| {
        let wanted = total * step as f64 / (STEPS - 1) as f64;
        let index = travelled
            .partition_point(|&length| length < wanted)
            .min(FINE);
        to_srgb(oklab_to_linear(points[index]))
    })
}

/// A smooth curve through the control points (Catmull-Rom).
fn along_path(part: f64) -> [f64; 3] {
    let last = PATH.len() - 1;
    let at = part * last as f64;
    let segment = (at as usize).min(last - 1);
    let t = at - segment as f64;
    let point = |offset: isize| PATH[(segment as isize + offset).clamp(0, last as isize) as usize];
    let [before, from, to, after] = [point(-1), point(0), point(1), point(2)];
    std::array::from_fn(|axis| {
        let (a, b, c, d) = (before[axis], from[axis], to[axis], after[axis]);
        0.5 * (2.0 * b
            + (c - a) * t
            + (2.0 * a - 5.0 * b + 4.0 * c - d) * t * t
            + (3.0 * (b - c) + d - a) * t * t * t)
    })
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3)
        .map(|axis| (a[axis] - b[axis]).powi(2))
        .sum::<f64>()
        .sqrt()
}

/// OKLab to linear sRGB (Ottosson 2020).
fn oklab_to_linear([lightness, a, b]: [f64; 3]) -> Linear {
    let l = (lightness + 0.396_337_777_4 * a + 0.215_803_757_3 * b).powi(3);
    let m = (lightness - 0.105_561_345_8 * a - 0.063_854_172_8 * b).powi(3);
    let s = (lightness - 0.089_484_177_5 * a - 1.291_485_548 * b).powi(3);
    [
        4.076_741_662_1 * l - 3.307_711_591_3 * m + 0.230_969_929_2 * s,
        -1.268_438_004_6 * l + 2.609_757_401_1 * m - 0.341_319_396_5 * s,
        -0.004_196_086_3 * l - 0.703_418_614_7 * m + 1.707_614_701 * s,
    ]
    .map(|channel| channel as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shade::to_linear;

    fn oklab(colour: Rgb) -> [f64; 3] {
        let [r, g, b] = to_linear(colour).map(f64::from);
        let l = (0.412_221_470_8 * r + 0.536_332_536_3 * g + 0.051_445_992_9 * b).cbrt();
        let m = (0.211_903_498_2 * r + 0.680_699_545_1 * g + 0.107_396_956_6 * b).cbrt();
        let s = (0.088_302_461_9 * r + 0.281_718_837_6 * g + 0.629_978_700_5 * b).cbrt();
        [
            0.210_454_255_3 * l + 0.793_617_785 * m - 0.004_072_046_8 * s,
            1.977_998_495_1 * l - 2.428_592_205 * m + 0.450_593_709_9 * s,
            0.025_904_037_1 * l + 0.782_771_766_2 * m - 0.808_675_766 * s,
        ]
    }

    #[test]
    fn the_path_stays_inside_the_screen_colours() {
        for step in 0..=1000 {
            let colour = oklab_to_linear(along_path(step as f64 / 1000.0));
            assert!(
                colour.iter().all(|channel| (0.0..=1.0).contains(channel)),
                "{step}: {colour:?}"
            );
        }
    }

    #[test]
    fn steps_look_equal_and_lightness_falls() {
        let colours: Vec<_> = (0..=16)
            .map(|part| oklab(error_colour(part as f64 / 16.0)))
            .collect();
        let steps: Vec<f64> = colours
            .windows(2)
            .map(|pair| distance(pair[0], pair[1]))
            .collect();
        let mean = steps.iter().sum::<f64>() / steps.len() as f64;
        for (index, step) in steps.iter().enumerate() {
            assert!(
                (step / mean - 1.0).abs() < 0.1,
                "step {index} is {step}, the mean {mean}"
            );
        }
        assert!(
            colours
                .windows(2)
                .all(|pair| pair[1][0] < pair[0][0] - 0.01)
        );
    }

    #[test]
    fn automatic_ends_are_round_and_hold_everything() {
        for (largest, end) in [
            (0.0, 1.0),
            (0.07, 0.1),
            (0.1, 0.1),
            (0.11, 0.2),
            (2.1, 2.5),
            (3.0, 5.0),
            (51.0, 100.0),
        ] {
            let scale = ColourScale::holding([0.0, largest], "mm").unwrap();
            assert!(
                (scale.end() - end).abs() < 1e-12 * end,
                "{largest}: {}",
                scale.end()
            );
        }
        assert!(ColourScale::holding([f64::NAN], "mm").is_err());
        assert!(ColourScale::new(0.0, "mm").is_err());
    }

    #[test]
    fn ticks_have_just_the_decimals_they_need() {
        let texts = |end| -> Vec<String> {
            ColourScale::new(end, "mm")
                .unwrap()
                .ticks()
                .into_iter()
                .map(|(_, text)| text)
                .collect()
        };
        assert_eq!(texts(1.0), ["0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        assert_eq!(texts(2.0), ["0", "0.5", "1.0", "1.5", "2.0"]);
        assert_eq!(texts(0.25), ["0", "0.05", "0.10", "0.15", "0.20", "0.25"]);
        assert_eq!(texts(500.0), ["0", "100", "200", "300", "400", "500"]);
        assert_eq!(texts(1e-5)[5], "1.0e-5");
    }
}
