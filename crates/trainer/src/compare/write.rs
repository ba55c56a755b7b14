//! The comparison as a table, as JSON, and as pictures.

use super::decoder::Training;
use super::measure::{MethodNumbers, Reached, SetGeometry, SetNumbers, TargetNumbers};
use crate::error::Result;
use crate::files::{write_json, write_whole};
use crate::loss::distances;
use crate::performance::evenly;
use crate::shapes::{Shape, ShapeSet};
use crate::trained::Trained;
use report::{CLAY, Camera, ColourScale, Colours, ContactSheet, Panel};
use serde::Serialize;
use std::path::Path;

/// Frames of each set that the pictures have room for.
const SHOWN_OF_SET: usize = 6;

/// What `comparison.json` holds.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// Name of the scene.
    pub scene: String,
    /// The length unit.
    pub unit: String,
    /// Length of the diagonal of the neutral surface's bounding box.
    pub bbox_diagonal: f64,
    /// Edge length of an element.
    pub element_size: f64,
    /// Elements of the body.
    pub elements: usize,
    /// Vertices of the surface.
    pub vertices: usize,
    /// Shapes of the basis.
    pub basis: usize,
    /// Width of the decoder's hidden layers.
    pub decoder_width: usize,
    /// How the decoder was trained.
    pub decoder_training: Training,
    /// What the targets themselves do not keep.
    pub targets: TargetNumbers,
    /// Field, linear blendshapes, explicit decoder.
    pub methods: [MethodNumbers; 3],
}

/// Frames, and what field, linear blendshapes and decoder make of them.
pub(super) struct Shown<'a> {
    pub frames: &'a [Shape],
    pub reached: [&'a [Reached]; 3],
}

/// The comparison as a Markdown table with notes on what its columns mean.
pub fn markdown(comparison: &Comparison) -> String {
    let mut rows = vec![header(&comparison.unit)];
    let [field, linear, decoder] = &comparison.methods;
    let width = comparison.decoder_width;
    rows.push(row(field.method.into(), field));
    rows.push(row(linear.method.into(), linear));
    rows.push(row(format!("{} (width {width})", decoder.method), decoder));
    rows.push(target_row(&comparison.targets));
    let widths: Vec<usize> = (0..rows[0].len())
        .map(|c| rows.iter().map(|r| r[c].chars().count()).max().unwrap_or(0))
        .collect();
    let mut text = format!(
        "# {}: the field beside linear blendshapes and an explicit decoder\n\n",
        comparison.scene
    );
    for (i, cells) in rows.iter().enumerate() {
        let padded = cells.iter().zip(&widths).enumerate();
        let padded = padded.map(|(c, (cell, &width))| match c {
            0 => format!("{cell:width$}"),
            _ => format!("{cell:>width$}"),
        });
        text += &format!("| {} |\n", padded.collect::<Vec<_>>().join(" | "));
        if i == 0 {
            let rules = widths.iter().enumerate().map(|(c, &width)| match c {
                0 => "-".repeat(width),
                _ => format!("{}:", "-".repeat(width - 1)),
            });
            text += &format!("| {} |\n", rules.collect::<Vec<_>>().join(" | "));
        }
    }
    text.push('\n');
    for note in notes(comparison) {
        text += &format!("- {note}\n");
    }
    text
}

fn header(unit: &str) -> Vec<String> {
    vec![
        "method".into(),
        "numbers stored".into(),
        "training s".into(),
        format!("error {unit}, trained"),
        "held out".into(),
        format!("p99 {unit}, trained"),
        "held out".into(),
        "s per frame".into(),
        "volume change %, trained".into(),
        "held out".into(),
        "crossings, trained".into(),
        "held out".into(),
        "inverted elements".into(),
    ]
}

/// A cell of a number that may be absent.
fn cell<T>(value: Option<T>, write: impl Fn(T) -> String) -> String {
    value.map_or_else(|| "-".into(), write)
}

fn row(name: String, method: &MethodNumbers) -> Vec<String> {
    let sets = [&method.train, &method.held_out].map(Option::as_ref);
    let of = |write: &dyn Fn(&SetNumbers) -> String| sets.map(|set| cell(set, write));
    let both: Vec<&SetNumbers> = sets.into_iter().flatten().collect();
    // Over all frames, whatever their set.
    let mean = |value: &dyn Fn(&SetNumbers) -> Option<f64>| {
        let frames: usize = both.iter().map(|s| s.frames).sum();
        let sum = both.iter().map(|s| Some(value(s)? * s.frames as f64));
        Some(sum.sum::<Option<f64>>()? / frames as f64)
    };
    let mut cells = vec![
        name,
        thousands(method.numbers_stored),
        cell(method.training_seconds, significant),
    ];
    cells.extend(of(&|s| format!("{:.5}", s.weighted_error)));
    cells.extend(of(&|s| format!("{:.5}", s.error_p99)));
    let seconds = mean(&|s| Some(s.seconds_per_frame));
    cells.push(cell(seconds, significant));
    cells.extend(sets.map(|set| cell(set, |s| volumes(&s.geometry))));
    cells.extend(sets.map(|set| cell(set, |s| crossings(&s.geometry))));
    let inverted = mean(&|s| s.inverted_elements);
    cells.push(cell(inverted, |n| format!("{n:.1}")));
    cells
}

fn target_row(targets: &TargetNumbers) -> Vec<String> {
    let sets = [&targets.train, &targets.held_out].map(Option::as_ref);
    let mut cells = vec!["(the targets)".to_string()];
    cells.extend(std::iter::repeat_n("-".to_string(), 7));
    cells.extend(sets.map(|set| cell(set, volumes)));
    cells.extend(sets.map(|set| cell(set, crossings)));
    cells.push("-".into());
    cells
}

fn volumes(geometry: &SetGeometry) -> String {
    format!(
        "{:.2} (max {:.2})",
        geometry.volume_change_percent, geometry.largest_volume_change_percent
    )
}

fn crossings(geometry: &SetGeometry) -> String {
    format!("{:.1}", geometry.crossing_pairs)
}

/// Seconds, however few or many they are.
fn significant(seconds: f64) -> String {
    match seconds {
        s if s < 0.001 => format!("{s:.1e}"),
        s if s < 1.0 => format!("{s:.4}"),
        s if s < 100.0 => format!("{s:.1}"),
        s => format!("{s:.0}"),
    }
}

fn thousands(number: usize) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

fn notes(comparison: &Comparison) -> Vec<String> {
    let Comparison {
        elements,
        element_size,
        unit,
        basis,
        decoder_training: training,
        ..
    } = comparison;
    let count = |set: &Option<SetNumbers>| set.as_ref().map_or(0, |s| s.frames);
    let [field, ..] = &comparison.methods;
    let mut notes = vec![
        format!(
            "{} frames that were trained on, {} others; bounding-box diagonal {:.4} {unit}; {elements} elements of {element_size} {unit}.",
            count(&field.train),
            count(&field.held_out),
            comparison.bbox_diagonal
        ),
        "error: mean distance from the target over the surface, weighted as the loss weights it; p99: the distance that 99 of 100 \
         vertices with a weight do not exceed. Both are means over frames."
            .into(),
        "s per frame: from the descriptor to the surface, a solve from rest included, on this machine. Finding the descriptor is not \
         counted; it is the same for all."
            .into(),
        format!(
            "linear blendshapes: the neutral plus the descriptor's {basis} weights times the basis. Targets that are linear blends of the \
             basis are met by construction, so the error says only how much of a frame lies outside the basis. There is no inside, and \
             nothing that a force, a bone or a contact could act on."
        ),
        format!(
            "explicit decoder: one actuation per element, all {elements} at once; {} steps of stage 1 and {} through the simulator, {} \
             dropped. It is tied to this grid: another element size needs another decoder and another training, where the field is \
             evaluated at any points.",
            training.stage1_steps, training.stage2_steps, training.dropped
        ),
        "volume change: enclosed by the surface, against rest; mean (and largest) of the absolute values. crossings: pairs of triangles \
         that pass through each other and did not at rest, mean per frame. inverted elements: with a sample turned inside out, mean per \
         frame. The last row has the same of the targets: what a method adds to it is its own."
            .into(),
    ];
    for method in &comparison.methods {
        let sets = [&method.train, &method.held_out].into_iter().flatten();
        let failed: usize = sets.filter_map(|s| s.not_converged).sum();
        if failed > 0 {
            let name = method.method;
            notes.push(format!("{name}: {failed} frames did not converge."));
        }
    }
    notes
}

/// Writes `comparison.json`, `comparison.md` and `comparison.png`.
///
/// # Errors
/// When the pictures cannot be drawn or a file cannot be written.
pub(super) fn write(
    folder: &Path,
    trained: &Trained,
    comparison: &Comparison,
    shown: &Shown,
) -> Result<()> {
    let picture = sheet(trained, comparison, shown)?;
    write_whole(&folder.join("comparison.png"), &picture)?;
    write_whole(
        &folder.join("comparison.md"),
        markdown(comparison).as_bytes(),
    )?;
    write_json(&folder.join("comparison.json"), comparison)
}

/// A row of pictures for each of some frames: target, and the methods coloured by their error.
fn sheet(trained: &Trained, comparison: &Comparison, shown: &Shown) -> Result<Vec<u8>> {
    let body = &trained.body;
    let chosen = choose(shown.frames);
    let errors: Vec<[Vec<f64>; 3]> = (chosen.iter())
        .map(|&i| {
            let target = &shown.frames[i].positions;
            shown.reached.map(|r| distances(&r[i].surface, target).2)
        })
        .collect();
    let counted = |errors: &[f64]| -> Vec<f64> {
        let pairs = errors.iter().zip(&body.vertex_weights);
        pairs.filter(|(_, w)| **w > 0.0).map(|(e, _)| *e).collect()
    };
    // What the loss leaves out may be far off and would leave no colour for the rest.
    let all = errors.iter().flatten().flat_map(|e| counted(e));
    let scale = ColourScale::holding(all, comparison.unit.as_str())?;
    let colours: Vec<[Vec<report::Rgb>; 3]> = (errors.iter())
        .map(|methods| methods.each_ref().map(|e| scale.colours(e)))
        .collect();
    let labels: Vec<[[String; 2]; 4]> = (chosen.iter().map(|&i| labels(comparison, i))).collect();
    let (direction, up) = crate::sheets::view(body);
    let targets = chosen.iter().map(|&i| &shown.frames[i].positions);
    let methods = (shown.reached.iter()).flat_map(|r| chosen.iter().map(|&i| &r[i].surface));
    let points = targets.chain(methods).flatten();
    let camera = Camera::framing(points, direction, up)?;
    let title = format!("{}: target, and errors of three methods", comparison.scene);
    let mut sheet = ContactSheet::new(title, camera).columns(4).scale(scale);
    for ((&i, labels), colours) in chosen.iter().zip(&labels).zip(&colours) {
        let panel = |k: usize, vertices, colours| Panel {
            name: &labels[k][0],
            note: &labels[k][1],
            vertices,
            triangles: body.surface.triangles(),
            colours,
        };
        let clay = Colours::Uniform(CLAY);
        sheet = sheet.panel(panel(0, &shown.frames[i].positions, clay));
        for (k, colours) in colours.iter().enumerate() {
            let surface = &shown.reached[k][i].surface;
            sheet = sheet.panel(panel(k + 1, surface, Colours::PerVertex(colours)));
        }
    }
    Ok(sheet.render()?.to_png()?)
}

/// Frames that are shown: some of those held out, then some of those trained on, evenly chosen.
fn choose(frames: &[Shape]) -> Vec<usize> {
    let of = |trained: bool| -> Vec<usize> {
        let set = |i: &usize| (frames[*i].set == ShapeSet::Train) == trained;
        let all: Vec<usize> = (0..frames.len()).filter(set).collect();
        let some = evenly(all.len(), SHOWN_OF_SET);
        some.into_iter().map(|i| all[i]).collect()
    };
    [of(false), of(true)].concat()
}

/// Names and notes of the four pictures of a frame.
fn labels(comparison: &Comparison, frame: usize) -> [[String; 2]; 4] {
    let [field, linear, decoder] = &comparison.methods;
    let of = |method: &MethodNumbers| {
        let numbers = &method.frames[frame];
        let name = match numbers.converged {
            Some(false) => format!("{}, NOT CONVERGED", method.method),
            _ => method.method.to_string(),
        };
        let (error, unit) = (numbers.weighted_error, &comparison.unit);
        [name, format!("error {error:.4} {unit}")]
    };
    let target = &field.frames[frame];
    let set = target.set.label().to_string();
    [
        [target.name.clone(), set],
        of(field),
        of(linear),
        of(decoder),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_written_to_be_read() {
        let written = [0, 999, 1000, 28_334, 1_234_567].map(thousands);
        assert_eq!(written, ["0", "999", "1,000", "28,334", "1,234,567"]);
        let written = [2.34e-5, 0.018_52, 3.21, 361.4].map(significant);
        assert_eq!(written, ["2.3e-5", "0.0185", "3.2", "361"]);
    }

    #[test]
    fn pictures_are_chosen_from_both_sets() {
        let frame = |set| Shape {
            name: "a".into(),
            set,
            positions: Vec::new(),
            joint: None,
        };
        let mut frames = vec![frame(ShapeSet::Train); 40];
        frames.extend(vec![frame(ShapeSet::HeldOut); 3]);
        let chosen = choose(&frames);
        assert_eq!(chosen[..4], [40, 41, 42, 0]);
        assert_eq!(chosen.len(), 3 + SHOWN_OF_SET);
        assert_eq!(choose(&frames[..2]), [0, 1]);
    }
}
