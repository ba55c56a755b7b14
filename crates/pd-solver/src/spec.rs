//! What a caller writes: the list of effects that a scene calls for, and the parameters that change between solves.

use crate::error::SolverError;
use hex_mesh::{EmbeddedPoint, HexMesh, NodeRegion};
use nalgebra::Vector3;
use rayon::prelude::*;
use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use std::fmt::Formatter;

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
        }
    }
}

fn unit() -> f64 {
    1.0
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

// Not derived: serde's own error for an untagged enum does not tell what is wrong with a region.
impl<'de> Deserialize<'de> for NodeSet {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct ListOrTable;
        impl<'de> Visitor<'de> for ListOrTable {
            type Value = NodeSet;

            fn expecting(&self, f: &mut Formatter) -> std::fmt::Result {
                f.write_str("a region such as { type = \"box\", min = [..], max = [..] }, or a list of node indices")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, list: A) -> Result<NodeSet, A::Error> {
                Vec::deserialize(SeqAccessDeserializer::new(list)).map(NodeSet::Indices)
            }

            fn visit_map<A: MapAccess<'de>>(self, table: A) -> Result<NodeSet, A::Error> {
                NodeRegion::deserialize(MapAccessDeserializer::new(table)).map(NodeSet::Region)
            }
        }
        deserializer.deserialize_any(ListOrTable)
    }
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

/// Everything that may change from solve to solve. [`Solver::rest_parameters`](crate::Solver::rest_parameters) gives one that fits.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameters {
    /// Actuation b per sample, `[elements * samples]`, element by element, entries (11, 12, 13, 22, 23, 33) with A = I + sym(b).
    pub actuation: Vec<[f64; 6]>,
    /// Positions of the prescribed nodes, in the order of [`Solver::prescribed`](crate::Solver::prescribed).
    pub prescribed: Vec<Vector3<f64>>,
    /// Targets of the springs, all spring effects one after another.
    pub spring_targets: Vec<Vector3<f64>>,
    /// Acceleration of each gravity effect.
    pub acceleration: Vec<Vector3<f64>>,
}

impl Parameters {
    /// Same shape, all entries zero: what a gradient starts from.
    pub(crate) fn zeros_like(&self) -> Self {
        Self {
            actuation: vec![[0.0; 6]; self.actuation.len()],
            prescribed: vec![Vector3::zeros(); self.prescribed.len()],
            spring_targets: vec![Vector3::zeros(); self.spring_targets.len()],
            acceleration: vec![Vector3::zeros(); self.acceleration.len()],
        }
    }

    /// Checks lengths against `like` and all entries for finiteness.
    pub(crate) fn check(&self, like: &Parameters) -> Result<(), SolverError> {
        check_array("actuation", &self.actuation, like.actuation.len(), |b| {
            b.iter().fold(true, |all, x| all & x.is_finite())
        })?;
        let finite = |v: &Vector3<f64>| v.iter().all(|x| x.is_finite());
        check_array(
            "prescribed",
            &self.prescribed,
            like.prescribed.len(),
            finite,
        )?;
        let springs = like.spring_targets.len();
        check_array("spring_targets", &self.spring_targets, springs, finite)?;
        let gravities = like.acceleration.len();
        check_array("acceleration", &self.acceleration, gravities, finite)
    }
}

/// Refuses an array of the wrong length or with an entry that is not finite.
pub(crate) fn check_array<T: Sync>(
    what: &'static str,
    values: &[T],
    expected: usize,
    finite: impl Fn(&T) -> bool + Sync + Send,
) -> Result<(), SolverError> {
    if values.len() != expected {
        let found = values.len();
        return Err(SolverError::WrongLength {
            what,
            found,
            expected,
        });
    }
    // Without a way out of the loop over a part, which goes eight values at a time.
    let all_finite = |part: &[T]| part.iter().fold(true, |all, v| all & finite(v));
    if values.par_chunks(4096).all(all_finite) {
        return Ok(());
    }
    match values.iter().position(|v| !finite(v)) {
        Some(index) => Err(SolverError::NotFinite { what, index }),
        None => Ok(()),
    }
}
