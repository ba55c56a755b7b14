//! Everything that can be wrong with the data handed to this crate.

use thiserror::Error;

/// Why a fit could not be set up.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum RigError {
    /// The two point sets of a joint fit differ in length.
    #[error(
        "{from} points cannot be matched with {to}: give one target for each point, in the same order"
    )]
    PointCount {
        /// Number of points before the motion.
        from: usize,
        /// Number of points after the motion.
        to: usize,
    },
    /// A joint fit got no points.
    #[error(
        "a joint cannot be fitted to no points: give at least one, better three that are not in line"
    )]
    NoPoints,
    /// A pivot fit got no motions.
    #[error("a pivot cannot be found from no motions: give at least one that rotates")]
    NoMotions,
    /// A blend basis got no shapes.
    #[error("the basis is empty: give at least one shape")]
    EmptyBasis,
    /// A basis of no shapes, or of more than there are.
    #[error("a basis of {count} cannot be chosen from {shapes} shapes: ask for 1 to {shapes}")]
    BasisCount {
        /// How many were asked for.
        count: usize,
        /// How many there are.
        shapes: usize,
    },
    /// The shapes of a basis have no vertices.
    #[error("the shapes of the basis have no vertices: give one displacement for each vertex")]
    NoVertices,
    /// A shape differs from the first one in its number of vertices.
    #[error(
        "shape {shape} has {found} vertices, shape 0 has {expected}: all shapes must belong to the same mesh, in the same vertex order"
    )]
    ShapeVertexCount {
        /// Index of the shape.
        shape: usize,
        /// Its number of vertices.
        found: usize,
        /// The number of vertices of shape 0.
        expected: usize,
    },
    /// The displacement to be fitted differs from the basis in its number of vertices.
    #[error(
        "the target has {found} vertices, the basis {expected}: both must belong to the same mesh"
    )]
    TargetVertexCount {
        /// Number of vertices of the target.
        found: usize,
        /// Number of vertices of the basis.
        expected: usize,
    },
    /// The vertex weights differ from the basis in number.
    #[error("{found} vertex weights for {expected} vertices: give one for each vertex")]
    VertexWeightCount {
        /// Number of vertex weights.
        found: usize,
        /// Number of vertices of the basis.
        expected: usize,
    },
    /// A vertex weight is negative, infinite or not a number.
    #[error("vertex {vertex} has weight {weight}: weights must be finite and not negative")]
    VertexWeight {
        /// Index of the vertex.
        vertex: usize,
        /// Its weight.
        weight: f64,
    },
    /// All vertex weights are zero.
    #[error("all vertex weights are zero: give at least one vertex a positive weight")]
    NoVertexWeight,
    /// A coordinate of a shape is infinite or not a number.
    #[error(
        "shape {shape}, vertex {vertex}: {value} is not finite: mend the shape before building the basis"
    )]
    NonFiniteShape {
        /// Index of the shape.
        shape: usize,
        /// Index of the vertex.
        vertex: usize,
        /// The offending coordinate.
        value: f64,
    },
    /// The squared displacements of a shape overflow or vanish in double precision.
    #[error("shape {shape} is too large or too small to square: use another length unit")]
    ShapeScale {
        /// Index of the shape.
        shape: usize,
    },
    /// The squared displacements of the target overflow in double precision.
    #[error("the target is too large to square: use another length unit")]
    TargetScale,
    /// A coordinate of a target, point or motion is infinite or not a number.
    #[error(
        "entry {index} of the input has the coordinate {value}, which is not finite: mend or drop that entry"
    )]
    NonFinite {
        /// Index of the vertex, point or motion.
        index: usize,
        /// The offending coordinate.
        value: f64,
    },
    /// There is not one lower and one upper bound for each shape.
    #[error(
        "{lower} lower and {upper} upper bounds for {shapes} shapes: give one of each for every shape"
    )]
    BoundCount {
        /// Number of lower bounds.
        lower: usize,
        /// Number of upper bounds.
        upper: usize,
        /// Number of shapes in the basis.
        shapes: usize,
    },
    /// A lower bound is above the upper one, or the pair leaves no finite weight.
    #[error(
        "shape {shape}: the bounds {lower} to {upper} leave no finite weight: need lower <= upper, neither NaN"
    )]
    CrossedBounds {
        /// Index of the shape.
        shape: usize,
        /// Its lower bound.
        lower: f64,
        /// Its upper bound.
        upper: f64,
    },
    /// The regularisation is negative, infinite or not a number.
    #[error("the regularisation {value} must be finite and not negative; 0 turns it off")]
    Regularisation {
        /// The value given.
        value: f64,
    },
}
