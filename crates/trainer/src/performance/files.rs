//! The files of a performance: an animated mesh, a picture of every frame, a contact sheet, and the numbers.

use super::{Performance, PerformedFrame, Source};
use crate::body::Body;
use crate::error::{Result, TrainerError};
use crate::files::{remove, remove_beyond, write_json, write_whole};
use crate::progress::{Phase, stop_requested};
use crate::scene::Scene;
use crate::shapes::difference;
use pd_solver::Status;
use report::{CLAY, Camera, Colours, ContactSheet, Mesh, Panel, render};
use serde::Serialize;
use std::path::Path;
use surface_mesh::{FrameAnimation, MorphTarget, MorphedSurface, write_animated_glb};

/// Name of the folder, below that of the evaluation.
pub(crate) const PERFORMANCE: &str = "performance";
/// Width of a frame's picture, in pixels.
const FRAME_WIDTH: usize = 720;
/// Pictures that a contact sheet has room for.
const SHEET_PANELS: usize = 24;

/// What `performance.json` holds.
#[derive(Serialize)]
struct Numbers<'a> {
    scene: &'a str,
    /// `curves` or `blend`.
    source: &'static str,
    /// What a frame is measured against.
    target: &'static str,
    fps: f64,
    bbox_diagonal: f64,
    unit: &'a str,
    element_size: f64,
    elements: usize,
    frames: &'a [PerformedFrame],
}

/// All pictures, as the bytes of PNG files: nothing is written before everything is drawn.
pub(crate) struct Pictures {
    frames: Vec<Vec<u8>>,
    sheet: Vec<u8>,
}

impl Pictures {
    /// Draws every frame and the contact sheet, all seen by one camera.
    ///
    /// # Errors
    /// When the user stops, or a surface cannot be drawn.
    pub fn draw(scene: &Scene, body: &Body, frames: &[PerformedFrame]) -> Result<Self> {
        let (direction, up) = crate::sheets::view(body);
        let points = frames.iter().flat_map(|f| &f.result.surface);
        let camera = Camera::framing(points, direction, up)?;
        let size = frame_size(&camera);
        let mut phase = Phase::new("pictures", frames.len() as u64, 0);
        let mut pictures = Vec::with_capacity(frames.len());
        for frame in frames {
            if stop_requested() {
                return Err(TrainerError::EvaluationStopped);
            }
            let mesh = Mesh {
                vertices: &frame.result.surface,
                triangles: body.surface.triangles(),
                colours: Colours::Uniform(CLAY),
            };
            pictures.push(render(&mesh, &camera, size[0], size[1])?.to_png()?);
            phase.step(|| frame.result.name.clone());
        }
        let sheet = contact_sheet(scene, body, frames, camera)?;
        phase.finish(&format!("{} frames drawn", frames.len()));
        Ok(Self {
            frames: pictures,
            sheet,
        })
    }
}

/// Width and height of a picture that the camera's window fills. Both are even, as encoders of films want them.
fn frame_size(camera: &Camera) -> [usize; 2] {
    let fitted = (FRAME_WIDTH as f64 / camera.aspect()).round() as usize;
    let height = fitted.clamp(FRAME_WIDTH / 4, 2 * FRAME_WIDTH);
    [FRAME_WIDTH, height.next_multiple_of(2)]
}

fn contact_sheet(
    scene: &Scene,
    body: &Body,
    frames: &[PerformedFrame],
    camera: Camera,
) -> Result<Vec<u8>> {
    let shown = evenly(frames.len(), SHEET_PANELS);
    let title = match shown.len() == frames.len() {
        true => format!("{}: {} frames", scene.name, frames.len()),
        false => format!("{}: {} of {} frames", scene.name, shown.len(), frames.len()),
    };
    let labels: Vec<[String; 2]> = shown.iter().map(|&i| label(&frames[i])).collect();
    let mut sheet = ContactSheet::new(title, camera);
    for (&i, [name, note]) in shown.iter().zip(&labels) {
        sheet = sheet.panel(Panel {
            name,
            note,
            vertices: &frames[i].result.surface,
            triangles: body.surface.triangles(),
            colours: Colours::Uniform(CLAY),
        });
    }
    Ok(sheet.render()?.to_png()?)
}

/// Name and note of a frame.
fn label(frame: &PerformedFrame) -> [String; 2] {
    let result = &frame.result;
    let unnamed = format!("frame {}", frame.frame);
    let name = match result.name == unnamed {
        true => unnamed,
        false => format!("{}: {}", frame.frame, result.name),
    };
    let mut note = format!("{:.2} % mean", result.mean_error_percent);
    if result.inverted_elements > 0 {
        note += &format!(", {} inverted", result.inverted_elements);
    }
    if result.status != Status::Converged {
        note += ", NOT CONVERGED";
    }
    [name, note]
}

/// At most `room` of `count` indices, evenly spread, the first and the last among them.
pub(crate) fn evenly(count: usize, room: usize) -> Vec<usize> {
    if count <= room {
        return (0..count).collect();
    }
    let place = |i: usize| (i * (count - 1) + (room - 1) / 2) / (room - 1);
    (0..room).map(place).collect()
}

/// Writes all files of a performance and removes the pictures of an earlier one. `performance.json` goes first and comes last: where it
/// is, all files belong together.
///
/// # Errors
/// When a file cannot be written or removed.
pub(crate) fn write(
    scene: &Scene,
    body: &Body,
    performance: &Performance,
    pictures: &Pictures,
) -> Result<()> {
    let folder = &performance.folder;
    let numbers_path = folder.join("performance.json");
    remove(&numbers_path)?;
    write_animation(&folder.join("animation.glb"), body, performance)?;
    for (i, picture) in pictures.frames.iter().enumerate() {
        write_whole(&folder.join(frame_file(i + 1)), picture)?;
    }
    write_whole(&folder.join("contact-sheet.png"), &pictures.sheet)?;
    remove_beyond(folder, "frame", pictures.frames.len(), frame_file)?;
    let (source, target) = match performance.source {
        Source::Curves(_) => ("curves", "linear blend of the frame's shapes"),
        Source::Path(_) => ("blend", "linear blend of the two shapes around the frame"),
    };
    let numbers = Numbers {
        scene: &scene.name,
        source,
        target,
        fps: performance.fps,
        bbox_diagonal: body.diagonal,
        unit: &scene.unit,
        element_size: body.mesh.element_size(),
        elements: body.mesh.elements().len(),
        frames: &performance.frames,
    };
    write_json(&numbers_path, &numbers)
}

fn write_animation(path: &Path, body: &Body, performance: &Performance) -> Result<()> {
    let rest = body.surface.vertices();
    let targets = performance.frames.iter().map(|frame| MorphTarget {
        // The number keeps names apart that a file of curves gives twice.
        name: format!("{:04} {}", frame.frame, frame.result.name),
        deltas: difference(&frame.result.surface, rest),
    });
    let morphed = MorphedSurface::new(body.surface.clone(), targets.collect())?;
    let animation = FrameAnimation {
        name: PERFORMANCE.into(),
        times: performance.frames.iter().map(|f| f.time).collect(),
        smooth: true,
    };
    Ok(write_animated_glb(path, &morphed, &animation)?)
}

fn frame_file(number: usize) -> String {
    format!("frame-{number:04}.png")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;
    use crate::performance::Start;
    use crate::shapes::ShapeSet;

    #[test]
    fn pictures_are_chosen_evenly() {
        assert_eq!(evenly(3, 24), [0, 1, 2]);
        assert_eq!(evenly(24, 24).len(), 24);
        let some = evenly(100, 24);
        assert_eq!((some.len(), some[0], some[23]), (24, 0, 99));
        assert!(some.windows(2).all(|w| (4..=5).contains(&(w[1] - w[0]))));
    }

    #[test]
    fn the_files_of_a_shorter_performance_replace_those_of_a_longer_one() {
        let folder = tempfile::tempdir().unwrap();
        let scene = fixture::scene("");
        let body = fixture::body(&scene);
        let mut performance = Performance {
            frames: Vec::new(),
            source: Source::Curves("f.csv".into()),
            fps: 12.0,
            diagonal: body.diagonal,
            unit: scene.unit.clone(),
            folder: folder.path().to_path_buf(),
        };
        let names = || {
            let files = std::fs::read_dir(folder.path()).unwrap();
            let mut names: Vec<String> = files
                .map(|f| f.unwrap().file_name().into_string().unwrap())
                .collect();
            names.sort();
            names
        };
        let files = |count: usize| {
            let mut names = vec!["animation.glb".into(), "contact-sheet.png".into()];
            names.extend((1..=count).map(frame_file));
            names.push("frame-notes.png".into());
            names.push("performance.json".into());
            names
        };
        // Not a picture of a frame: it stays.
        std::fs::write(folder.path().join("frame-notes.png"), "mine").unwrap();
        for count in [3, 2] {
            performance.frames = (1..=count)
                .map(|frame| {
                    let mut result = fixture::result("same", ShapeSet::Blend);
                    let wide = |x: &nalgebra::Vector3<f64>| x * (1.0 + 0.1 * frame as f64);
                    result.surface = body.surface.vertices().iter().map(wide).collect();
                    PerformedFrame {
                        frame,
                        time: (frame - 1) as f64 / 12.0,
                        start: Start::Rest,
                        result,
                    }
                })
                .collect();
            let pictures = Pictures::draw(&scene, &body, &performance.frames).unwrap();
            write(&scene, &body, &performance, &pictures).unwrap();
            assert_eq!(names(), files(count));
        }
        let text = std::fs::read_to_string(folder.path().join("performance.json")).unwrap();
        let numbers: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!(numbers["frames"][1]["frame"], 2);
        assert_eq!(numbers["frames"][1]["name"], "same");
        assert_eq!(numbers["frames"][1]["start"], "rest");
        assert_eq!(numbers["frames"][1]["status"], "converged");
    }

    #[test]
    fn labels_say_what_is_wrong() {
        let mut frame = PerformedFrame {
            frame: 3,
            time: 0.0,
            start: Start::Rest,
            result: fixture::result("frame 3", ShapeSet::Blend),
        };
        assert_eq!(label(&frame), ["frame 3", "1.00 % mean"]);
        frame.result.name = "grin".into();
        frame.result.inverted_elements = 2;
        frame.result.status = Status::Stalled;
        let note = "1.00 % mean, 2 inverted, NOT CONVERGED";
        assert_eq!(label(&frame), ["3: grin", note]);
    }
}
