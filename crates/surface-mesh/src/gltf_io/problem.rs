//! What can be wrong with a glTF or GLB file.

use std::io;
use std::path::PathBuf;

use nalgebra::Vector3;

use crate::error::point;

/// What is wrong with a glTF or GLB file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GltfProblem {
    /// The first bytes are neither GLB's nor JSON's.
    #[error("this is no glTF: it starts with bytes {start:02x?}, not with \"glTF\" or JSON")]
    WrongMagic {
        /// Up to the first four bytes.
        start: Vec<u8>,
    },
    /// A GLB file of another version.
    #[error("GLB version {version} is not supported; export as glTF 2.0")]
    Version {
        /// The header's version.
        version: u32,
    },
    /// The file is shorter than its headers say.
    #[error(
        "the file is cut short: {part} needs {expected} bytes, {found} are there; fetch or export it again"
    )]
    Truncated {
        /// Which part of the file.
        part: &'static str,
        /// Bytes the header promises.
        expected: u64,
        /// Bytes present.
        found: u64,
    },
    /// A GLB chunk that must not stand here.
    #[error("the GLB chunks are not JSON followed by BIN; export the file again")]
    WrongChunk,
    /// The JSON is malformed, or not that of a glTF file.
    #[error("bad glTF JSON: {cause}")]
    Json {
        /// What the JSON reader said, with line and column.
        cause: serde_json::Error,
    },
    /// The geometry needs an extension this crate does not have.
    #[error("the file requires the extension {name}; export without it")]
    RequiredExtension {
        /// The extension's name.
        name: String,
    },
    /// No mesh in the file.
    #[error("the file has no mesh with triangles")]
    NoMesh,
    /// More than one mesh, so which one is meant is unknown.
    #[error("the file has {} meshes ({}); export only one of them", names.len(), names.join(", "))]
    SeveralMeshes {
        /// Their names.
        names: Vec<String>,
    },
    /// Several nodes place the mesh differently.
    #[error(
        "nodes {first} and {second} place the mesh differently; keep one, or apply the transforms before the export"
    )]
    SeveralPlacements {
        /// Index of a node that uses the mesh.
        first: usize,
        /// Index of another.
        second: usize,
    },
    /// A node is its own ancestor.
    #[error("node {node} is its own ancestor; export the file again")]
    NodeCycle {
        /// Index of the node.
        node: usize,
    },
    /// A node's transform is NaN, infinite, or not an affine map.
    #[error("the transform of node {node} is not a finite affine map")]
    BadTransform {
        /// Index of the node.
        node: usize,
    },
    /// A reference to something that does not exist.
    #[error("{kind} {index} is referred to, but the file has {count}")]
    Missing {
        /// What kind of object.
        kind: &'static str,
        /// The index referred to, from 0.
        index: usize,
        /// How many the file has.
        count: usize,
    },
    /// A primitive of points, lines, strips or fans.
    #[error("primitive {primitive} is not a list of triangles (mode 4); triangulate on export")]
    NotTriangles {
        /// Index of the primitive in the mesh.
        primitive: usize,
    },
    /// A primitive without positions.
    #[error("primitive {primitive} has no POSITION attribute")]
    NoPositions {
        /// Index of the primitive in the mesh.
        primitive: usize,
    },
    /// An accessor's type is not what its use asks for.
    #[error("accessor {accessor} must be {expected}")]
    AccessorType {
        /// Index of the accessor.
        accessor: usize,
        /// What is needed.
        expected: &'static str,
    },
    /// An accessor reads beyond the end of its buffer view.
    #[error(
        "accessor {accessor} reads up to byte {needed} of buffer view {view}, which has {available}"
    )]
    AccessorOutOfBounds {
        /// Index of the accessor.
        accessor: usize,
        /// Index of the buffer view.
        view: usize,
        /// End of the accessor in the view, in bytes.
        needed: u64,
        /// Length of the view, in bytes.
        available: u64,
    },
    /// A buffer view reaches beyond the end of its buffer.
    #[error(
        "buffer view {view} reaches up to byte {needed} of buffer {buffer}, which has {available}"
    )]
    ViewOutOfBounds {
        /// Index of the buffer view.
        view: usize,
        /// Index of the buffer.
        buffer: usize,
        /// End of the view in the buffer, in bytes.
        needed: u64,
        /// Length of the buffer, in bytes.
        available: u64,
    },
    /// A buffer view's stride is smaller than the elements it steps over.
    #[error("buffer view {view} has a stride of {stride} bytes for elements of {element} bytes")]
    BadStride {
        /// Index of the buffer view.
        view: usize,
        /// Its stride, in bytes.
        stride: usize,
        /// The size of an element, in bytes.
        element: usize,
    },
    /// The indices of a sparse accessor do not rise.
    #[error("the sparse indices of accessor {accessor} must rise strictly; entry {entry} does not")]
    SparseOrder {
        /// Index of the accessor.
        accessor: usize,
        /// The first entry that is not above the one before.
        entry: usize,
    },
    /// A sparse accessor replaces an element beyond its count.
    #[error(
        "accessor {accessor} has {count} elements, but its sparse part replaces element {index}"
    )]
    SparseRange {
        /// Index of the accessor.
        accessor: usize,
        /// The element it replaces.
        index: u32,
        /// How many elements the accessor has.
        count: usize,
    },
    /// The file asks for far more memory than its size can justify.
    #[error("the file's {file} bytes ask for {needed} bytes of geometry; its counts are damaged")]
    Unbacked {
        /// Memory the counts ask for, in bytes.
        needed: u64,
        /// Size of the file and its buffers, in bytes.
        file: u64,
    },
    /// The number of indices is no multiple of three.
    #[error(
        "primitive {primitive} has {count} indices or vertices in its triangle list, which is no multiple of 3"
    )]
    IndexCount {
        /// Index of the primitive in the mesh.
        primitive: usize,
        /// How many indices it has.
        count: usize,
    },
    /// A triangle names a vertex that does not exist.
    #[error(
        "triangle {triangle} of primitive {primitive} names vertex {index}, but there are {vertices}"
    )]
    IndexOutOfRange {
        /// Index of the primitive in the mesh.
        primitive: usize,
        /// Index of the triangle in the primitive.
        triangle: usize,
        /// The vertex it names.
        index: u32,
        /// Vertices of the primitive.
        vertices: usize,
    },
    /// The primitives of the mesh differ in their number of morph targets.
    #[error("primitive {primitive} has {found} morph targets, primitive 0 has {expected}")]
    TargetCount {
        /// Index of the primitive in the mesh.
        primitive: usize,
        /// Targets of the first primitive.
        expected: usize,
        /// Targets of this one.
        found: usize,
    },
    /// A morph target has not one delta per vertex.
    #[error(
        "morph target {target} of primitive {primitive} has {found} deltas for {expected} vertices"
    )]
    TargetLength {
        /// Index of the primitive in the mesh.
        primitive: usize,
        /// Index of the target.
        target: usize,
        /// Vertices of the primitive.
        expected: u64,
        /// Deltas given.
        found: u64,
    },
    /// Another number of names than of morph targets.
    #[error("mesh.extras.targetNames has {names} names for {targets} morph targets")]
    TargetNames {
        /// Names given.
        names: usize,
        /// Targets of the mesh.
        targets: usize,
    },
    /// A position or delta is NaN or infinite.
    #[error(
        "element {element} of accessor {accessor} is not finite: {}",
        point(value)
    )]
    NonFinite {
        /// Index of the accessor.
        accessor: usize,
        /// Index of the element: the vertex within its primitive.
        element: usize,
        /// Its value.
        value: Vector3<f64>,
    },
    /// The node transform takes a vertex out of the range of numbers.
    #[error("the node's transform moves vertex {vertex} to infinity")]
    TransformOverflow {
        /// Index of the vertex, from 0.
        vertex: usize,
    },
    /// More vertices or triangle corners than 32-bit indices can name.
    #[error("more vertices or triangle corners than 32-bit indices can name; split the mesh")]
    TooLarge,
    /// A buffer without URI that is not the GLB's binary chunk.
    #[error("buffer {buffer} has no uri and the file has no binary chunk for it")]
    NoBinaryChunk {
        /// Index of the buffer.
        buffer: usize,
    },
    /// A buffer's URI is neither `data:` nor the name of a file in or below the folder of this one.
    #[error(
        "buffer {buffer} has the uri {uri:?}; only base64 data: URIs and files in or below the folder of the glTF file are read: put the file there"
    )]
    BufferUri {
        /// Index of the buffer.
        buffer: usize,
        /// The start of its URI.
        uri: String,
    },
    /// A `data:` URI with damaged base64.
    #[error("the base64 text of buffer {buffer} is damaged at character {offset}")]
    Base64 {
        /// Index of the buffer.
        buffer: usize,
        /// Offset into the base64 text.
        offset: usize,
    },
    /// A buffer's file could not be read.
    #[error("cannot read {} for buffer {buffer}: {cause}", path.display())]
    BufferFile {
        /// Index of the buffer.
        buffer: usize,
        /// The file.
        path: PathBuf,
        /// What the system said.
        cause: io::Error,
    },
    /// A buffer holds fewer bytes than it declares.
    #[error(
        "buffer {buffer} declares {declared} bytes, {found} are there; fetch or export the file again"
    )]
    BufferTruncated {
        /// Index of the buffer.
        buffer: usize,
        /// Bytes declared.
        declared: u64,
        /// Bytes present.
        found: u64,
    },
}
