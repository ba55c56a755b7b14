//! The light face model of ICT-FaceKit.

use std::ops::Range;
use std::path::Path;

use surface_mesh::{MorphTarget, Surface, parse_obj};

use crate::close::{Closed, close_holes};
use crate::error::{ImportError, Result};
use crate::jaw::{JawMotions, jaw_json, jaw_motion};
use crate::part::part;
use crate::source::{Origin, Source};
use crate::staging::Staging;
use crate::summary::FaceSummary;
use crate::units::unit_target;

/// Which vertices of the mesh are what, and which expressions there are.
#[derive(Clone, Debug, PartialEq)]
pub struct IctLayout {
    /// Vertices of every mesh.
    pub vertices: usize,
    /// Face, head and neck, mouth socket and eye sockets: the skin. It begins at 0.
    pub skin: Range<usize>,
    /// Gums and tongue.
    pub gums_tongue: Range<usize>,
    /// Upper teeth, which stay with the skull.
    pub teeth_upper: Range<usize>,
    /// Lower teeth, which move with the mandible.
    pub teeth_lower: Range<usize>,
    /// Left eyeball.
    pub eye_left: Range<usize>,
    /// Right eyeball.
    pub eye_right: Range<usize>,
    /// Expressions that must be there. Further ones are taken where they are.
    pub expressions: &'static [&'static str],
}

/// The layout of ICT-FaceKit, from the tables in its README; `expressions` are those of its `vertex_indices.json` less the gaze.
pub const ICT_FACEKIT: IctLayout = IctLayout {
    vertices: 26719,
    skin: 0..14062,
    gums_tongue: 14062..17039,
    teeth_upper: 17039..19247,
    teeth_lower: 19247..21451,
    eye_left: 21451..23021,
    eye_right: 23021..24591,
    expressions: &[
        "browDown_L",
        "browDown_R",
        "browInnerUp_L",
        "browInnerUp_R",
        "browOuterUp_L",
        "browOuterUp_R",
        "cheekPuff_L",
        "cheekPuff_R",
        "cheekSquint_L",
        "cheekSquint_R",
        "eyeBlink_L",
        "eyeBlink_R",
        "eyeSquint_L",
        "eyeSquint_R",
        "eyeWide_L",
        "eyeWide_R",
        "jawForward",
        "jawLeft",
        "jawOpen",
        "jawRight",
        "mouthClose",
        "mouthDimple_L",
        "mouthDimple_R",
        "mouthFrown_L",
        "mouthFrown_R",
        "mouthFunnel",
        "mouthLeft",
        "mouthLowerDown_L",
        "mouthLowerDown_R",
        "mouthPress_L",
        "mouthPress_R",
        "mouthPucker",
        "mouthRight",
        "mouthRollLower",
        "mouthRollUpper",
        "mouthShrugLower",
        "mouthShrugUpper",
        "mouthSmile_L",
        "mouthSmile_R",
        "mouthStretch_L",
        "mouthStretch_R",
        "mouthUpperUp_L",
        "mouthUpperUp_R",
        "noseSneer_L",
        "noseSneer_R",
    ],
};

const ORIGIN: Origin = Origin {
    marker: "FaceXModel/generic_neutral_mesh.obj",
    roots: &["", ".."],
    obtain: "The source is a clone of the GitHub repository ICT-VGL/ICT-FaceKit",
};
const FOLDER: &str = "FaceXModel";
const NEUTRAL: &str = "generic_neutral_mesh";
const LICENCE: &str = "LICENSE";
/// Meshes that are no expressions of the skin: identities, pupils, and the gaze, which turns the eyeballs.
const NO_UNITS: [&str; 4] = [NEUTRAL, "identity", "PupilDilate", "eyeLook"];
/// Shorter deltas are noise of the source: 5 micrometres, in centimetres.
const SHORTEST_DELTA: f64 = 5e-4;
/// Lower teeth that move less are at rest: 0.1 mm, in centimetres.
const JAW_AT_REST: f64 = 0.01;

/// Imports a clone (or a zip file of it) into `out/face_ict`, in centimetres: `neutral_skin.obj` with the cut through the chest closed,
/// `train_units.glb`, `teeth_upper.obj`, `teeth_lower.obj`, `gums_tongue.obj`, `eye_left.obj`, `eye_right.obj`, `jaw_train.json` and
/// `LICENSE-ICT-FaceKit.txt`. The source has neither skull nor mandible.
///
/// # Errors
/// When the source is not there, is incomplete or damaged, has another layout, or the folder exists or cannot be written.
pub fn import_ict_facekit(place: &Path, out: &Path, layout: &IctLayout) -> Result<FaceSummary> {
    let mut source = Source::open(place, ORIGIN)?;
    let staging = Staging::new(out, "face_ict")?;
    let units = unit_names(&source, layout)?;
    let names: Vec<String> = units.iter().map(|unit| mesh_name(unit)).collect();
    source.require(names.iter().map(String::as_str).chain([LICENCE]))?;

    let neutral = read_mesh(&mut source, NEUTRAL, layout)?;
    let path = source.path(&mesh_name(NEUTRAL));
    let skin = part(&neutral, layout.skin.clone(), &path, "skin")?;
    let Closed { surface, holes } = close_holes(&skin, "the skin of the neutral face")?;
    let mut targets = Vec::new();
    let mut jaw = JawMotions::new();
    let mut still = Vec::new();
    for unit in units {
        let moved = read_mesh(&mut source, &unit, layout)?;
        match target(&unit, &neutral, &moved, layout, holes.len()) {
            Some(target) => targets.push(target),
            None => still.push(unit.clone()),
        }
        let teeth = |mesh: &Surface| mesh.vertices()[layout.teeth_lower.clone()].to_vec();
        if let Some(fit) = jaw_motion(&teeth(&neutral), &teeth(&moved), JAW_AT_REST)? {
            jaw.insert(unit, fit);
        }
    }

    for (name, range) in [
        ("gums_tongue", &layout.gums_tongue),
        ("teeth_upper", &layout.teeth_upper),
        ("teeth_lower", &layout.teeth_lower),
        ("eye_left", &layout.eye_left),
        ("eye_right", &layout.eye_right),
    ] {
        let piece = part(&neutral, range.clone(), &path, name)?;
        staging.obj(&format!("{name}.obj"), &piece)?;
    }
    let summary = FaceSummary {
        folder: staging.destination().to_path_buf(),
        vertices: surface.vertex_count(),
        polygons: surface.polygon_count(),
        holes: holes.iter().map(Vec::len).collect(),
        units: targets.len(),
        still,
        millimetres: 10.0,
        jaw,
    };
    staging.obj("neutral_skin.obj", &surface)?;
    staging.glb("train_units.glb", &surface, targets)?;
    staging.json("jaw_train.json", &jaw_json(&summary.jaw, "cm"))?;
    staging.bytes("LICENSE-ICT-FaceKit.txt", &source.read(LICENCE)?)?;
    staging.finish()?;
    Ok(summary)
}

fn mesh_name(stem: &str) -> String {
    format!("{FOLDER}/{stem}.obj")
}

/// The expressions of the layout and those beyond that the source has, in alphabetical order.
fn unit_names(source: &Source, layout: &IctLayout) -> Result<Vec<String>> {
    let files = source.list(FOLDER)?;
    let stems = files.iter().filter_map(|file| file.strip_suffix(".obj"));
    let units = stems.filter(|stem| !NO_UNITS.iter().any(|other| stem.starts_with(other)));
    let mut names: Vec<String> = units
        .chain(layout.expressions.iter().copied())
        .map(String::from)
        .collect();
    names.sort_unstable();
    names.dedup();
    Ok(names)
}

fn read_mesh(source: &mut Source, stem: &str, layout: &IctLayout) -> Result<Surface> {
    let name = mesh_name(stem);
    let path = source.path(&name);
    let mesh = parse_obj(&source.read(&name)?, &path)?;
    if mesh.vertex_count() != layout.vertices {
        return Err(ImportError::VertexCount {
            path,
            found: mesh.vertex_count(),
            expected: layout.vertices,
        });
    }
    Ok(mesh)
}

fn target(
    unit: &str,
    neutral: &Surface,
    moved: &Surface,
    layout: &IctLayout,
    added: usize,
) -> Option<MorphTarget> {
    let (from, to) = (&neutral.vertices(), &moved.vertices());
    let deltas = layout.skin.clone().map(|vertex| to[vertex] - from[vertex]);
    unit_target(unit, deltas, SHORTEST_DELTA, added)
}
