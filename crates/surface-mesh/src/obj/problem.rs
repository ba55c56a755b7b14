//! What can be wrong with a line of an OBJ file.

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
