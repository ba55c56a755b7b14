//! Light and surface: a key, a fill and a rim light over a soft sky, in linear light.

use crate::image::Rgb;

/// A colour in linear light.
pub(crate) type Linear = [f32; 3];

/// How strongly a surface answers to light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Finish {
    /// Matt clay: full contrast and a soft highlight.
    Clay,
    /// Colours that are to be read against a scale: gentle contrast, no highlight, no tint.
    Data,
}

struct Light {
    /// Unit direction towards the light, in right, up, backwards.
    towards: [f32; 3],
    colour: Linear,
}

const KEY: Light = Light {
    towards: [-0.4629, 0.6171, 0.6364],
    colour: [0.80, 0.77, 0.73],
};
const FILL: Light = Light {
    towards: [0.7985, 0.0998, 0.5937],
    colour: [0.24, 0.25, 0.27],
};
/// From behind and above: it lifts the outline off the background.
const RIM: Light = Light {
    towards: [0.2408, 0.5619, -0.7914],
    colour: [0.22, 0.24, 0.26],
};
const SKY: Linear = [0.26, 0.27, 0.28];
const GROUND: Linear = [0.19, 0.175, 0.165];

/// The colour in linear light of a surface seen with unit `normal` (right, up, backwards; turned towards the viewer).
pub(crate) fn shade(normal: [f32; 3], colour: Linear, finish: Finish) -> Linear {
    match finish {
        Finish::Clay => clay(normal, colour),
        Finish::Data => {
            // The full brightness belongs to a surface facing the viewer, so that the scale's own colours appear there.
            let light = 0.55 + 0.33 * wrapped(normal, KEY.towards, 0.3) + 0.17 * normal[2].max(0.0);
            colour.map(|channel| (channel * light).min(1.0))
        }
    }
}

fn clay(normal: [f32; 3], colour: Linear) -> Linear {
    let key = wrapped(normal, KEY.towards, 0.25);
    let fill = wrapped(normal, FILL.towards, 0.4);
    let outline = 1.0 - normal[2].clamp(0.0, 1.0);
    let rim = dot(normal, RIM.towards).max(0.0) * outline * outline;
    let above = 0.5 + 0.5 * normal[1];
    let gloss = highlight(normal);
    std::array::from_fn(|channel| {
        let sky = GROUND[channel] + (SKY[channel] - GROUND[channel]) * above;
        let light = KEY.colour[channel] * key + FILL.colour[channel] * fill + sky;
        colour[channel] * light + RIM.colour[channel] * rim + gloss
    })
}

/// A broad highlight: Blinn's half vector between the key light and the viewer.
fn highlight(normal: [f32; 3]) -> f32 {
    const HALF: [f32; 3] = [-0.2559, 0.3411, 0.9045];
    let mut power = dot(normal, HALF).max(0.0);
    for _ in 0..5 {
        power *= power;
    }
    0.05 * power
}

/// Lambert's cosine with its dark edge moved past the terminator by `wrap`.
fn wrapped(normal: [f32; 3], towards: [f32; 3], wrap: f32) -> f32 {
    let lit = ((dot(normal, towards) + wrap) / (1.0 + wrap)).max(0.0);
    // Squaring near zero removes the visible crease where the light ends.
    lit * lit * (1.5 - 0.5 * lit)
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// 8-bit sRGB to linear light (IEC 61966-2-1).
pub(crate) fn to_linear(colour: Rgb) -> Linear {
    colour.map(|channel| {
        let value = f32::from(channel) / 255.0;
        if value <= 0.04045 {
            value / 12.92
        } else {
            ((value + 0.055) / 1.055).powf(2.4)
        }
    })
}

/// One channel of linear light to sRGB between 0 and 1, not rounded.
pub(crate) fn encode(value: f32) -> f32 {
    let value = value.clamp(0.0, 1.0);
    if value <= 0.003_130_8 {
        12.92 * value
    } else {
        1.055 * value.powf(1.0 / 2.4) - 0.055
    }
}

/// Linear light to 8-bit sRGB.
pub(crate) fn to_srgb(colour: Linear) -> Rgb {
    colour.map(|channel| (encode(channel) * 255.0 + 0.5) as u8)
}

/// A table from linear light to 8-bit sRGB, for the many pixels of a picture.
pub(crate) struct SrgbTable(Vec<f32>);

impl SrgbTable {
    const STEPS: usize = 4096;

    /// Tabulates the encoding over the square root of its argument, along which it is nearly straight.
    pub fn new() -> Self {
        let entry = |step| {
            let root = step as f32 / Self::STEPS as f32;
            encode(root * root) * 255.0
        };
        Self((0..=Self::STEPS).map(entry).collect())
    }

    /// As [`to_srgb`], plus `dither` (-0.5 to 0.5) steps before rounding, which hides banding in smooth shades.
    pub fn encode(&self, colour: Linear, dither: f32) -> Rgb {
        colour.map(|channel| {
            let at = channel.clamp(0.0, 1.0).sqrt() * Self::STEPS as f32;
            (self.0[(at + 0.5) as usize] + 0.5 + dither) as u8
        })
    }
}
