//! glTF and GLB in: one mesh of triangles and its morph targets.

use std::borrow::Cow;
use std::collections::{HashMap, HashSet};
use std::ops::Range;
use std::path::Path;

use gltf::binary::{self, Glb};
use gltf::json::accessor::Accessor;
use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::validation::Checked;
use gltf::json::{Index, Mesh, Root};
use nalgebra::Vector3;

use super::accessor::Source;
use super::buffers;
use super::placement::{Placement, placement};
use crate::{GltfProblem, MorphTarget, MorphedSurface, Surface, SurfaceError};

/// Geometry in memory per byte of file that is still believed. Sparse targets are small in the file and dense in memory:
/// real files of 40 facial targets reach 5, a hundred targets that each move a hundredth of the vertices 60.
const MOST_BYTES_PER_BYTE: u64 = 64;
/// Geometry that a file of any size may ask for, in bytes: in a small file the rule above says little.
const ALWAYS_BELIEVED: u64 = 1 << 20;

/// Reads the mesh of a `.glb` or `.gltf` file with its morph targets; the content, not the extension, tells which it is.
///
/// - The primitives of the mesh are joined in order; primitives that share their vertices in the file share them here.
/// - Target names come from `mesh.extras.targetNames`; without it they are `target_0`, `target_1`, ..
/// - The world transform of the node that uses the mesh is applied to positions, and its linear part to deltas; a mirroring
///   transform also turns the triangles, as glTF asks.
/// - Coordinates are 32-bit floats in the file and exact here; the unit that the file may name is only told.
///
/// # Errors
/// [`SurfaceError::Read`], or [`SurfaceError::Gltf`] for damaged files, several meshes, primitives other than triangle
/// lists, and required extensions (compression).
pub fn read_gltf(path: impl AsRef<Path>) -> Result<MorphedSurface, SurfaceError> {
    let path = path.as_ref();
    let bytes = std::fs::read(path).map_err(|cause| SurfaceError::Read {
        path: path.into(),
        cause,
    })?;
    parse_gltf(&bytes, path)
}

/// As [`read_gltf`], from the content of a file that is at hand already, say from an archive; `path` is what errors call it, and buffers in
/// files of their own are looked for beside it.
///
/// # Errors
/// [`SurfaceError::Gltf`].
pub fn parse_gltf(bytes: &[u8], path: impl AsRef<Path>) -> Result<MorphedSurface, SurfaceError> {
    let path = path.as_ref();
    let folder = path.parent().unwrap_or(Path::new(""));
    parse(bytes, folder).map_err(|problem| SurfaceError::Gltf {
        path: path.into(),
        problem,
    })
}

fn parse(bytes: &[u8], folder: &Path) -> Result<MorphedSurface, GltfProblem> {
    let Container { json, binary_chunk } = split(bytes)?;
    let root: Root =
        gltf::json::deserialize::from_slice(&json).map_err(|cause| GltfProblem::Json { cause })?;
    check_extensions(&root)?;
    let mesh = the_mesh(&root)?;
    let buffers = buffers::load(&root, binary_chunk.as_deref(), folder)?;
    let external: usize = buffers
        .iter()
        .filter(|buffer| matches!(buffer, Cow::Owned(_)))
        .map(|buffer| buffer.len())
        .sum();
    let source = Source {
        root: &root,
        buffers,
        backing: (bytes.len() + external) as u64,
    };
    let parts = parts(&source, mesh)?;
    check_backing(&source, &parts)?;
    let mut joined = Joined::read(&source, &parts)?;
    if let Some(placement) = placement(&root, Index::new(0))? {
        joined.place(&placement)?;
    }
    let mut morphed = joined.finish(mesh)?;
    morphed.unit = stated_unit(&mesh.extras).or(stated_unit(&root.asset.extras));
    Ok(morphed)
}

/// The two halves of a GLB file; a `.gltf` file is JSON only.
struct Container<'a> {
    json: Cow<'a, [u8]>,
    binary_chunk: Option<Cow<'a, [u8]>>,
}

fn split(bytes: &[u8]) -> Result<Container<'_>, GltfProblem> {
    const HEADER: usize = 12;
    let magic = b"glTF";
    if !bytes.starts_with(&magic[..bytes.len().min(4)]) {
        let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        return match text.trim_ascii_start().first() {
            Some(b'{') => Ok(Container {
                json: text.into(),
                binary_chunk: None,
            }),
            _ => Err(GltfProblem::WrongMagic {
                start: bytes[..bytes.len().min(4)].to_vec(),
            }),
        };
    }
    let truncated = |expected: u64| GltfProblem::Truncated {
        part: "the GLB header",
        expected,
        found: bytes.len() as u64,
    };
    let header = bytes.get(..HEADER).ok_or(truncated(HEADER as u64))?;
    let length = u32::from_le_bytes([header[8], header[9], header[10], header[11]]);
    // `Glb::from_slice` subtracts the header's size from this length without looking.
    let content = bytes
        .get(..length as usize)
        .filter(|content| content.len() >= HEADER)
        .ok_or(truncated(length.max(HEADER as u32).into()))?;
    let glb = Glb::from_slice(content).map_err(container_problem)?;
    Ok(Container {
        json: glb.json,
        binary_chunk: glb.bin,
    })
}

fn container_problem(error: gltf::Error) -> GltfProblem {
    match error {
        gltf::Error::Binary(binary::Error::Version(version)) => GltfProblem::Version { version },
        gltf::Error::Binary(binary::Error::ChunkLength {
            ty,
            length,
            length_read,
        }) => GltfProblem::Truncated {
            part: match ty {
                binary::ChunkType::Json => "the JSON chunk",
                binary::ChunkType::Bin => "the binary chunk",
            },
            expected: length.into(),
            found: length_read as u64,
        },
        gltf::Error::Binary(binary::Error::Io(_)) => GltfProblem::Truncated {
            part: "a chunk header",
            expected: 8,
            found: 0,
        },
        _ => GltfProblem::WrongChunk,
    }
}

/// Refuses required extensions, except those that cannot change geometry.
fn check_extensions(root: &Root) -> Result<(), GltfProblem> {
    const HARMLESS: [&str; 4] = [
        "KHR_materials_",
        "KHR_texture_",
        "KHR_lights_",
        "EXT_texture_",
    ];
    let changes_geometry = |name: &&String| !HARMLESS.iter().any(|prefix| name.starts_with(prefix));
    match root.extensions_required.iter().find(changes_geometry) {
        Some(name) => Err(GltfProblem::RequiredExtension { name: name.clone() }),
        None => Ok(()),
    }
}

fn the_mesh(root: &Root) -> Result<&Mesh, GltfProblem> {
    match &root.meshes[..] {
        [] => Err(GltfProblem::NoMesh),
        [mesh] => Ok(mesh),
        meshes => Err(GltfProblem::SeveralMeshes {
            names: meshes
                .iter()
                .enumerate()
                .map(|(i, mesh)| mesh.name.clone().unwrap_or(format!("mesh {i}")))
                .collect(),
        }),
    }
}

/// What a primitive refers to.
struct Part {
    vertices: Vertices,
    indices: Option<Index<Accessor>>,
}

/// Where the vertices of a primitive come from. Primitives that only differ in their triangles share them.
#[derive(PartialEq, Eq, Hash)]
struct Vertices {
    positions: Index<Accessor>,
    /// One per morph target; `None` where it does not move positions.
    targets: Vec<Option<Index<Accessor>>>,
}

fn parts(source: &Source, mesh: &Mesh) -> Result<Vec<Part>, GltfProblem> {
    let mut parts: Vec<Part> = Vec::with_capacity(mesh.primitives.len());
    for (primitive, data) in mesh.primitives.iter().enumerate() {
        let part = part(primitive, data)?;
        if let Some(first) = parts.first()
            && first.vertices.targets.len() != part.vertices.targets.len()
        {
            return Err(GltfProblem::TargetCount {
                primitive,
                expected: first.vertices.targets.len(),
                found: part.vertices.targets.len(),
            });
        }
        check_target_lengths(source, primitive, &part.vertices)?;
        parts.push(part);
    }
    Ok(parts)
}

fn part(primitive: usize, data: &Primitive) -> Result<Part, GltfProblem> {
    if !matches!(data.mode, Checked::Valid(Mode::Triangles)) {
        return Err(GltfProblem::NotTriangles { primitive });
    }
    let positions = data.attributes.get(&Checked::Valid(Semantic::Positions));
    let vertices = Vertices {
        positions: *positions.ok_or(GltfProblem::NoPositions { primitive })?,
        targets: (data.targets.iter().flatten())
            .map(|target| target.positions)
            .collect(),
    };
    Ok(Part {
        vertices,
        indices: data.indices,
    })
}

fn check_target_lengths(
    source: &Source,
    primitive: usize,
    vertices: &Vertices,
) -> Result<(), GltfProblem> {
    let expected = source.count(vertices.positions)?;
    for (target, accessor) in vertices.targets.iter().enumerate() {
        let found = accessor.map_or(Ok(expected), |accessor| source.count(accessor))?;
        if found != expected {
            return Err(GltfProblem::TargetLength {
                primitive,
                target,
                expected,
                found,
            });
        }
    }
    Ok(())
}

/// Refuses counts that ask for far more memory than the file is large, before anything is allocated.
fn check_backing(source: &Source, parts: &[Part]) -> Result<(), GltfProblem> {
    let mut seen = HashSet::new();
    let mut needed = 0_u64;
    for part in parts {
        let vertices = source.count(part.vertices.positions)?;
        let corners = part.indices.map_or(Ok(vertices), |a| source.count(a))?;
        needed = needed.saturating_add(corners.saturating_mul(12));
        if seen.insert(&part.vertices) {
            let shapes = 1 + part.vertices.targets.len() as u64;
            needed = needed.saturating_add(vertices.saturating_mul(24).saturating_mul(shapes));
        }
    }
    let believed = source.backing.saturating_mul(MOST_BYTES_PER_BYTE);
    if needed > believed.max(ALWAYS_BELIEVED) {
        return Err(GltfProblem::Unbacked {
            needed,
            file: source.backing,
        });
    }
    Ok(())
}

/// The primitives read so far, as one.
#[derive(Default)]
struct Joined {
    vertices: Vec<Vector3<f64>>,
    deltas: Vec<Vec<Vector3<f64>>>,
    triangles: Vec<[u32; 3]>,
}

impl Joined {
    fn read(source: &Source, parts: &[Part]) -> Result<Self, GltfProblem> {
        let mut joined = Self::default();
        if let Some(first) = parts.first() {
            joined
                .deltas
                .resize(first.vertices.targets.len(), Vec::new());
        }
        let mut ranges: HashMap<&Vertices, Range<usize>> = HashMap::new();
        for (primitive, part) in parts.iter().enumerate() {
            let range = match ranges.get(&part.vertices) {
                Some(range) => range.clone(),
                None => joined.append_vertices(source, &part.vertices)?,
            };
            joined.append_triangles(source, primitive, part.indices, &range)?;
            ranges.insert(&part.vertices, range);
        }
        Ok(joined)
    }

    fn append_vertices(
        &mut self,
        source: &Source,
        vertices: &Vertices,
    ) -> Result<Range<usize>, GltfProblem> {
        let start = self.vertices.len();
        source.append_vectors(vertices.positions, &mut self.vertices)?;
        let end = self.vertices.len();
        if u32::try_from(end).is_err() {
            return Err(GltfProblem::TooLarge);
        }
        for (deltas, accessor) in self.deltas.iter_mut().zip(&vertices.targets) {
            match accessor {
                Some(accessor) => source.append_vectors(*accessor, deltas)?,
                None => deltas.resize(end, Vector3::zeros()),
            }
        }
        Ok(start..end)
    }

    /// Appends the triangles of a primitive over the vertices in `range`.
    fn append_triangles(
        &mut self,
        source: &Source,
        primitive: usize,
        indices: Option<Index<Accessor>>,
        range: &Range<usize>,
    ) -> Result<(), GltfProblem> {
        let vertices = range.len();
        let indices = match indices {
            Some(accessor) => source.indices(accessor)?,
            None => (0..vertices as u32).collect(),
        };
        let (triangles, rest) = indices.as_chunks::<3>();
        if !rest.is_empty() {
            return Err(GltfProblem::IndexCount {
                primitive,
                count: indices.len(),
            });
        }
        if let Some(at) = indices.iter().position(|&index| index as usize >= vertices) {
            return Err(GltfProblem::IndexOutOfRange {
                primitive,
                triangle: at / 3,
                index: indices[at],
                vertices,
            });
        }
        let shift = range.start as u32;
        let shifted = |triangle: &[u32; 3]| triangle.map(|index| index + shift);
        self.triangles.extend(triangles.iter().map(shifted));
        Ok(())
    }

    fn place(&mut self, placement: &Placement) -> Result<(), GltfProblem> {
        for (vertex, position) in self.vertices.iter_mut().enumerate() {
            *position = placement.linear * *position + placement.translation;
            if !position.iter().all(|x| x.is_finite()) {
                return Err(GltfProblem::TransformOverflow { vertex });
            }
        }
        for deltas in &mut self.deltas {
            for (vertex, delta) in deltas.iter_mut().enumerate() {
                *delta = placement.linear * *delta;
                if !delta.iter().all(|x| x.is_finite()) {
                    return Err(GltfProblem::TransformOverflow { vertex });
                }
            }
        }
        if placement.mirrors() {
            self.triangles
                .iter_mut()
                .for_each(|triangle| triangle.swap(1, 2));
        }
        Ok(())
    }

    fn finish(self, mesh: &Mesh) -> Result<MorphedSurface, GltfProblem> {
        if self.triangles.is_empty() {
            return Err(GltfProblem::NoMesh);
        }
        let names = target_names(mesh, self.deltas.len())?;
        // Everything else was checked where it was read.
        let surface = Surface::from_triangles(self.vertices, self.triangles)
            .map_err(|_| GltfProblem::TooLarge)?;
        let targets = (names.into_iter().zip(self.deltas))
            .map(|(name, deltas)| MorphTarget { name, deltas })
            .collect();
        Ok(MorphedSurface {
            surface,
            targets,
            unit: None,
        })
    }
}

#[derive(serde::Deserialize)]
struct MeshExtras {
    #[serde(rename = "targetNames")]
    target_names: Vec<String>,
}

/// The entry `units` of extras, where it is a text.
fn stated_unit(extras: &gltf::json::Extras) -> Option<String> {
    #[derive(serde::Deserialize)]
    struct Extras {
        units: String,
    }
    let extras = serde_json::from_str::<Extras>(extras.as_ref()?.get()).ok()?;
    Some(extras.units)
}

fn target_names(mesh: &Mesh, targets: usize) -> Result<Vec<String>, GltfProblem> {
    // Extras are free-form: whatever is not a list of names is somebody else's.
    let extras = (mesh.extras.as_ref())
        .and_then(|extras| serde_json::from_str::<MeshExtras>(extras.get()).ok());
    match extras {
        Some(MeshExtras { target_names }) if target_names.len() == targets => Ok(target_names),
        Some(MeshExtras { target_names }) => Err(GltfProblem::TargetNames {
            names: target_names.len(),
            targets,
        }),
        None => Ok((0..targets).map(|i| format!("target_{i}")).collect()),
    }
}
