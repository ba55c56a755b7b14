//! Whether the error that a solve tells is the error that it has.

use crate::error::{AccuracyError, Result};
use hex_mesh::{Axis, HexMesh, NodeRegion, Quadrature, VoxelOptions, voxelise};
use nalgebra::Vector3;
use pd_solver::{
    EffectSpec, Estimate, Method, NodeSet, Parameters, Solution, SolveOptions, Solver, Status, Stop,
};
use scene_shapes::StarfishShape;
use scene_shapes::actuation::{bending, waves};
use serde::Serialize;

/// Accuracies asked, as shares of the diagonal of the body's bounding box.
const ACCURACIES: [f64; 5] = [1e-2, 1e-3, 1e-4, 1e-5, 1e-6];
/// How much closer than an accuracy its reference is.
const CLOSER: f64 = 1e-3;
/// A solution farther from its reference than this many accuracies has another equilibrium nearby, which is told and not counted.
const ELSEWHERE: f64 = 1e3;
/// Bounds of estimated over true error.
pub const BOUNDS: (f64, f64) = (0.5, 5.0);

/// The error that a solve tells, beside that which it has.
#[derive(Debug, Clone, Serialize)]
pub struct Told {
    /// Estimated largest distance of a node from its place, in diagonals; absent where no step was needed.
    pub estimated: Option<f64>,
    /// The distance itself.
    pub true_error: f64,
    /// Where the estimate comes from.
    pub estimate: Estimate,
}

impl Told {
    /// Estimated over true error, where both are there.
    pub fn ratio(&self) -> Option<f64> {
        let estimated = self.estimated?;
        (self.true_error > 0.0).then(|| estimated / self.true_error)
    }
}

/// One solve beside its reference.
#[derive(Debug, Clone, Serialize)]
pub struct EstimateCase {
    /// Body and actuation.
    pub name: String,
    /// Accuracy asked, in diagonals.
    pub asked: f64,
    /// What the solve tells that measures its error at the end.
    pub measured: Told,
    /// What one tells that does not: where its directions led it to stop.
    pub unmeasured: Told,
    /// Steps of the former.
    pub iterations: usize,
    /// How it ended.
    pub status: Status,
    /// Samples turned inside out at its solution.
    pub inverted_samples: usize,
}

/// All cases, and how many of them are told well.
#[derive(Debug, Clone, Serialize)]
pub struct Estimates {
    /// One by one.
    pub cases: Vec<EstimateCase>,
    /// Share of those with an estimate whose ratio lies within [`BOUNDS`], where the error is measured.
    pub share_within: f64,
    /// The same where it is not.
    pub share_within_unmeasured: f64,
}

struct Body {
    name: String,
    mesh: HexMesh,
    effects: Vec<EffectSpec>,
    actuation: Vec<[f64; 6]>,
}

/// Solves every case to every accuracy, and then tightly from there; `told` hears of each.
///
/// # Errors
/// When a body cannot be made or a solver refuses it.
pub fn estimates(mut told: impl FnMut(&EstimateCase)) -> Result<Estimates> {
    let mut cases = Vec::new();
    for body in bodies()? {
        let mut solver = Solver::new(&body.mesh, &body.effects)?;
        let mut parameters = solver.rest_parameters();
        parameters.actuation.copy_from_slice(&body.actuation);
        for asked in ACCURACIES {
            let case = one(&body, &mut solver, &parameters, asked)?;
            told(&case);
            cases.push(case);
        }
    }
    Ok(Estimates {
        share_within: share_within(cases.iter().map(|case| &case.measured)),
        share_within_unmeasured: share_within(cases.iter().map(|case| &case.unmeasured)),
        cases,
    })
}

fn share_within<'a>(all: impl Iterator<Item = &'a Told>) -> f64 {
    let ratios: Vec<f64> = all.filter_map(Told::ratio).collect();
    let within = |r: &&f64| (BOUNDS.0..=BOUNDS.1).contains(*r);
    ratios.iter().filter(within).count() as f64 / ratios.len() as f64
}

fn one(
    body: &Body,
    solver: &mut Solver,
    parameters: &Parameters,
    asked: f64,
) -> Result<EstimateCase> {
    let diagonal = diagonal(&body.mesh);
    let options = SolveOptions::new(Stop::Accuracy(asked * diagonal));
    let unmeasured = solver.solve(parameters, None, &options)?;
    let solution = solver.solve(parameters, None, &options.measuring_error())?;
    let tight = SolveOptions::new(Stop::Accuracy(CLOSER * asked * diagonal));
    let tight = tight.with_method(Method::Newton);
    let reference = solver.solve(parameters, Some(&solution.positions), &tight)?;
    if reference.status != Status::Converged {
        return Err(AccuracyError::Reference {
            what: format!("the reference of {} at {asked:e}", body.name),
            status: reference.status,
        });
    }
    let told = |solution: &Solution| {
        let pairs = solution.positions.iter().zip(&reference.positions);
        let farthest = pairs.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        let true_error = farthest / diagonal;
        let estimated = solution.stats.estimated_error.map(|e| e / diagonal);
        Told {
            estimated: estimated.filter(|_| true_error <= ELSEWHERE * asked),
            true_error,
            estimate: solution.stats.estimate,
        }
    };
    let measured = told(&solution);
    let gradients = pd_solver::deformation_gradients(&body.mesh, &solution.positions);
    let inverted = gradients.iter().filter(|f| f.determinant() <= 0.0);
    Ok(EstimateCase {
        name: match measured.true_error > ELSEWHERE * asked {
            false => body.name.clone(),
            true => format!("{} (went elsewhere)", body.name),
        },
        asked,
        measured,
        unmeasured: told(&unmeasured),
        iterations: solution.stats.iterations,
        status: solution.status,
        inverted_samples: inverted.count(),
    })
}

fn diagonal(mesh: &HexMesh) -> f64 {
    let (low, high) = bounds(mesh);
    (high - low).norm()
}

fn bounds(mesh: &HexMesh) -> (Vector3<f64>, Vector3<f64>) {
    let nothing = Vector3::repeat(f64::INFINITY);
    let nodes = mesh.nodes().iter();
    nodes.fold((nothing, -nothing), |(low, high), x| {
        (low.inf(x), high.sup(x))
    })
}

/// From easy to nearly unstable: a box that is bent more and more, the box and a starfish under random waves of rising amplitude.
fn bodies() -> Result<Vec<Body>> {
    let error = |what| move |source| AccuracyError::Mesh { what, source };
    let cells = [24, 12, 12];
    let solid = HexMesh::solid_box(cells, 1.0 / 12.0, Quadrature::Eight).map_err(error("box"))?;
    let side = NodeSet::Region(NodeRegion::Plane {
        axis: Axis::X,
        value: 0.0,
    });
    let mut bodies = Vec::new();
    for amplitude in [0.25, 0.5, 1.0, 1.5, 2.0, 3.0] {
        let at = |x: &Vector3<f64>| bending([x.x / 2.0, x.y, x.z], amplitude);
        bodies.push(Body {
            name: format!("box, bent {amplitude}"),
            mesh: solid.clone(),
            effects: effects(side.clone()),
            actuation: solid.sample_positions().iter().map(at).collect(),
        });
    }
    for amplitude in [0.1, 0.3, 0.6] {
        bodies.push(Body {
            name: format!("box, waves {amplitude}"),
            actuation: waves(&solid.sample_positions(), bounds(&solid), amplitude, 1),
            mesh: solid.clone(),
            effects: effects(side.clone()),
        });
    }
    let surface = scene_shapes::starfish(&StarfishShape::default())
        .map_err(|source| AccuracyError::Trainer(source.into()))?;
    let starfish = voxelise(&surface, &VoxelOptions::new(0.05)).map_err(error("starfish"))?;
    let disc = NodeSet::Region(NodeRegion::Sphere {
        center: [0.0; 3],
        radius: 0.2,
    });
    for amplitude in [0.1, 0.2, 0.4, 0.6] {
        bodies.push(Body {
            name: format!("starfish, waves {amplitude}"),
            actuation: waves(
                &starfish.mesh.sample_positions(),
                bounds(&starfish.mesh),
                amplitude,
                2,
            ),
            mesh: starfish.mesh.clone(),
            effects: effects(disc.clone()),
        });
    }
    Ok(bodies)
}

/// Elasticity of stiffness 1, held at some nodes.
pub(crate) fn effects(nodes: NodeSet) -> Vec<EffectSpec> {
    vec![
        EffectSpec::Elasticity { stiffness: 1.0 },
        EffectSpec::Prescribed { nodes },
    ]
}
