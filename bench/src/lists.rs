//! Lists of effects to measure on the reference box, of a strength that bends it about as its actuation does.

use crate::case::{Case, EDGE, STIFFNESS};
use hex_mesh::{Axis, NodeRegion};
use pd_solver::{EffectSpec, ElementSet, NodeSet, Obstacle, SpringPoints, TimeScheme};

/// Mass per volume, of water and of flesh.
const DENSITY: f64 = 1000.0;
/// A step in time; a wave goes half the length of the default box in it.
const TIME_STEP: f64 = 0.01;

/// A list beside elasticity and what is held.
pub struct List {
    /// What the table calls it.
    pub name: &'static str,
    /// The effects that it adds.
    pub extra: Vec<EffectSpec>,
}

impl List {
    /// Whether a solve is a step in time.
    pub fn is_time_step(&self) -> bool {
        self.extra
            .iter()
            .any(|e| matches!(e, EffectSpec::Inertia { .. }))
    }
}

/// None, each effect alone (damping with the inertia that it needs), all that stand still together, and all together in a step in time.
pub fn lists(case: &Case) -> Vec<List> {
    let [x, y, z] = case.cells.expect("a box").map(|n| n as f64 * EDGE);
    let end = NodeRegion::Plane {
        axis: Axis::X,
        value: x,
    };
    let far_half = NodeRegion::HalfSpace {
        normal: [1.0, 0.0, 0.0],
        offset: x / 2.0,
    };
    let inertia = EffectSpec::Inertia {
        density: DENSITY,
        time_step: TIME_STEP,
        scheme: TimeScheme::BackwardEuler,
    };
    let still = [
        (
            "springs",
            EffectSpec::Springs {
                points: SpringPoints::Nodes(NodeSet::Region(end)),
                stiffness: 0.1 * STIFFNESS * EDGE,
            },
        ),
        (
            "gravity",
            EffectSpec::Gravity {
                acceleration: [0.0, 0.0, -9.81],
                density: DENSITY,
            },
        ),
        (
            "stiffness",
            EffectSpec::Stiffness {
                elements: ElementSet::Region(far_half),
                factor: 10.0,
            },
        ),
        (
            "activation",
            EffectSpec::Activation {
                elements: ElementSet::Region(far_half),
                scale: 0.5,
            },
        ),
        (
            "volume",
            EffectSpec::Volume {
                stiffness: 10.0 * STIFFNESS,
            },
        ),
        (
            "pressure",
            EffectSpec::Pressure {
                region: None,
                capped: false,
                pressure: 0.01 * STIFFNESS,
            },
        ),
        (
            "force",
            EffectSpec::Force {
                region: Some(end),
                force: [0.0, 0.0, -0.002 * STIFFNESS * y * z],
            },
        ),
        (
            "wind",
            EffectSpec::Wind {
                region: None,
                pressure: [0.0, 0.001 * STIFFNESS, 0.0],
            },
        ),
    ];
    let contact = EffectSpec::Contact {
        region: None,
        distance: 0.1 * EDGE,
        stiffness: None,
        own: true,
        obstacles: vec![Obstacle::Plane {
            normal: [0.0, 0.0, 1.0],
            offset: -2.0 * EDGE,
        }],
    };
    let damping = EffectSpec::Damping {
        viscosity: 0.1 * STIFFNESS * TIME_STEP,
    };
    let mut all: Vec<EffectSpec> = still.iter().map(|(_, effect)| effect.clone()).collect();
    all.push(contact.clone());
    let list = |name, extra| List { name, extra };
    let mut lists = vec![list("none", vec![])];
    lists.extend(still.map(|(name, effect)| list(name, vec![effect])));
    lists.push(list("contact", vec![contact]));
    lists.push(list("inertia", vec![inertia.clone()]));
    lists.push(list(
        "inertia, damping",
        vec![inertia.clone(), damping.clone()],
    ));
    lists.push(list("all at rest", all.clone()));
    lists.push(list(
        "all in a step",
        [all, vec![inertia, damping]].concat(),
    ));
    lists
}
