//! What can go wrong, where, and how to mend it.

use std::io;
use std::path::PathBuf;

use nalgebra::Vector3;

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
        cause: io::Error,
    },
    /// A file could not be written; nothing was left behind under its name.
    #[error("cannot write {}: {cause}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system said.
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

/// What is wrong with a line of an OBJ file.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ObjProblem {
    /// A byte that no text file holds.
    #[error("byte {byte:#04x} is not text; is this an OBJ file?")]
    NotText {
        /// The byte.
        byte: u8,
    },
    /// A statement OBJ does not have.
    #[error(
        "unknown statement {keyword:?}; is this an OBJ file? If it is an extension, delete the line"
    )]
    UnknownStatement {
        /// The line's first word.
        keyword: String,
    },
    /// A vertex with fewer than three coordinates.
    #[error("a vertex needs 3 coordinates, found {found}; is the line cut short?")]
    TooFewCoordinates {
        /// How many there are.
        found: usize,
    },
    /// A coordinate that is no number.
    #[error("{text:?} is not a number")]
    BadNumber {
        /// The word found.
        text: String,
    },
    /// A coordinate that is NaN or infinite.
    #[error("{text:?} is not a finite number")]
    NonFinite {
        /// The word found.
        text: String,
    },
    /// A face with fewer than three corners.
    #[error("a face needs 3 corners or more, found {found}; is the line cut short?")]
    TooFewCorners {
        /// How many there are.
        found: usize,
    },
    /// A face corner that is not of the form `v`, `v/vt`, `v//vn` or `v/vt/vn`.
    #[error("{text:?} is not a face corner; expected v, v/vt, v//vn or v/vt/vn with whole numbers")]
    BadCorner {
        /// The word found.
        text: String,
    },
    /// OBJ counts from 1 (or back from -1).
    #[error("vertex index 0 in {text:?}: OBJ counts vertices from 1")]
    IndexZero {
        /// The word found.
        text: String,
    },
    /// A face names a vertex that does not exist.
    #[error("vertex {index} does not exist: there are {vertices} vertices {}",
        if *index < 0 { "before this line" } else { "in the file" })]
    IndexOutOfRange {
        /// The index as written: from 1, or negative back from the line.
        index: i64,
        /// Vertices in the file, or up to this line for a negative index.
        vertices: usize,
    },
    /// The file ends without a vertex.
    #[error("the file ends without any vertex (a line `v x y z`)")]
    NoVertices,
    /// The file ends without a face.
    #[error("the file ends without any face (a line `f v1 v2 v3`)")]
    NoFaces,
    /// More vertices or polygon corners than 32-bit indices can name.
    #[error("more vertices or face corners than 32-bit indices can name; split the file")]
    TooLarge,
}

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
    /// A buffer's URI is neither `data:` nor a relative file name.
    #[error(
        "buffer {buffer} has the uri {uri:?}; only base64 data: URIs and relative file names are read"
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

/// A position as people write it.
pub(crate) fn point(position: &Vector3<f64>) -> String {
    format!("({}, {}, {})", position.x, position.y, position.z)
}
