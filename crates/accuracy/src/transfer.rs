//! One network on every grid: what a field that was trained on one grid does on another, with and without a branch that knows the spacing
//! (supplement, section 10.3 and Fig. 12).

use crate::error::{AccuracyError, Result};
use crate::kept::{InTraining, Kept, Unfinished};
use crate::subject::Subject;
use actuation_net::{ACTUATION_SIZE, ActuationNet, Output, ResolutionRange};
use hex_mesh::{HexMesh, embed, trilinear_weights};
use nalgebra::Vector3;
use pd_solver::{SolveOptions, Stop};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore, SeedableRng};
use scene_shapes::actuation::uniform;
use serde::Serialize;
use std::path::Path;
use surface_mesh::vertex_normals;
use trainer::actuator::{Actuator, Samples};
use trainer::body::Body;
use trainer::scene::Scene;
use trainer::shapes::Shape;
use trainer::simulator::Simulator;
use trainer::stage2::{Outcome, ThroughSimulator, steps};

/// Sample counts of the supplement's Fig. 12, in thousands: from the first to the second, and back between the others.
pub const FIGURE: [(f64, f64); 2] = [(268.0, 42.0), (89.0, 502.0)];

/// How much is trained and tested.
#[derive(Debug, Clone, Serialize)]
pub struct TransferPlan {
    /// Passes over the shapes on one grid.
    pub passes: usize,
    /// Passes of the field that knows the spacing.
    pub conditioned_passes: usize,
    /// Grids that it is trained on.
    pub grids: usize,
    /// Other grids that it is tested on.
    pub tests: usize,
    /// Of these, how many have a network trained for them alone.
    pub alone: usize,
    /// Adam's rate.
    pub learning_rate: f64,
    /// Adam's rate in the one pass of transfer, whose few steps are long ones.
    pub one_pass_rate: f64,
    /// Samples of the grid that the figure's 268 thousand stand for; those of the scene's grid unless given.
    pub samples: Option<f64>,
}

impl TransferPlan {
    /// A few minutes on two cores for a body of some thousand elements.
    pub fn quick() -> Self {
        Self {
            passes: 30,
            conditioned_passes: 80,
            grids: 20,
            tests: 25,
            alone: 5,
            learning_rate: 1e-4,
            one_pass_rate: 2e-5,
            samples: None,
        }
    }

    /// The supplement's own sample counts and passes: days on two cores.
    pub fn full() -> Self {
        Self {
            conditioned_passes: 30,
            samples: Some(1e3 * FIGURE[0].0),
            ..Self::quick()
        }
    }

    /// What decides about the networks: the plan, and what it is carried out on.
    fn of(&self, subject: &Subject) -> serde_json::Value {
        serde_json::json!({
            "plan": self,
            "scene": subject.scene,
            "diagonal": subject.diagonal,
            "shapes": subject.names(),
        })
    }
}

/// How far simulated surfaces are from their targets.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Errors {
    /// Mean distance over vertices and shapes, in diagonals.
    pub mean: f64,
    /// Distance that 99 % of the vertices do not exceed, the mean over the shapes, in diagonals.
    pub p99: f64,
    /// Mean angle between normals, in degrees: what is rough shows here.
    pub normals: f64,
}

/// A way to actuate a grid that was not trained on, measured.
#[derive(Debug, Clone, Serialize)]
pub struct Way {
    /// In words.
    pub name: &'static str,
    /// Its errors.
    pub errors: Errors,
    /// Surfaces of all shapes.
    #[serde(skip)]
    pub surfaces: Vec<Vec<Vector3<f64>>>,
}

/// From one grid to another.
#[derive(Debug, Clone, Serialize)]
pub struct Direction {
    /// Samples of the grid trained on.
    pub from: usize,
    /// Samples of the other grid.
    pub to: usize,
    /// All ways; the first is the grid that was trained on itself.
    pub ways: Vec<Way>,
}

/// One grid that was not trained on.
#[derive(Debug, Clone, Serialize)]
pub struct TestGrid {
    /// Samples of its elements.
    pub samples: usize,
    /// The field that knows the spacing.
    pub conditioned: Errors,
    /// The field of the finest grid, asked here.
    pub evaluated: Errors,
    /// Its actuation on the finest grid, interpolated.
    pub interpolated: Errors,
    /// A network trained for this grid alone, where there is one.
    pub alone: Option<Errors>,
}

/// Everything.
#[derive(Debug, Clone, Serialize)]
pub struct Transfer {
    /// How much was trained.
    pub plan: TransferPlan,
    /// The figure's two directions.
    pub directions: Vec<Direction>,
    /// Grids between the coarsest and the finest.
    pub tests: Vec<TestGrid>,
}

impl Transfer {
    /// Mean error of the field that knows the spacing over that of networks trained for a grid alone, where there are such.
    pub fn ratio_to_alone(&self) -> f64 {
        let pairs = self
            .tests
            .iter()
            .filter_map(|t| Some((t.conditioned.mean, t.alone?.mean)));
        let (own, alone) = pairs.fold((0.0, 0.0), |sum, pair| (sum.0 + pair.0, sum.1 + pair.1));
        own / alone
    }
}

/// A body on one grid.
struct Grid {
    scene: Scene,
    body: Body,
}

impl Grid {
    fn new(
        subject: &Subject,
        element_size: f64,
        plan: &TransferPlan,
        passes: usize,
    ) -> Result<Self> {
        let mut scene = subject.scene.clone();
        scene.mesh.element_size = element_size;
        scene.stage2.epochs = passes;
        scene.stage2.learning_rate = plan.learning_rate;
        scene.stage2.blend_weight = 0.0;
        let body = subject.body(&scene)?;
        Ok(Self { scene, body })
    }

    fn samples(&self) -> usize {
        self.body.samples.count()
    }
}

struct Case<'a> {
    subject: &'a Subject,
    shapes: Vec<&'a Shape>,
    descriptors: Vec<Vec<f32>>,
    plan: TransferPlan,
    kept: Kept,
}

/// Does everything, `told` hears of each step. Networks are kept in `folder`, and so is a run with the one that knows the spacing.
///
/// # Errors
/// When a grid does not fit the body, something cannot be simulated, or the folder holds another transfer.
pub fn transfer(
    subject: &Subject,
    plan: TransferPlan,
    folder: &Path,
    mut told: impl FnMut(&str),
) -> Result<Transfer> {
    let described = subject.shapes()?;
    let case = Case {
        subject,
        shapes: described.iter().map(|s| s.0).collect(),
        descriptors: described.iter().map(|s| s.1.clone()).collect(),
        kept: Kept::open(folder, &plan.of(subject))?,
        plan,
    };
    let scenes = subject.scene.mesh.element_size;
    let base = match case.plan.samples {
        None => scenes,
        Some(samples) => {
            let count = Grid::new(subject, scenes, &case.plan, 0)?.samples();
            scenes * (count as f64 / samples).cbrt()
        }
    };
    let start = &subject.fields[0].net;
    let finest = FIGURE[0].0;
    let size = |samples: f64| base * (finest / samples).cbrt();
    let grid = |samples: f64, passes: usize| Grid::new(subject, size(samples), &case.plan, passes);

    told("the network of the finest grid");
    let fine = grid(finest, case.plan.passes)?;
    let of_finest = case.kept.network("finest", |unfinished| {
        case.trained(start, std::slice::from_ref(&fine), unfinished)
    })?;
    let coarse = grid(FIGURE[0].1, case.plan.passes)?;
    let range = ResolutionRange {
        coarse: coarse.body.samples.spacing,
        fine: fine.body.samples.spacing,
    };
    // Uniform in the number of samples, as the supplement has it.
    let mut random = ChaCha8Rng::seed_from_u64(subject.scene.seed ^ 0x7e57);
    let mut between = || FIGURE[0].1 + (finest - FIGURE[0].1) * uniform(&mut random);
    let passes = case.plan.conditioned_passes;
    let counts: Vec<f64> = (0..case.plan.grids).map(|_| between()).collect();
    told("the network that knows the spacing");
    let conditioned = case.kept.network("conditioned", |unfinished| {
        let grids = counts.iter().map(|&count| grid(count, passes));
        let grids = grids.collect::<Result<Vec<_>>>()?;
        let untrained = of_finest.with_resolution(range, subject.scene.seed)?;
        case.trained(&untrained, &grids, unfinished)
    })?;
    subject.write_run(&folder.join("conditioned"), &conditioned)?;

    let mut directions = Vec::new();
    for (from, to) in FIGURE {
        told(&format!("from {from} to {to} thousand samples"));
        let (source, mut one_pass) = (grid(from, case.plan.passes)?, grid(to, 1)?);
        one_pass.scene.stage2.learning_rate = case.plan.one_pass_rate;
        let own = match from == finest {
            true => of_finest.clone(),
            false => case.kept.network(&format!("own-{from}"), |unfinished| {
                case.trained(start, std::slice::from_ref(&source), unfinished)
            })?,
        };
        let name = format!("transferred-{from}-{to}");
        directions.push(case.direction(&name, &own, &conditioned, &source, &one_pass)?);
    }
    let mut tests = Vec::new();
    let mut counts: Vec<f64> = (0..case.plan.tests).map(|_| between()).collect();
    counts.sort_by(f64::total_cmp);
    let alone_every = case.plan.tests.div_ceil(case.plan.alone.max(1));
    for (i, count) in counts.into_iter().enumerate() {
        let place = grid(count, case.plan.passes)?;
        told(&format!("tested on {} samples", place.samples()));
        let alone = match i % alone_every == alone_every / 2 {
            false => None,
            true => {
                let name = format!("alone-{}", i + 1);
                let own = case.kept.network(&name, |unfinished| {
                    case.trained(start, std::slice::from_ref(&place), unfinished)
                })?;
                Some(
                    case.simulated(&place, |d, grid| evaluated(&own, d, grid))?
                        .0,
                )
            }
        };
        tests.push(TestGrid {
            samples: place.samples(),
            conditioned: case
                .simulated(&place, |d, grid| evaluated(&conditioned, d, grid))?
                .0,
            evaluated: case
                .simulated(&place, |d, grid| evaluated(&of_finest, d, grid))?
                .0,
            interpolated: case
                .simulated(&place, |d, grid| interpolated(&of_finest, d, &fine, grid))?
                .0,
            alone,
        });
    }
    Ok(Transfer {
        plan: case.plan,
        directions,
        tests,
    })
}

impl Case<'_> {
    /// Trains through the simulator, every step on one of the grids, drawn at random; goes on with what is unfinished.
    fn trained(
        &self,
        net: &ActuationNet,
        grids: &[Grid],
        unfinished: &Unfinished,
    ) -> Result<ActuationNet> {
        let rest = grids
            .iter()
            .map(|grid| vec![grid.body.mesh.nodes().to_vec(); self.shapes.len()]);
        let mut state = unfinished.read(InTraining::new(net, rest.collect()))?;
        let simulators = grids.iter().map(|grid| {
            ThroughSimulator::new(&grid.body, &grid.scene, &self.shapes, &self.descriptors)
        });
        let mut simulators = simulators.collect::<trainer::error::Result<Vec<_>>>()?;
        let mut random = ChaCha8Rng::seed_from_u64(self.subject.scene.seed);
        let mut draw = || random.next_u64() as usize % grids.len();
        for _ in 0..state.step {
            draw();
        }
        while state.step < steps(&grids[0].scene.stage2, self.shapes.len()) {
            unfinished.keep(&state)?;
            let place = draw();
            let (net, adam) = (&mut state.net, &mut state.adam);
            let warm = &mut state.warm[place];
            let outcome = simulators[place].step(net, adam, warm, state.step)?;
            state.step += 1;
            match outcome {
                Outcome::Stepped(_) => state.dropped = 0,
                Outcome::Dropped(reason) => {
                    state.dropped += 1;
                    if state.dropped == MOST_DROPPED {
                        return Err(AccuracyError::Training { reason });
                    }
                }
            }
        }
        Ok(state.net)
    }

    /// Simulates all shapes on a grid with an actuation from somewhere.
    fn simulated(
        &self,
        grid: &Grid,
        mut answer: impl FnMut(&[f32], &Grid) -> Result<Output>,
    ) -> Result<(Errors, Vec<Vec<Vector3<f64>>>)> {
        let body = &grid.body;
        let mut simulator = Simulator::new(body, &grid.scene)?;
        let accuracy = grid.scene.evaluation_accuracy(body.diagonal);
        let options = SolveOptions::new(Stop::Accuracy(accuracy));
        let (mut errors, mut surfaces) = (Vec::new(), Vec::new());
        for (shape, descriptor) in self.shapes.iter().zip(&self.descriptors) {
            let output = answer(descriptor, grid)?;
            let reached = simulator.equilibrium(&output, None, &options)?;
            let surface = body.surface_positions(&reached.solution.positions);
            errors.push(errors_of(body, &surface, &shape.positions));
            surfaces.push(surface);
        }
        let mean =
            |of: fn(&Errors) -> f64| errors.iter().map(of).sum::<f64>() / errors.len() as f64;
        let all = Errors {
            mean: mean(|e| e.mean),
            p99: mean(|e| e.p99),
            normals: mean(|e| e.normals),
        };
        Ok((all, surfaces))
    }

    /// The ways from one grid to another; `name` is that of the network that one pass of transfer trains.
    fn direction(
        &self,
        name: &str,
        own: &ActuationNet,
        conditioned: &ActuationNet,
        source: &Grid,
        target: &Grid,
    ) -> Result<Direction> {
        let retrained = self.kept.network(name, |unfinished| {
            self.trained(own, std::slice::from_ref(target), unfinished)
        })?;
        let way = |name, found: (Errors, Vec<Vec<Vector3<f64>>>)| Way {
            name,
            errors: found.0,
            surfaces: found.1,
        };
        let asked = |net: &ActuationNet, grid: &Grid| {
            self.simulated(grid, |d, grid| evaluated(net, d, grid))
        };
        let between = self.simulated(target, |d, grid| interpolated(own, d, source, grid))?;
        Ok(Direction {
            from: source.samples(),
            to: target.samples(),
            ways: vec![
                way("its own grid", asked(own, source)?),
                way("interpolated", between),
                way("network, asked there", asked(own, target)?),
                way("one pass of transfer", asked(&retrained, target)?),
                way("knows the spacing", asked(conditioned, target)?),
            ],
        })
    }
}

/// Dropped steps in a row that end a training.
const MOST_DROPPED: u64 = 20;

fn evaluated(net: &ActuationNet, descriptor: &[f32], grid: &Grid) -> Result<Output> {
    let samples = Samples::all(grid.body.actuated());
    Ok(Actuator::evaluate(net, descriptor, &samples)?)
}

/// The actuation on one grid, averaged to its nodes, and from there by trilinear weights to the samples of another.
fn interpolated(net: &ActuationNet, descriptor: &[f32], from: &Grid, to: &Grid) -> Result<Output> {
    let own = evaluated(net, descriptor, from)?;
    let halves = nodal(&from.body.mesh, &own.actuation);
    let places = to.body.mesh.sample_positions();
    let embedding = embed(&from.body.mesh, &places).map_err(|source| AccuracyError::Mesh {
        what: "samples of another grid",
        source,
    })?;
    let halves = halves.map(|half| embedding.positions(&half, &from.body.mesh));
    let rows = halves[0].iter().zip(&halves[1]);
    let rows = rows.flat_map(|(a, b)| {
        a.iter()
            .chain(b.iter())
            .map(|x| *x as f32)
            .collect::<Vec<_>>()
    });
    Ok(Output {
        actuation: rows.collect(),
        joint: own.joint,
    })
}

/// Means at the nodes of values at the samples, by trilinear weights, as two vectors of three entries each.
fn nodal(mesh: &HexMesh, values: &[f32]) -> [Vec<Vector3<f64>>; 2] {
    let weights: Vec<[f64; 8]> = { mesh.quadrature().points.iter() }
        .map(trilinear_weights)
        .collect();
    let count = mesh.nodes().len();
    let mut sums = [vec![Vector3::zeros(); count], vec![Vector3::zeros(); count]];
    let mut total = vec![0.0; count];
    let rows = values.chunks_exact(ACTUATION_SIZE * weights.len());
    for (element, rows) in mesh.elements().iter().zip(rows) {
        for (row, weights) in rows.chunks_exact(ACTUATION_SIZE).zip(&weights) {
            for (&node, weight) in element.iter().zip(weights) {
                let node = node as usize;
                total[node] += weight;
                for (half, sum) in sums.iter_mut().enumerate() {
                    let part = &row[3 * half..3 * half + 3];
                    sum[node] += Vector3::from_fn(|i, _| f64::from(part[i])) * *weight;
                }
            }
        }
    }
    for sum in &mut sums {
        sum.iter_mut().zip(&total).for_each(|(s, t)| *s /= *t);
    }
    sums
}

fn errors_of(body: &Body, surface: &[Vector3<f64>], target: &[Vector3<f64>]) -> Errors {
    let (mean, _, mut all) = trainer::loss::distances(surface, target);
    all.sort_by(f64::total_cmp);
    let triangles = body.surface.triangles();
    let pairs = vertex_normals(surface, triangles)
        .into_iter()
        .zip(vertex_normals(target, triangles));
    let angles = pairs.map(|(a, b)| a.dot(&b).clamp(-1.0, 1.0).acos().to_degrees());
    let last = (all.len() * 99).div_ceil(100).max(1) - 1;
    Errors {
        mean: mean / body.diagonal,
        p99: all[last] / body.diagonal,
        normals: angles.sum::<f64>() / surface.len() as f64,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hex_mesh::Quadrature;

    /// Averaging to the nodes and back keeps what is the same everywhere, and each entry in its place.
    #[test]
    fn constants_survive_interpolation() {
        let mesh = HexMesh::solid_box([3, 2, 2], 0.5, Quadrature::Eight).unwrap();
        let row = [0.1_f32, -0.2, 0.3, 0.4, -0.5, 0.6];
        let values = row.repeat(8 * mesh.elements().len());
        let [first, last] = nodal(&mesh, &values);
        for (a, b) in first.iter().zip(&last) {
            let found = a.iter().chain(b.iter());
            assert!(found.zip(row).all(|(x, y)| (x - f64::from(y)).abs() < 1e-7));
        }
    }
}
