//! What can go wrong, where, and how to mend it.

use std::io;
use std::path::PathBuf;

use nalgebra::Vector3;

use crate::{AnimationProblem, GltfProblem, ObjProblem};

/// Why a surface could not be built, read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SurfaceError {
    /// A file could not be opened or read.
    #[error("cannot read {}: {cause}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        #[source]
        cause: io::Error,
    },
    /// A file could not be written; nothing was left behind under its name.
    #[error("cannot write {}: {cause}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system said.
        #[source]
        cause: io::Error,
    },
    /// The file's extension names no known format.
    #[error("{}: unknown surface format; use a file that ends in .obj, .glb or .gltf", path.display())]
    UnknownFormat {
        /// The file.
        path: PathBuf,
    },
    /// An OBJ file is malformed.
    #[error("{}:{line}: {problem}", path.display())]
    Obj {
        /// The file.
        path: PathBuf,
        /// Line number, from 1; for a statement continued over lines, its first.
        line: usize,
        /// What is wrong there.
        problem: ObjProblem,
    },
    /// A glTF or GLB file is malformed, or holds something this crate does not read.
    #[error("{}: {problem}", path.display())]
    Gltf {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        problem: GltfProblem,
    },
    /// A surface needs vertices.
    #[error("the surface has no vertices")]
    NoVertices,
    /// A surface needs polygons.
    #[error("the surface has no polygons")]
    NoPolygons,
    /// More vertices or polygon corners than 32-bit indices can name.
    #[error(
        "{count} vertices or polygon corners are more than 32-bit indices can name; split the surface"
    )]
    TooLarge {
        /// How many there are.
        count: usize,
    },
    /// A vertex position is NaN or infinite.
    #[error("vertex {vertex} is not finite: {}", point(position))]
    NonFiniteVertex {
        /// Index of the vertex, from 0.
        vertex: usize,
        /// Its position.
        position: Vector3<f64>,
    },
    /// A polygon names a vertex that does not exist.
    #[error("polygon {polygon} names vertex {index}, but there are {vertices} vertices (0 to {})", vertices - 1)]
    IndexOutOfRange {
        /// Index of the polygon, from 0.
        polygon: usize,
        /// The vertex it names, from 0.
        index: u32,
        /// How many vertices there are.
        vertices: usize,
    },
    /// A polygon with fewer than three corners.
    #[error("polygon {polygon} has {corners} corners; it needs 3 or more")]
    TooFewCorners {
        /// Index of the polygon, from 0.
        polygon: usize,
        /// How many corners it has.
        corners: usize,
    },
    /// Positions for another number of vertices than the surface has.
    #[error("{found} vertex positions for a surface of {expected} vertices")]
    VertexCount {
        /// Vertices of the surface.
        expected: usize,
        /// Positions given.
        found: usize,
    },
    /// A morph target has not one delta per vertex.
    #[error("morph target {name:?} has {found} deltas for {expected} vertices")]
    TargetLength {
        /// The target's name.
        name: String,
        /// Vertices of the surface.
        expected: usize,
        /// Deltas given.
        found: usize,
    },
    /// A morph target's delta is NaN or infinite.
    #[error("morph target {name:?} has a delta that is not finite, at vertex {vertex}")]
    NonFiniteDelta {
        /// The target's name.
        name: String,
        /// Index of the vertex, from 0.
        vertex: usize,
    },
    /// A per-vertex attribute of another length than the surface.
    #[error("{found} entries of {attribute} for {expected} vertices")]
    AttributeLength {
        /// Which attribute.
        attribute: &'static str,
        /// Vertices of the surface.
        expected: usize,
        /// Entries given.
        found: usize,
    },
    /// A coordinate is too large for a file format of 32-bit floats.
    #[error("{}: vertex {vertex} of {what} is too large for 32-bit floats; use smaller units", path.display())]
    BeyondF32 {
        /// The file being written.
        path: PathBuf,
        /// "the surface", or the morph target's name.
        what: String,
        /// Index of the vertex, from 0.
        vertex: usize,
    },
    /// An animation whose times or targets do not fit.
    #[error("{}: the animation {name:?} {problem}", path.display())]
    Animation {
        /// The file being written.
        path: PathBuf,
        /// The animation's name.
        name: String,
        /// What does not fit.
        problem: AnimationProblem,
    },
    /// A GLB file cannot be larger than 4 GiB.
    #[error("{}: {bytes} bytes do not fit a GLB file, which ends at 4 GiB; write fewer morph targets", path.display())]
    GlbTooLarge {
        /// The file being written.
        path: PathBuf,
        /// How large it would be.
        bytes: u64,
    },
    /// A surface that must enclose a volume has open edges.
    #[error(
        "{file} is not closed: {open_edges} open edges, e.g. between vertices {} {} and {} {}; \
         fill the hole there, or weld the vertices if two sheets only touch",
        edge[0], point(&positions[0]), edge[1], point(&positions[1])
    )]
    NotClosed {
        /// The name the caller gave for the surface.
        file: String,
        /// How many edges are open.
        open_edges: usize,
        /// Vertex indices of one of them, from 0.
        edge: [u32; 2],
        /// Positions of that edge's ends.
        positions: [Vector3<f64>; 2],
    },
}

/// A position as people write it.
pub(crate) fn point(position: &Vector3<f64>) -> String {
    format!("({}, {}, {})", position.x, position.y, position.z)
}
