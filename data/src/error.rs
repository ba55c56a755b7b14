//! Everything that can be wrong with the description of a shape or a pose.

use surface_mesh::SurfaceError;
use thiserror::Error;

/// Why a shape could not be built, or a pose does not fit its shape.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ShapeError {
    /// A length is zero, negative, infinite or not a number.
    #[error("`{field}` is {value}: it must be positive and finite")]
    NotPositive {
        /// Name of the field.
        field: &'static str,
        /// Its value.
        value: f64,
    },
    /// A length is too large for the others.
    #[error("`{field}` is {value}: it must be below {limit}, which is {reason}")]
    TooLarge {
        /// Name of the field.
        field: &'static str,
        /// Its value.
        value: f64,
        /// The limit.
        limit: f64,
        /// Where the limit comes from, in terms of the other fields.
        reason: &'static str,
    },
    /// The number of arms is out of range.
    #[error("`arms` is {arms}: a starfish here has {min} to {max} arms")]
    ArmCount {
        /// The number given.
        arms: usize,
        /// The fewest possible.
        min: usize,
        /// The most possible.
        max: usize,
    },
    /// The surface would have more grid cells than the limit.
    #[error(
        "`resolution` is {resolution}: the grid would have {cells:.1e} cells, the limit is {limit:.1e}; choose a larger one"
    )]
    TooFine {
        /// The resolution given.
        resolution: f64,
        /// The number of cells that it needs.
        cells: f64,
        /// The most cells possible.
        limit: f64,
    },
    /// The grid misses a part of the shape, so that the surface is not one closed piece without handles.
    #[error(
        "`resolution` is {resolution}: too coarse for this shape, its surface has Euler characteristic {euler} instead of 2 or is not a solid; choose a smaller one"
    )]
    NotASphere {
        /// The resolution given.
        resolution: f64,
        /// Vertices - edges + triangles.
        euler: i64,
    },
    /// A pose has more arms than the shape.
    #[error(
        "the pose has {given} entries in `arms`, the shape has {arms} arms: drop the last entries"
    )]
    PoseArmCount {
        /// Number of arms in the pose.
        given: usize,
        /// Number of arms of the shape.
        arms: usize,
    },
    /// An angle of a pose is infinite or not a number.
    #[error("`{field}` of arm {arm} is {value}: it must be a finite number of degrees")]
    PoseAngle {
        /// Index of the arm.
        arm: usize,
        /// Name of the field.
        field: &'static str,
        /// Its value.
        value: f64,
    },
    /// The triangles do not make a surface.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
}
