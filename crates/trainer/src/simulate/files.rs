//! The files of a simulation: a sheet of pictures, an animated mesh, the numbers.

use super::{Simulated, SimulatedFrame, Variant, selected};
use crate::body::Body;
use crate::error::Result;
use crate::files::{write_json, write_whole};
use crate::motion::MotionSettings;
use crate::performance::evenly;
use crate::scene::Scene;
use crate::shapes::difference;
use nalgebra::Vector3;
use pd_solver::{EffectSpec, Obstacle, Status};
use report::{CLAY, Camera, Colours, ContactSheet, Panel, Rgb};
use serde::Serialize;
use surface_mesh::{FrameAnimation, MorphTarget, MorphedSurface, write_animated_glb};

/// Frames that a row of the sheet has room for.
const COLUMNS: usize = 5;
/// Width of a picture, in pixels: as wide as its note.
const PANEL_WIDTH: usize = 320;
/// Colour of what the body may touch.
const OBSTACLE: Rgb = [110, 135, 165];
/// Half the edge of the square that stands for a plane, in diagonals of the body.
const PLANE: f64 = 0.6;

/// What `simulation.json` holds.
#[derive(Serialize)]
struct Numbers<'a> {
    scene: &'a str,
    unit: &'a str,
    bbox_diagonal: f64,
    element_size: f64,
    elements: usize,
    nodes: usize,
    rate: f64,
    variants: &'a [Variant],
}

/// A mesh to be drawn: the surface, what is touched, and their colours.
struct Drawn {
    vertices: Vec<Vector3<f64>>,
    triangles: Vec<[u32; 3]>,
    colours: Vec<Rgb>,
}

/// Draws the pictures and writes all files; `simulation.json` comes last.
///
/// # Errors
/// When a picture cannot be drawn or a file not be written.
pub(super) fn write(
    scene: &Scene,
    motion: &MotionSettings,
    body: &Body,
    simulated: &Simulated,
) -> Result<()> {
    let sheet = sheet(scene, motion, body, simulated)?;
    let folder = &simulated.folder;
    write_whole(&folder.join("sheet.png"), &sheet)?;
    let frames = &simulated.variants[0].frames;
    let targets = frames.iter().map(|frame| MorphTarget {
        name: format!("frame {:04}", frame.frame),
        deltas: difference(&frame.surface, body.surface.vertices()),
    });
    let morphed = MorphedSurface::new(body.surface.clone(), targets.collect())?;
    let animation = FrameAnimation {
        name: "simulation".into(),
        times: frames.iter().map(|f| f.time).collect(),
        smooth: true,
    };
    write_animated_glb(folder.join("animation.glb"), &morphed, &animation)?;
    let numbers = Numbers {
        scene: &scene.name,
        unit: &scene.unit,
        bbox_diagonal: body.diagonal,
        element_size: body.mesh.element_size(),
        elements: body.mesh.elements().len(),
        nodes: body.mesh.nodes().len(),
        rate: motion.rate,
        variants: &simulated.variants,
    };
    write_json(&folder.join("simulation.json"), &numbers)
}

/// A row of frames with all effects, and below it one without some.
fn sheet(
    scene: &Scene,
    motion: &MotionSettings,
    body: &Body,
    simulated: &Simulated,
) -> Result<Vec<u8>> {
    let rest = body.surface.vertices();
    let shown = match &motion.shown {
        Some(region) => selected(region, rest, body, "shown")?,
        None => vec![true; rest.len()],
    };
    let frames = evenly(motion.frames, COLUMNS);
    let (mut drawn, mut framed) = (Vec::new(), Vec::new());
    for variant in &simulated.variants {
        for &i in &frames {
            let frame = &variant.frames[i];
            let touched = &simulated.obstacle_triangles;
            drawn.push((label(variant, frame), draw(scene, body, touched, frame)));
            let surface = frame.surface.iter().zip(&shown);
            framed.extend(surface.filter(|(_, shown)| **shown).map(|(x, _)| *x));
        }
    }
    let (mut direction, up) = crate::sheets::view(body);
    if let Some(view) = motion.view {
        direction = view.into();
    }
    let camera = Camera::framing(framed.iter(), direction, up)?;
    let mut sheet = ContactSheet::new(scene.name.clone(), camera)
        .columns(frames.len())
        .panel_width(PANEL_WIDTH);
    for ([name, note], drawn) in &drawn {
        sheet = sheet.panel(Panel {
            name,
            note,
            vertices: &drawn.vertices,
            triangles: &drawn.triangles,
            colours: Colours::PerVertex(&drawn.colours),
        });
    }
    Ok(sheet.render()?.to_png()?)
}

fn label(variant: &Variant, frame: &SimulatedFrame) -> [String; 2] {
    let name = match variant.without.is_empty() {
        true => format!("{:.2} s", frame.time),
        false => format!("{:.2} s, no {}", frame.time, variant.without.join(", ")),
    };
    // Adding zero takes the sign off what rounds to it.
    let change = (10.0 * frame.geometry.volume_change_percent).round() / 10.0 + 0.0;
    let mut notes = vec![format!("volume {change:+.1} %")];
    let crossings = frame.geometry.crossing_pairs + frame.obstacle_pairs.unwrap_or(0);
    if crossings > 0 {
        notes.push(format!("{crossings} crossings"));
    }
    if frame.inverted_elements > 0 {
        notes.push(format!("{} inverted", frame.inverted_elements));
    }
    if frame.status != Status::Converged {
        notes.push("NOT CONVERGED".into());
    }
    [name, notes.join(", ")]
}

fn draw(scene: &Scene, body: &Body, touched: &[[u32; 3]], frame: &SimulatedFrame) -> Drawn {
    let mut vertices = frame.surface.clone();
    let mut triangles = body.surface.triangles().to_vec();
    let mut colours = vec![CLAY; vertices.len()];
    let first = vertices.len() as u32;
    vertices.extend_from_slice(&frame.obstacles);
    triangles.extend(touched.iter().map(|t| t.map(|v| v + first)));
    for effect in &scene.effects {
        let EffectSpec::Contact { obstacles, .. } = effect else {
            continue;
        };
        for obstacle in obstacles {
            if let Obstacle::Plane { normal, offset } = obstacle {
                add_plane(
                    body,
                    (*normal).into(),
                    *offset,
                    &mut vertices,
                    &mut triangles,
                );
            }
        }
    }
    colours.resize(vertices.len(), OBSTACLE);
    Drawn {
        vertices,
        triangles,
        colours,
    }
}

/// A square of the plane under the body.
fn add_plane(
    body: &Body,
    normal: Vector3<f64>,
    offset: f64,
    vertices: &mut Vec<Vector3<f64>>,
    triangles: &mut Vec<[u32; 3]>,
) {
    let length = normal.norm();
    let (normal, offset) = (normal / length, offset / length);
    let (min, max) = body.surface.bounding_box();
    let middle = (min + max) / 2.0;
    let foot = middle - normal * (normal.dot(&middle) - offset);
    let across = normal.cross(&Vector3::ith(normal.iamin(), 1.0)).normalize();
    let along = normal.cross(&across);
    let first = vertices.len() as u32;
    let half = PLANE * body.diagonal;
    for (a, b) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
        vertices.push(foot + (across * a + along * b) * half);
    }
    triangles.extend([[0, 1, 2], [0, 2, 3]].map(|t| t.map(|v| v + first)));
}
