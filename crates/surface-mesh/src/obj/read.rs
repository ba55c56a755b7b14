//! OBJ in: positions and faces, in file order.

use std::borrow::Cow;
use std::io::BufRead;
use std::path::Path;

use nalgebra::Vector3;

use crate::{ObjProblem, Surface, SurfaceError};

/// Reads positions and polygons of an OBJ file.
///
/// Vertices keep their order and are never dropped or merged; polygons keep their corners. Texture coordinates, normals,
/// vertex colours, groups, materials, lines and free-form geometry are skipped.
///
/// # Errors
/// [`SurfaceError::Read`], or [`SurfaceError::Obj`] with the line.
pub fn read_obj(path: impl AsRef<Path>) -> Result<Surface, SurfaceError> {
    let path = path.as_ref();
    let text = std::fs::read(path).map_err(|cause| SurfaceError::Read {
        path: path.into(),
        cause,
    })?;
    parse_obj(&text, path)
}

/// As [`read_obj`], from the content of a file that is at hand already, say from an archive; `path` is what errors call it.
///
/// # Errors
/// [`SurfaceError::Obj`] with the line.
pub fn parse_obj(text: &[u8], path: impl AsRef<Path>) -> Result<Surface, SurfaceError> {
    parse(text).map_err(|(line, problem)| SurfaceError::Obj {
        path: path.as_ref().into(),
        line,
        problem,
    })
}

/// A problem and the line it is on.
type Located = (usize, ObjProblem);

fn parse(text: &[u8]) -> Result<Surface, Located> {
    let mut obj = Obj::default();
    let mut lines = Lines::new(text);
    while let Some((line, content)) = lines.next() {
        obj.statement(line, &content)
            .map_err(|problem| (line, problem))?;
    }
    obj.finish(lines.line)
}

/// Statements without effect on positions and faces: the keywords of the format's specification.
const SKIPPED: [&[u8]; 37] = [
    b"vt",
    b"vn",
    b"vp",
    b"g",
    b"o",
    b"s",
    b"usemtl",
    b"mtllib",
    b"l",
    b"p",
    b"mg",
    b"bevel",
    b"c_interp",
    b"d_interp",
    b"lod",
    b"shadow_obj",
    b"trace_obj",
    b"ctech",
    b"stech",
    b"cstype",
    b"deg",
    b"bmat",
    b"step",
    b"curv",
    b"curv2",
    b"surf",
    b"parm",
    b"trim",
    b"hole",
    b"scrv",
    b"sp",
    b"end",
    b"con",
    b"maplib",
    b"usemap",
    b"call",
    b"csh",
];

#[derive(Default)]
struct Obj {
    vertices: Vec<Vector3<f64>>,
    corners: Vec<u32>,
    offsets: Vec<u32>,
    /// Corners that named a vertex not read yet, each beyond those before it: line and index from 1. OBJ allows vertices after faces.
    /// If any of the others is missing in the end, so is one of these, on the same line or before it.
    ahead: Vec<(usize, u32)>,
}

impl Obj {
    fn statement(&mut self, line: usize, content: &[u8]) -> Result<(), ObjProblem> {
        let mut words = Words(content);
        match words.next() {
            None => Ok(()),
            Some(b"v") => self.vertex(words),
            Some(b"f" | b"fo") => self.face(line, words),
            Some(keyword) if SKIPPED.contains(&keyword) => not_text(content),
            Some(keyword) => {
                not_text(content)?;
                Err(ObjProblem::UnknownStatement {
                    keyword: shown(keyword),
                })
            }
        }
    }

    fn vertex(&mut self, words: Words) -> Result<(), ObjProblem> {
        let mut position = Vector3::zeros();
        let mut found = 0;
        for word in words {
            // What follows are a weight or colours: not used, but numbers too.
            let value = coordinate(word)?;
            if found < 3 {
                position[found] = value;
            }
            found += 1;
        }
        if found < 3 {
            return Err(ObjProblem::TooFewCoordinates { found });
        }
        if self.vertices.len() >= u32::MAX as usize {
            return Err(ObjProblem::TooLarge);
        }
        self.vertices.push(position);
        Ok(())
    }

    fn face(&mut self, line: usize, words: Words) -> Result<(), ObjProblem> {
        let start = self.corners.len();
        for word in words {
            let corner = self.corner(line, word)?;
            self.corners.push(corner);
        }
        let found = self.corners.len() - start;
        if found < 3 {
            return Err(ObjProblem::TooFewCorners { found });
        }
        let end = u32::try_from(self.corners.len()).map_err(|_| ObjProblem::TooLarge)?;
        self.offsets.push(end);
        Ok(())
    }

    /// The vertex, from 0, that a face corner names.
    fn corner(&mut self, line: usize, word: &[u8]) -> Result<u32, ObjProblem> {
        let bad = || {
            not_text(word)
                .err()
                .unwrap_or(ObjProblem::BadCorner { text: shown(word) })
        };
        let index = match integer(word) {
            Some(index) => index,
            None => first_of_slashed(word).ok_or_else(bad)?,
        };
        let vertices = self.vertices.len();
        let out_of_range = ObjProblem::IndexOutOfRange { index, vertices };
        match index {
            0 => Err(ObjProblem::IndexZero { text: shown(word) }),
            1.. => {
                let index = u32::try_from(index).map_err(|_| out_of_range)?;
                let is_first = self
                    .ahead
                    .last()
                    .is_none_or(|&(_, furthest)| furthest < index);
                if index as usize > vertices && is_first {
                    self.ahead.push((line, index));
                }
                Ok(index - 1)
            }
            _ => usize::try_from(index.unsigned_abs())
                .ok()
                .and_then(|back| vertices.checked_sub(back))
                .map(|vertex| vertex as u32)
                .ok_or(out_of_range),
        }
    }

    fn finish(mut self, last_line: usize) -> Result<Surface, Located> {
        let vertices = self.vertices.len();
        if vertices == 0 {
            return Err((last_line, ObjProblem::NoVertices));
        }
        if self.offsets.is_empty() {
            return Err((last_line, ObjProblem::NoFaces));
        }
        let missing = |&&(_, index): &&(usize, u32)| index as usize > vertices;
        if let Some(&(line, index)) = self.ahead.iter().find(missing) {
            let index = i64::from(index);
            return Err((line, ObjProblem::IndexOutOfRange { index, vertices }));
        }
        self.offsets.insert(0, 0);
        Ok(
            Surface::from_corners(self.vertices, self.corners, self.offsets)
                .expect("every line was checked"),
        )
    }
}

fn coordinate(word: &[u8]) -> Result<f64, ObjProblem> {
    let value = std::str::from_utf8(word)
        .ok()
        .and_then(|text| text.parse::<f64>().ok());
    match value {
        Some(value) if value.is_finite() => Ok(value),
        Some(_) => Err(ObjProblem::NonFinite { text: shown(word) }),
        None => {
            not_text(word)?;
            Err(ObjProblem::BadNumber { text: shown(word) })
        }
    }
}

/// The vertex index of `v/vt`, `v//vn` or `v/vt/vn`.
fn first_of_slashed(word: &[u8]) -> Option<i64> {
    let mut parts = word.split(|&byte| byte == b'/');
    let index = integer(parts.next()?)?;
    let others = |part: &[u8]| part.is_empty() || integer(part).is_some();
    let valid = parts.clone().count() <= 2 && parts.all(others);
    valid.then_some(index)
}

fn integer(word: &[u8]) -> Option<i64> {
    let (negative, digits) = match word {
        [b'-', digits @ ..] => (true, digits),
        [b'+', digits @ ..] => (false, digits),
        digits => (false, digits),
    };
    // 18 digits cannot overflow; a longer index names no vertex anyway.
    if digits.is_empty() || digits.len() > 18 || !digits.iter().all(u8::is_ascii_digit) {
        return None;
    }
    let value = (digits.iter()).fold(0, |value, digit| 10 * value + i64::from(digit - b'0'));
    Some(if negative { -value } else { value })
}

/// Refuses control characters, which tell a binary file from a text in any encoding that OBJ files come in.
fn not_text(content: &[u8]) -> Result<(), ObjProblem> {
    match content
        .iter()
        .find(|byte| byte.is_ascii_control() && !byte.is_ascii_whitespace())
    {
        Some(&byte) => Err(ObjProblem::NotText { byte }),
        None => Ok(()),
    }
}

/// A word for an error message: readable, and of bounded length.
fn shown(word: &[u8]) -> String {
    String::from_utf8_lossy(word).chars().take(40).collect()
}

/// The words of a line, split at white space.
struct Words<'a>(&'a [u8]);

impl<'a> Iterator for Words<'a> {
    type Item = &'a [u8];

    fn next(&mut self) -> Option<&'a [u8]> {
        let start = self.0.iter().position(|byte| !byte.is_ascii_whitespace())?;
        let rest = &self.0[start..];
        let end = rest
            .iter()
            .position(u8::is_ascii_whitespace)
            .unwrap_or(rest.len());
        let (word, rest) = rest.split_at(end);
        self.0 = rest;
        Some(word)
    }
}

/// The statements of a text with their line numbers: comments cut off, lines that end in a backslash joined.
struct Lines<'a> {
    rest: &'a [u8],
    /// Number of the line read last, from 1.
    line: usize,
}

impl<'a> Lines<'a> {
    fn new(text: &'a [u8]) -> Self {
        Self {
            rest: text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text),
            line: 0,
        }
    }

    fn next(&mut self) -> Option<(usize, Cow<'a, [u8]>)> {
        let first = self.physical_line()?;
        let line = self.line;
        let Some(head) = first.strip_suffix(b"\\") else {
            return Some((line, Cow::Borrowed(first)));
        };
        let mut joined = head.to_vec();
        while let Some(next) = self.physical_line() {
            joined.push(b' ');
            match next.strip_suffix(b"\\") {
                Some(head) => joined.extend_from_slice(head),
                None => {
                    joined.extend_from_slice(next);
                    break;
                }
            }
        }
        Some((line, Cow::Owned(joined)))
    }

    /// The next line without comment and trailing white space. A comment that ends in a backslash (a Windows folder, say)
    /// does not continue: joining it would swallow the next statement.
    fn physical_line(&mut self) -> Option<&'a [u8]> {
        if self.rest.is_empty() {
            return None;
        }
        // Standard library scans for a byte are vectorised, `Iterator::position` is not.
        let mut rest = self.rest;
        let length = rest.skip_until(b'\n').expect("a slice is always readable");
        let line = &self.rest[..length];
        self.rest = rest;
        self.line += 1;
        if line.contains(&b'#') {
            return line.split(|&byte| byte == b'#').next();
        }
        Some(line.trim_ascii_end())
    }
}
