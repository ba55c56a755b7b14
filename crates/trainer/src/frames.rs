//! Weights over named shapes, frame by frame, from a JSON or CSV file.

use crate::curves;
use crate::error::{Result, TrainerError, file_error, suggestion};
use crate::shapes::{Shape, ShapeSet, read_matching};
use serde::de::{Error as _, MapAccess, Visitor};
use serde::{Deserialize, Deserializer};
use std::borrow::Cow;
use std::collections::HashSet;
use std::fmt;
use std::path::Path;
use std::rc::Rc;
use surface_mesh::MorphedSurface;

/// Where in a file of frames something is wrong; written behind the file's name.
#[derive(Debug, Clone, PartialEq)]
pub enum Place {
    /// The file as a whole.
    File,
    /// A line, from 1.
    Line(usize),
    /// A frame.
    Frame {
        /// Its number, from 1.
        number: usize,
        /// Its name, where it has one.
        name: Option<String>,
    },
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File => Ok(()),
            Self::Line(line) => write!(f, ":{line}"),
            Self::Frame { number, name: None } => write!(f, ", frame {number}"),
            Self::Frame {
                number,
                name: Some(name),
            } => write!(f, ", frame {number} (`{name}`)"),
        }
    }
}

/// What can be wrong with a file of frames, and the mend.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FramesProblem {
    /// Neither CSV nor JSON by its name.
    #[error("frames are read from .csv and .json files; rename it, or save it as one of them")]
    Format,
    /// No frame in it.
    #[error("has no frames: give the weights of one frame at least")]
    Empty,
    /// Not JSON, or JSON of another form.
    #[error(
        "{message}; frames look like {{\"frames\": [{{\"name\": \"a\", \"weights\": {{\"SHAPE\": 0.5}}}}]}}"
    )]
    Json {
        /// What the parser said.
        message: String,
    },
    /// A header that is parted by something else than commas.
    #[error("columns are parted by {found}: save the file with commas between columns")]
    Separator {
        /// What parts them.
        found: &'static str,
    },
    /// A quote that opens and does not close on its line.
    #[error("a quote \" is not closed: close it on the same line")]
    Quote,
    /// A header without a shape.
    #[error("the header names no shape: give one column at least whose name is that of a shape")]
    NoShapes,
    /// A column without a name.
    #[error(
        "column {column} has no name: name the shape that it weighs, or take the column and its comma out"
    )]
    UnnamedColumn {
        /// Its number, from 1.
        column: usize,
    },
    /// One name over two columns.
    #[error("columns {first} and {second} are both called `{name}`: keep one of them")]
    RepeatedColumn {
        /// The name.
        name: String,
        /// Number of the first such column, from 1.
        first: usize,
        /// Number of the second one.
        second: usize,
    },
    /// A row with more or fewer cells than the header has.
    #[error(
        "has {found} cells, but the header has {expected} columns: give one cell for each column"
    )]
    RaggedRow {
        /// Cells of the row.
        found: usize,
        /// Columns of the header.
        expected: usize,
    },
    /// A cell that is no number.
    #[error(
        "`{text}` under `{shape}` is not a number: write weights as numbers from 0 to 1, such as 0.5"
    )]
    NotANumber {
        /// The column's name.
        shape: String,
        /// The cell.
        text: String,
    },
    /// A weight below 0, above 1, or not finite.
    #[error("the weight of `{shape}` is {weight}: weights lie from 0 to 1")]
    OutOfRange {
        /// The shape.
        shape: String,
        /// Its weight.
        weight: f64,
    },
    /// A weight for a shape that does not exist.
    #[error(
        "there is no shape `{name}`; there are: {known}{}",
        suggestion(name, known)
    )]
    UnknownShape {
        /// The name.
        name: String,
        /// The names there are.
        known: String,
    },
}

/// Where a file is wrong, and how.
pub(crate) type Wrong = (Place, FramesProblem);

/// One frame as its file has it: weights by name.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct NamedWeights {
    /// Its name, where the file gives one.
    pub name: Option<String>,
    /// Names of shapes, each once, with their weights.
    pub weights: Vec<(Rc<str>, f64)>,
    /// Where it stands.
    pub place: Place,
}

/// One frame: a weight for every shape.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Its name, where the file gives one.
    pub name: Option<String>,
    /// A weight in [0, 1] for every shape, in the order of the shapes.
    pub weights: Vec<f64>,
}

/// Reads weights over the morph targets of `units`, frame by frame.
///
/// A `.json` file holds `{"frames": [{"name": "a", "weights": {"SHAPE": 0.5}}]}`; shapes that are not named weigh 0, names may be
/// left out, and whatever else stands there is passed over. A `.csv` file has a header with the names
/// of shapes and a line of weights for every frame; a first column called `frame` names the frames, unless a shape is called so.
///
/// # Errors
/// [`TrainerError::File`] when the file cannot be read, and [`TrainerError::Frames`] with the line or frame and the mend: when it does
/// not parse, has no frame, names a shape twice or one that does not exist, or holds a weight that does not lie in [0, 1].
pub fn read_frames(path: &Path, units: &MorphedSurface) -> Result<Vec<Frame>> {
    if !is_frames_file(path) {
        return Err(TrainerError::Frames {
            path: path.to_path_buf(),
            place: Place::File,
            problem: FramesProblem::Format,
        });
    }
    let text = std::fs::read_to_string(path).map_err(file_error("read", path))?;
    parse_frames(&text, path, units)
}

/// As [`read_frames`], from a text; `path` is what errors call it, and CSV by its extension, JSON otherwise.
///
/// # Errors
/// [`TrainerError::Frames`], as [`read_frames`].
pub fn parse_frames(text: &str, path: &Path, units: &MorphedSurface) -> Result<Vec<Frame>> {
    let wrong = |(place, problem)| TrainerError::Frames {
        path: path.to_path_buf(),
        place,
        problem,
    };
    // Spreadsheets begin their files with a mark of the encoding.
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let named = if text.trim().is_empty() {
        Err((Place::File, FramesProblem::Empty))
    } else if has_extension(path, "csv") {
        curves::parse(text, units.target_index("frame").is_none())
    } else {
        parse_json(text)
    };
    let frames = named.and_then(|named| {
        if named.is_empty() {
            return Err((Place::File, FramesProblem::Empty));
        }
        named.into_iter().map(|f| over_units(f, units)).collect()
    });
    frames.map_err(wrong)
}

/// The shapes that frames weigh: the morph targets of a file over the same vertices where one is given, the scene's own otherwise.
///
/// # Errors
/// When the file cannot be read, does not match the surface, or has no targets.
pub fn read_units<'a>(
    file: Option<&Path>,
    inputs: &'a MorphedSurface,
) -> Result<Cow<'a, MorphedSurface>> {
    let Some(file) = file else {
        return Ok(Cow::Borrowed(inputs));
    };
    let targets = read_matching(file, &inputs.surface)?;
    let units = MorphedSurface::new(inputs.surface.clone(), targets)?;
    Ok(Cow::Owned(units))
}

/// Whether a file is one of frames by its name, and no mesh.
pub fn is_frames_file(path: &Path) -> bool {
    is_json(path) || has_extension(path, "csv")
}

/// Whether a file is JSON by its name.
pub fn is_json(path: &Path) -> bool {
    has_extension(path, "json")
}

fn has_extension(path: &Path, wanted: &str) -> bool {
    let extension = path.extension();
    extension.is_some_and(|own| own.eq_ignore_ascii_case(wanted))
}

/// The shapes that frames blend: neutral plus the sum of weight times displacement. Frames without a name are called `frame N`.
pub fn frame_shapes(frames: &[Frame], units: &MorphedSurface, set: ShapeSet) -> Vec<Shape> {
    let shape = |(i, frame): (usize, &Frame)| Shape {
        name: match &frame.name {
            Some(name) => name.clone(),
            None => format!("frame {}", i + 1),
        },
        set,
        positions: units.blend(&frame.weights),
        joint: None,
    };
    frames.iter().enumerate().map(shape).collect()
}

fn over_units(frame: NamedWeights, units: &MorphedSurface) -> std::result::Result<Frame, Wrong> {
    let mut weights = vec![0.0; units.targets.len()];
    for (name, weight) in frame.weights {
        let Some(index) = units.target_index(&name) else {
            let known = units.targets.iter().map(|t| t.name.as_str());
            let known = known.collect::<Vec<_>>().join(", ");
            let name = name.to_string();
            return Err((frame.place, FramesProblem::UnknownShape { name, known }));
        };
        if !(0.0..=1.0).contains(&weight) {
            let shape = name.to_string();
            return Err((frame.place, FramesProblem::OutOfRange { shape, weight }));
        }
        weights[index] = weight;
    }
    let name = frame.name;
    Ok(Frame { name, weights })
}

#[derive(Deserialize)]
struct JsonFile {
    frames: Vec<JsonFrame>,
}

#[derive(Deserialize)]
struct JsonFrame {
    name: Option<String>,
    weights: JsonWeights,
}

/// Weights by name. A map of the standard library would keep the last of two entries of one name, and say nothing.
struct JsonWeights(Vec<(Rc<str>, f64)>);

impl<'de> Deserialize<'de> for JsonWeights {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        struct Entries;
        impl<'de> Visitor<'de> for Entries {
            type Value = JsonWeights;

            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("a table of weights by name")
            }

            fn visit_map<A: MapAccess<'de>>(
                self,
                mut map: A,
            ) -> std::result::Result<JsonWeights, A::Error> {
                let mut weights: Vec<(Rc<str>, f64)> = Vec::new();
                while let Some(name) = map.next_key::<String>()? {
                    weights.push((name.into(), map.next_value()?));
                }
                let mut seen = HashSet::new();
                match weights.iter().find(|(name, _)| !seen.insert(name)) {
                    Some((name, _)) => Err(A::Error::custom(format!(
                        "`{name}` stands twice in one frame: keep one of them"
                    ))),
                    None => Ok(JsonWeights(weights)),
                }
            }
        }
        deserializer.deserialize_map(Entries)
    }
}

/// Frames of a JSON text.
fn parse_json(text: &str) -> std::result::Result<Vec<NamedWeights>, Wrong> {
    let file: JsonFile = serde_json::from_str(text).map_err(|error| {
        let all = error.to_string();
        // The line goes where other lines stand.
        let message = all.rsplit_once(" at line ").map_or(&*all, |parts| parts.0);
        let message = message.to_string();
        (Place::Line(error.line()), FramesProblem::Json { message })
    })?;
    let frames = file.frames.into_iter().enumerate();
    let named = frames.map(|(i, frame)| NamedWeights {
        place: Place::Frame {
            number: i + 1,
            name: frame.name.clone(),
        },
        name: frame.name,
        weights: frame.weights.0,
    });
    Ok(named.collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;

    fn read(name: &str, text: &str) -> Result<Vec<Frame>> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        read_frames(&path, &fixture::inputs())
    }

    #[track_caller]
    fn refuses(name: &str, text: &str, parts: &[&str]) {
        let message = read(name, text).unwrap_err().to_string();
        for part in parts.iter().chain([&name]) {
            assert!(message.contains(part), "`{part}` is not in: {message}");
        }
    }

    fn frame(name: Option<&str>, weights: [f64; 3]) -> Frame {
        Frame {
            name: name.map(str::to_string),
            weights: weights.to_vec(),
        }
    }

    #[test]
    fn json_frames_weigh_every_shape() {
        let text = r#"{ "note": "x", "units": "cm", "unit_jaw": { "long": {} }, "frames": [
            { "name": "a", "weights": { "bent": 0.25, "long": 1 }, "jaw": { "rms_cm": 0.0 } },
            { "weights": {} } ] }"#;
        let frames = read("f.json", text).unwrap();
        let expected = [frame(Some("a"), [1.0, 0.25, 0.0]), frame(None, [0.0; 3])];
        assert_eq!(frames, expected);
        let shapes = frame_shapes(&frames, &fixture::inputs(), ShapeSet::HeldOut);
        assert_eq!(shapes[0].name, "a");
        assert_eq!(shapes[0].set, ShapeSet::HeldOut);
        assert_eq!(shapes[1].name, "frame 2");
        assert_eq!(shapes[1].positions, fixture::inputs().surface.vertices());
        let moved = fixture::inputs().blend(&[1.0, 0.25, 0.0]);
        assert_eq!(shapes[0].positions, moved);
    }

    #[test]
    fn json_that_cannot_be_used_is_refused_with_its_place() {
        let one = |weights: &str| {
            format!("{{ \"frames\": [\n{{ \"name\": \"a\", \"weights\": {{ {weights} }} }} ] }}")
        };
        refuses("f.json", "", &["no frames"]);
        refuses("f.json", " \n", &["no frames"]);
        refuses("f.json", "{ \"frames\": [] }", &["no frames"]);
        refuses("f.json", "{ \"frame\": [] }", &["f.json:1", "`frames`"]);
        refuses("f.json", "[1, 2]", &["f.json:1", "\"weights\""]);
        refuses(
            "f.json",
            "{ \"frames\": [\n{} ] }",
            &["f.json:2", "`weights`"],
        );
        refuses(
            "f.json",
            &one("\"long\": NaN"),
            &["f.json:2", "expected value"],
        );
        refuses("f.json", &one("\"long\": 1e999"), &["f.json:2", "range"]);
        refuses("f.json", &one("\"long\": null"), &["f.json:2", "null"]);
        refuses("f.json", &one("\"long\": \"1\""), &["f.json:2", "string"]);
        refuses("f.json", &one("\"long\": [1]"), &["f.json:2", "sequence"]);
        let twice = one("\"long\": 1, \"long\": 0");
        refuses("f.json", &twice, &["f.json:2", "`long`", "twice"]);
        let place = "f.json, frame 1 (`a`): ";
        refuses("f.json", &one("\"long\": 1.01"), &[place, "1.01", "0 to 1"]);
        refuses("f.json", &one("\"long\": -0.1"), &[place, "-0.1"]);
        let meant = "did you mean `long`?";
        refuses(
            "f.json",
            &one("\"lnog\": 1"),
            &[place, "`lnog`", "bent", meant],
        );
        let whole = one("\"long\": 1");
        for length in 1..whole.len() {
            refuses("f.json", &whole[..length], &["f.json:"]);
        }
    }

    #[test]
    fn csv_goes_the_same_way() {
        let frames = read("f.CSV", "\u{feff}frame,bent\r\na,0.5\r\n").unwrap();
        assert_eq!(frames, [frame(Some("a"), [0.0, 0.5, 0.0])]);
        refuses("f.csv", "", &["no frames"]);
        refuses("f.csv", "long,bent\n", &["no frames"]);
        refuses("f.csv", "long\n0\n2\n", &["f.csv:3: ", "`long` is 2"]);
        refuses("f.csv", "long\nnan\n", &["f.csv:2: ", "`long` is NaN"]);
        refuses("f.csv", "long\ninf\n", &["f.csv:2: ", "inf"]);
        let meant = "did you mean `bent`?";
        refuses("f.csv", "long,bend\n0,1\n", &["f.csv:2", "`bend`", meant]);
        refuses("f.txt", "long\n0\n", &[".csv and .json"]);
        refuses("f", "long\n0\n", &[".csv and .json"]);
    }

    #[test]
    fn a_shape_called_frame_is_a_shape() {
        let mut units = fixture::inputs();
        units.targets[0].name = "frame".into();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("f.csv");
        std::fs::write(&path, "frame,bent\n0.5,1\n").unwrap();
        let frames = read_frames(&path, &units).unwrap();
        assert_eq!(frames, [frame(None, [0.5, 1.0, 0.0])]);
        assert!(is_frames_file(&path) && !is_frames_file(Path::new("a.glb")));
        assert!(read_frames(&folder.path().join("absent.csv"), &units).is_err());
    }
}
