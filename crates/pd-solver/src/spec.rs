//! What a caller writes: the list of effects that a scene calls for.

mod given;

use crate::error::SolverError;
use crate::parameters::check_array;
use hex_mesh::{EmbeddedPoint, HexMesh, NodeRegion};
use nalgebra::Vector3;
use serde::{Deserialize, Deserializer, Serialize};

/// One effect of a scene. What is not listed allocates nothing, adds no matrix entry, and has no branch in any loop.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum EffectSpec {
    /// Shape-targeting elasticity with actuation: energy density `stiffness / 2 |F - R A|^2` (supplement, Eq. 6 and 11 with the
    /// one half inside). Exactly one is needed.
    Elasticity {
        /// Energy per volume for a unit misfit; 1 where not given.
        #[serde(default = "unit")]
        stiffness: f64,
    },
    /// Parts of the body that nothing holds may float: of all the places that their shape can have they take the one with the centroid of rest
    /// and the orientation nearest to rest. Without this effect a part that nothing holds is refused.
    Floating {},
    /// Nodes whose positions are given with every solve, fixed or moving.
    Prescribed {
        /// Which nodes.
        nodes: NodeSet,
    },
    /// Zero-length springs from points of the body to target points: energy `k / 2 |x - target|^2` each.
    Springs {
        /// Which points of the body.
        points: SpringPoints,
        /// Stiffness `k` of a spring, energy per squared length.
        stiffness: f64,
    },
    /// Weight: energy `- density acceleration . x` per rest volume.
    Gravity {
        /// Acceleration, length per squared time.
        acceleration: [f64; 3],
        /// Mass per rest volume.
        density: f64,
    },
    /// Another stiffness in a part of the body: a factor on that of `elasticity`. Where parts overlap, factors multiply.
    Stiffness {
        /// Which elements.
        elements: ElementSet,
        /// Factor, above zero; a painted set scales its distance from 1.
        factor: f64,
    },
    /// Material that follows the actuation less, or not at all: its stretch is `A = I + scale sym(b)`. Where parts overlap, scales multiply.
    Activation {
        /// Which elements.
        elements: ElementSet,
        /// 0 for passive material (fat, a scar, a paralysed half), 1 for what needs no entry; a painted set scales its distance from 1.
        scale: f64,
    },
    /// Flesh that resists a change of volume: energy `stiffness / 2 |F - D|^2` per rest volume, with the mean deformation gradient F of an
    /// element and the nearest D of determinant 1.
    Volume {
        /// Energy per volume for a unit misfit. Ten times that of elasticity holds volumes to some percent.
        stiffness: f64,
    },
    /// Pressure in a cavity that is closed, or that fans over its openings close: energy `- pressure V`.
    Pressure {
        /// The cavity's walls: triangles of the surface whose vertices are all in a region. All of the surface where not given.
        region: Option<NodeRegion>,
        /// Whether openings are closed by a fan of triangles to the middle of their border. An open cavity is refused otherwise.
        #[serde(default)]
        capped: bool,
        /// Force per area, outwards from the cavity: positive blows it up.
        pressure: f64,
    },
    /// A force on a patch of the surface, shared by area; it keeps its direction. Energy `- force . x`.
    Force {
        /// The vertices that it acts on; all where not given.
        region: Option<NodeRegion>,
        /// The whole force.
        force: [f64; 3],
    },
    /// Wind on a patch of the surface: a force per area along the wind on what faces it at rest, in proportion to the area across the wind.
    /// It keeps its direction and its strength while the body moves.
    Wind {
        /// The vertices that it acts on; all where not given.
        region: Option<NodeRegion>,
        /// Force per area across the wind.
        pressure: [f64; 3],
    },
    /// Inertia: every solve is one step in time, from [`Parameters::inertia`](crate::Parameters::inertia). See [`Motion`](crate::Motion).
    Inertia {
        /// Mass per rest volume.
        density: f64,
        /// Length of a step in time.
        time_step: f64,
        /// The rule that steps in time.
        #[serde(default)]
        scheme: TimeScheme,
    },
    /// Friction inside the flesh, where there is inertia: the power `viscosity |dE/dt|^2` per rest volume goes, with the Green strain E.
    Damping {
        /// Stress per rate of strain.
        viscosity: f64,
    },
    /// Contact of the surface with itself and with other bodies: a barrier that begins at a distance and that nothing passes.
    Contact {
        /// The vertices that may touch; all where not given.
        region: Option<NodeRegion>,
        /// Distance at which the barrier begins. Gaps between what touches are some tenths of it. Much more than the edges of the surface makes
        /// looking for what is near slow.
        distance: f64,
        /// Pressure of the barrier at about half its distance, see the table of effects; the stiffness of `elasticity` where not given.
        stiffness: Option<f64>,
        /// Whether the surface touches itself.
        #[serde(default = "yes")]
        own: bool,
        /// Other bodies.
        #[serde(default)]
        obstacles: Vec<Obstacle>,
    },
}

/// The rule by which a body steps in time.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TimeScheme {
    /// Backward Euler: of first order, takes energy out of fast vibrations, stable whatever the step.
    #[default]
    BackwardEuler,
    /// Implicit midpoint: of second order, keeps linear and angular momentum, and energy on the whole.
    Midpoint,
}

/// A body that does not give way. In a file it may be a name alone, for [`Obstacle::Named`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(
    tag = "type",
    rename_all = "snake_case",
    deny_unknown_fields,
    remote = "Self"
)]
pub enum Obstacle {
    /// Everything below a plane: the body stays where `normal . x >= offset`.
    Plane {
        /// Direction out of the obstacle; any length but zero.
        normal: [f64; 3],
        /// `normal . x` of the points on the plane.
        offset: f64,
    },
    /// A surface of triangles, closed or not; its vertices are in [`Parameters::obstacles`](crate::Parameters::obstacles) and may move from solve to solve.
    Surface {
        /// Vertices where it stands at rest.
        vertices: Vec<[f64; 3]>,
        /// Triangles, by three vertices.
        triangles: Vec<[u32; 3]>,
    },
    /// A surface that whoever reads the list of effects knows by name, and puts in place of it; a solver refuses it.
    Named {
        /// Its name.
        name: String,
    },
}

/// Elements by a part of space, or painted.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum ElementSet {
    /// Elements whose centre lies in a region.
    Region(NodeRegion),
    /// A share per element, from 0 for outside to 1 for inside.
    Painted(Vec<f64>),
    /// Shares that whoever reads the list of effects knows by name, and puts in place of it; a solver refuses it.
    Named(String),
}

impl EffectSpec {
    /// The name of the effect as a scene writes it.
    pub fn kind(&self) -> &'static str {
        match self {
            EffectSpec::Elasticity { .. } => "elasticity",
            EffectSpec::Floating {} => "floating",
            EffectSpec::Prescribed { .. } => "prescribed",
            EffectSpec::Springs { .. } => "springs",
            EffectSpec::Gravity { .. } => "gravity",
            EffectSpec::Stiffness { .. } => "stiffness",
            EffectSpec::Activation { .. } => "activation",
            EffectSpec::Volume { .. } => "volume",
            EffectSpec::Pressure { .. } => "pressure",
            EffectSpec::Force { .. } => "force",
            EffectSpec::Wind { .. } => "wind",
            EffectSpec::Inertia { .. } => "inertia",
            EffectSpec::Damping { .. } => "damping",
            EffectSpec::Contact { .. } => "contact",
        }
    }
}

impl EffectSpec {
    /// Whether it needs the surface that hangs on the body: see [`Solver::on_surface`](crate::Solver::on_surface).
    pub fn acts_on_surface(&self) -> bool {
        matches!(
            self,
            Self::Pressure { .. } | Self::Force { .. } | Self::Wind { .. } | Self::Contact { .. }
        )
    }
}

fn unit() -> f64 {
    1.0
}

fn yes() -> bool {
    true
}

/// A set of nodes, by region of the rest shape or one by one.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum NodeSet {
    /// Node indices, in the order in which their positions will be given.
    Indices(Vec<u32>),
    /// All nodes in a region, by rising index.
    Region(NodeRegion),
}

impl NodeSet {
    /// The nodes of this set on a mesh; `effect` is named in errors.
    pub(crate) fn resolve(&self, mesh: &HexMesh, effect: usize) -> Result<Vec<u32>, SolverError> {
        match self {
            NodeSet::Indices(nodes) => {
                let count = mesh.nodes().len();
                match nodes.iter().find(|&&n| n as usize >= count) {
                    Some(&found) => Err(SolverError::OutOfRange {
                        index: effect,
                        what: "node",
                        found: found as usize,
                        count,
                    }),
                    None => Ok(nodes.clone()),
                }
            }
            NodeSet::Region(region) => region.select(mesh).map_err(|source| SolverError::Region {
                index: effect,
                source,
            }),
        }
    }
}

/// Where springs hold on to the body. Files can only name nodes.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum SpringPoints {
    /// At nodes.
    Nodes(NodeSet),
    /// At points inside elements, each with a factor on the stiffness (an area weight, for one).
    #[serde(skip)]
    Embedded {
        /// The points.
        points: Vec<EmbeddedPoint>,
        /// One factor per point.
        factors: Vec<f64>,
    },
}

impl<'de> Deserialize<'de> for SpringPoints {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        NodeSet::deserialize(deserializer).map(Self::Nodes)
    }
}

impl ElementSet {
    /// The share of each element that belongs to the set.
    pub(crate) fn resolve(&self, mesh: &HexMesh, effect: usize) -> Result<Vec<f64>, SolverError> {
        let count = mesh.elements().len();
        match self {
            Self::Named(name) => Err(SolverError::Unnamed {
                index: effect,
                name: name.clone(),
            }),
            Self::Painted(shares) => {
                check_array("elements", shares, count, |share| share.is_finite())?;
                match shares.iter().find(|s| !(0.0..=1.0).contains(*s)) {
                    Some(&value) => Err(SolverError::BadValue {
                        index: effect,
                        field: "elements",
                        value,
                        expected: "shares from 0 to 1",
                    }),
                    None => Ok(shares.clone()),
                }
            }
            Self::Region(region) => {
                let half = Vector3::repeat(mesh.element_size() / 2.0);
                let centres: Vec<_> = (0..count).map(|e| mesh.element_corner(e) + half).collect();
                let inside = inside(region, &centres, mesh, effect, "element")?;
                Ok(inside.into_iter().map(|i| f64::from(u8::from(i))).collect())
            }
        }
    }
}

/// Which of these points lie in a region; none is an error.
pub(crate) fn inside(
    region: &NodeRegion,
    points: &[Vector3<f64>],
    mesh: &HexMesh,
    effect: usize,
    what: &'static str,
) -> Result<Vec<bool>, SolverError> {
    let inside = region
        .contains(points, mesh.element_size())
        .map_err(|source| SolverError::Region {
            index: effect,
            source,
        })?;
    if inside.contains(&true) {
        return Ok(inside);
    }
    Err(SolverError::EmptyRegion {
        index: effect,
        what,
    })
}
