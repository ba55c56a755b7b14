//! Paths of codes, from shape to shape.

use super::Wanted;
use crate::error::{Result, TrainerError};
use crate::shapes::{Shape, ShapeSet, Shapes};
use nalgebra::Vector3;
use surface_mesh::MorphedSurface;

/// Name of the zero code in a path, unless a shape is called so.
const NEUTRAL: &str = "neutral";
/// What may be given as a path.
const PATH_MEND: &str = "write A:B:N, the names of two shapes or more (or `neutral`) and the frames from each to the next, 2 or more";

/// Shapes whose codes are run through, `A:B:N` on the command line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CodePath {
    /// Names of the shapes, two or more; `neutral` is the zero code, unless a shape is called so.
    pub shapes: Vec<String>,
    /// Frames from one shape to the next, both ends counted.
    pub frames: usize,
}

impl CodePath {
    /// Reads `A:B:N` or `A:B:C:N`.
    ///
    /// # Errors
    /// When it is no list of two names or more and a number of frames, 2 or more.
    pub fn parse(text: &str) -> Result<Self> {
        let mut parts: Vec<&str> = text.split(':').map(str::trim).collect();
        let frames = parts.pop().and_then(|n| n.parse().ok());
        match frames {
            Some(frames) if frames >= 2 && parts.len() >= 2 && !parts.contains(&"") => Ok(Self {
                shapes: parts.into_iter().map(str::to_string).collect(),
                frames,
            }),
            _ => Err(TrainerError::Option {
                option: "--blend",
                text: text.to_string(),
                mend: PATH_MEND,
            }),
        }
    }

    /// Frames of the whole path; a shape between two legs is one frame.
    pub fn frame_count(&self) -> usize {
        (self.shapes.len() - 1)
            .saturating_mul(self.frames - 1)
            .saturating_add(1)
    }
}

/// Codes along a path, with the linear blends of the shapes to measure against.
pub(super) fn along(
    path: &CodePath,
    units: &MorphedSurface,
    shapes: &Shapes,
) -> Result<Vec<Wanted>> {
    let mut stations = Vec::with_capacity(path.shapes.len());
    for name in &path.shapes {
        stations.push(match units.target_index(name) {
            Some(index) => {
                let positions = units.shape(index);
                let descriptor = shapes.descriptor(&positions)?;
                (name, positions, descriptor)
            }
            None if name == NEUTRAL => {
                let descriptor = vec![0.0; shapes.descriptor_size()];
                (name, units.surface.vertices().to_vec(), descriptor)
            }
            None => return Err(unknown_station(name, units)),
        });
    }
    let mut wanted = Vec::with_capacity(path.frame_count());
    for (leg, pair) in stations.windows(2).enumerate() {
        let [(from, a, code_a), (to, b, code_b)] = pair else {
            unreachable!("windows of two");
        };
        // The first frame of a later leg is the last one of the leg before.
        for i in usize::from(leg > 0)..path.frames {
            let t = i as f64 / (path.frames - 1) as f64;
            let name = match i {
                0 => from.to_string(),
                i if i + 1 == path.frames => to.to_string(),
                _ => format!("{:.2} {from} + {t:.2} {to}", 1.0 - t),
            };
            let positions: Vec<Vector3<f64>> = a.iter().zip(b).map(|(a, b)| a.lerp(b, t)).collect();
            let set = ShapeSet::Blend;
            let shape = Shape {
                name,
                set,
                positions,
                joint: None,
            };
            let t = t as f32;
            let code = code_a.iter().zip(code_b);
            wanted.push((shape, code.map(|(a, b)| (1.0 - t) * a + t * b).collect()));
        }
    }
    Ok(wanted)
}

fn unknown_station(name: &str, units: &MorphedSurface) -> TrainerError {
    let known = units.targets.iter().map(|t| t.name.as_str());
    let known: Vec<&str> = known.chain([NEUTRAL]).collect();
    TrainerError::UnknownShape {
        place: "`--blend`".to_string(),
        name: name.to_string(),
        known: known.join(", "),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;

    #[test]
    fn paths_parse() {
        let path = CodePath::parse("long : bent:5").unwrap();
        assert_eq!(path.shapes, ["long", "bent"]);
        assert_eq!((path.frames, path.frame_count()), (5, 5));
        assert_eq!(CodePath::parse("a:b:c:3").unwrap().frame_count(), 5);
        for bad in [
            "", "a", "a:b", "a:5", ":b:5", "a::5", "a:b:1", "a:b:0", "a:b:-3", "a:b:2.5", "a:b:x",
        ] {
            let message = CodePath::parse(bad).unwrap_err().to_string();
            assert!(message.contains(&format!("`--blend {bad}`")), "{message}");
            assert!(message.contains("A:B:N"), "{message}");
        }
    }

    #[test]
    fn a_path_goes_straight_through_the_codes() {
        let scene = fixture::scene("");
        let shapes = fixture::shapes(&scene, &fixture::body(&scene));
        let units = fixture::inputs();
        let path = CodePath::parse("neutral:long:bent:3").unwrap();
        let wanted = along(&path, &units, &shapes).unwrap();
        let names: Vec<&str> = wanted.iter().map(|w| w.0.name.as_str()).collect();
        let between = ["0.50 neutral + 0.50 long", "0.50 long + 0.50 bent"];
        assert_eq!(names, ["neutral", between[0], "long", between[1], "bent"]);
        let expected = [[0.0, 0.0], [0.5, 0.0], [1.0, 0.0], [0.5, 0.5], [0.0, 1.0]];
        for ((shape, code), expected) in wanted.iter().zip(expected) {
            for (found, expected) in code.iter().zip(expected) {
                assert!((found - expected).abs() < 1e-4, "{}: {code:?}", shape.name);
            }
            let [long, bent] = expected.map(f64::from);
            let linear = units.blend(&[long, bent, 0.0]);
            let far = shape
                .positions
                .iter()
                .zip(&linear)
                .map(|(a, b)| (a - b).norm());
            assert!(far.fold(0.0, f64::max) < 1e-12);
        }
        let path = CodePath::parse("neutral:lnog:3").unwrap();
        let message = along(&path, &units, &shapes).unwrap_err().to_string();
        assert!(message.contains("did you mean `long`?"), "{message}");
    }
}
