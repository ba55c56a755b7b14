//! What can go wrong when a problem is set up. A solve that does not converge is not an error: it is a
//! [`Status`](crate::Status) in the result.

use thiserror::Error;

/// Everything that [`Solver`](crate::Solver) refuses, with the place and the mend.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum SolverError {
    /// No elasticity among the effects: nothing would hold the body together.
    #[error("the list of effects has no elasticity: add one `elasticity` effect")]
    NoElasticity,
    /// More than one effect of a kind that can only stand once.
    #[error("effect {index} (`{kind}`) stands twice: merge it with the first one")]
    DuplicateEffect {
        /// Position in the list of effects.
        index: usize,
        /// Kind of the effect, as written in a scene.
        kind: &'static str,
    },
    /// A number of an effect is not finite or out of its range.
    #[error("effect {index}: `{field}` is {value}, expected {expected}")]
    BadValue {
        /// Position in the list of effects.
        index: usize,
        /// The field at fault.
        field: &'static str,
        /// What it held.
        value: f64,
        /// What it may hold.
        expected: &'static str,
    },
    /// A node or element index that the mesh does not have.
    #[error("effect {index}: {what} {found} is out of range, the mesh has {count}")]
    OutOfRange {
        /// Position in the list of effects.
        index: usize,
        /// `node` or `element`.
        what: &'static str,
        /// The index found.
        found: usize,
        /// How many there are.
        count: usize,
    },
    /// A node that is prescribed twice.
    #[error("effect {index}: node {node} is prescribed twice: list it once")]
    PrescribedTwice {
        /// Position in the list of effects.
        index: usize,
        /// The node.
        node: u32,
    },
    /// A region of nodes that could not be resolved on this mesh.
    #[error("effect {index}: {source}")]
    Region {
        /// Position in the list of effects.
        index: usize,
        /// Why.
        source: hex_mesh::HexMeshError,
    },
    /// A region that selects nothing.
    #[error(
        "effect {index}: no {what} lies in the region: look at its numbers, which are in the unit of the body"
    )]
    EmptyRegion {
        /// Position in the list of effects.
        index: usize,
        /// What was to be selected.
        what: &'static str,
    },
    /// A name that whoever reads the list of effects was to put something in place of.
    #[error("effect {index}: nothing is known by the name `{name}`")]
    Unnamed {
        /// Position in the list of effects.
        index: usize,
        /// The name.
        name: String,
    },
    /// An effect that acts on the surface, of a solver that knows none.
    #[error(
        "effect {index} (`{kind}`) acts on the surface: build the solver with one, by `Solver::on_surface`"
    )]
    NoSurface {
        /// Position in the list of effects.
        index: usize,
        /// Kind of the effect.
        kind: &'static str,
    },
    /// A cavity with an opening.
    #[error(
        "effect {index}: the cavity is open along {edges} edges, one of them near ({:.4}, {:.4}, {:.4}): choose a region that holds all of its \
         walls, or close its openings by `capped = true`",
        near[0],
        near[1],
        near[2]
    )]
    OpenCavity {
        /// Position in the list of effects.
        index: usize,
        /// Edges with a triangle on one side only.
        edges: usize,
        /// Where one of them is at rest.
        near: [f64; 3],
    },
    /// Two effects that cannot stand together, or one that needs another.
    #[error("effect {index} (`{kind}`): {why}")]
    Excluded {
        /// Position in the list of effects.
        index: usize,
        /// Kind of the effect.
        kind: &'static str,
        /// What it does not go with, and the mend.
        why: &'static str,
    },
    /// Things that contact keeps apart, but that pass through each other where it begins.
    #[error(
        "effect {index} (`contact`): triangle {triangle} of the surface passes through {what}, or touches it, near ({:.4}, {:.4}, {:.4}): move one \
         of them away, take the obstacle out, or begin at positions where nothing passes through anything",
        near[0],
        near[1],
        near[2]
    )]
    Intersects {
        /// Position in the list of effects.
        index: usize,
        /// The triangle of the surface.
        triangle: usize,
        /// What it passes through.
        what: String,
        /// Where.
        near: [f64; 3],
    },
    /// A connected part of the body that could move freely as a rigid body.
    #[error(
        "{count} connected nodes around node {node} are held by nothing, so their position is not determined: \
         prescribe at least one of them, attach a spring, or let them float by the effect `floating`"
    )]
    NotHeld {
        /// One node of the part.
        node: usize,
        /// Nodes in the part.
        count: usize,
    },
    /// A part that nothing holds, but weight pulls.
    #[error(
        "{count} connected nodes around node {node} are held by nothing, and gravity pulls: they would fall for ever. Prescribe at least one \
         of them, attach a spring, or take the gravity away"
    )]
    Falls {
        /// One node of the part.
        node: usize,
        /// Nodes in the part.
        count: usize,
    },
    /// A step in time of a body without inertia.
    #[error(
        "the list of effects has no inertia: add one `inertia` effect, with density and time step"
    )]
    NoInertia,
    /// An array of parameters of the wrong length.
    #[error("`{what}` has {found} entries, expected {expected}")]
    WrongLength {
        /// Which array.
        what: &'static str,
        /// Its length.
        found: usize,
        /// The length that fits this solver.
        expected: usize,
    },
    /// A parameter that is NaN or infinite.
    #[error("`{what}` entry {index} is not finite")]
    NotFinite {
        /// Which array.
        what: &'static str,
        /// Which entry.
        index: usize,
    },
    /// A stopping rule that can never be met.
    #[error("the stopping rule asks for {value}: give a finite number above zero")]
    BadStop {
        /// What was asked.
        value: f64,
    },
    /// The constant matrix could not be factored.
    #[error("the constant matrix of {size} free nodes could not be factored: {reason}")]
    Factorisation {
        /// Free nodes.
        size: usize,
        /// What the factorisation reported.
        reason: String,
    },
}

impl SolverError {
    /// Position in the list of effects of the one at fault, where there is one.
    pub fn effect(&self) -> Option<usize> {
        match self {
            Self::DuplicateEffect { index, .. }
            | Self::BadValue { index, .. }
            | Self::OutOfRange { index, .. }
            | Self::PrescribedTwice { index, .. }
            | Self::Region { index, .. }
            | Self::EmptyRegion { index, .. }
            | Self::NoSurface { index, .. }
            | Self::Unnamed { index, .. }
            | Self::OpenCavity { index, .. }
            | Self::Excluded { index, .. }
            | Self::Intersects { index, .. } => Some(*index),
            _ => None,
        }
    }
}
