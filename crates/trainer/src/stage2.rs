//! Stage 2: through the simulator. Network, equilibrium, loss on the surface, and the exact gradient back.

use crate::actuator::{Actuator, Points, Reverse, Samples};
use crate::balance::Balance;
use crate::body::Body;
use crate::draw;
use crate::error::Result;
use crate::loss::{Loss, distances};
use crate::scene::{Scene, Stage2};
use crate::shapes::Shape;
use crate::simulator::Simulator;
use crate::stage1::Regression;
use actuation_net::{ACTUATION_SIZE, Adam, AdamState, Output, OutputCotangent};
use nalgebra::Vector3;
use pd_solver::{AdjointStats, SolveOptions, SolveStats, Status, Stop};
use rand::Rng;
use rand::distr::Distribution;
use rand::distr::weighted::WeightedIndex;

/// Superpositions learned along with one step.
const BLENDS_PER_STEP: usize = 2;

/// What one step through the simulator did.
pub struct Step {
    /// Which training shape.
    pub shape: usize,
    /// Loss before the step.
    pub loss: f64,
    /// Mean distance from the target, in scene units, before the step.
    pub mean_error: f64,
    /// Work of the forward solve.
    pub forward: SolveStats,
    /// Work of the adjoint.
    pub adjoint: AdjointStats,
}

/// The gradient of one shape's loss.
pub struct Gradient {
    /// Of the loss times what the shape counts ([`Balance`]), by the network's parameters.
    pub parameters: Vec<f32>,
    /// Where the nodes came to rest.
    pub nodes: Vec<Vector3<f64>>,
    /// The work, and the loss.
    pub step: Step,
}

/// What came of a step.
pub enum Outcome {
    /// The parameters moved.
    Stepped(Box<Step>),
    /// Nothing changed, for this reason.
    Dropped(String),
}

/// Everything that stays the same between steps.
pub struct ThroughSimulator<'a> {
    pub(crate) body: &'a Body,
    pub(crate) scene: &'a Scene,
    /// Training shapes.
    pub(crate) shapes: &'a [&'a Shape],
    descriptors: &'a [Vec<f32>],
    balance: Balance,
    simulator: Simulator,
    /// Superpositions that are learned along, where the scene wants it.
    blends: Option<&'a Regression<'a>>,
}

/// Steps of the whole stage.
pub fn steps(settings: &Stage2, shapes: usize) -> u64 {
    (settings.epochs * shapes) as u64
}

impl<'a> ThroughSimulator<'a> {
    /// Trains on these shapes, described by these descriptors.
    ///
    /// # Errors
    /// When the effects of the scene do not fit the body.
    pub fn new(
        body: &'a Body,
        scene: &'a Scene,
        shapes: &'a [&'a Shape],
        descriptors: &'a [Vec<f32>],
    ) -> Result<Self> {
        Ok(Self {
            balance: Balance::of_motion(body, shapes, scene.stage2.balance),
            simulator: Simulator::new(body, scene)?,
            blends: None,
            body,
            scene,
            shapes,
            descriptors,
        })
    }

    /// Learns superpositions of stage 1 along, where the scene wants it.
    #[must_use]
    pub fn with_blends(mut self, regression: &'a Regression<'a>) -> Self {
        self.blends = (self.scene.stage2.blend_weight > 0.0).then_some(regression);
        self
    }

    /// Does step number `step`: one shape, started from where it was at its last visit.
    ///
    /// # Errors
    /// When something does not fit; numbers that fail drop the step instead, and nothing has changed then.
    pub fn step(
        &mut self,
        net: &mut impl Actuator,
        adam: &mut AdamState,
        warm: &mut [Vec<Vector3<f64>>],
        step: u64,
    ) -> Result<Outcome> {
        let settings = &self.scene.stage2;
        let count = self.shapes.len() as u64;
        let order = draw::order(
            &mut draw::generator(self.scene.seed, 3, step / count),
            self.shapes.len(),
        );
        let shape = order[(step % count) as usize];
        let found = match self.gradient(net, shape, &warm[shape], step)? {
            Ok(found) => found,
            Err(reason) => return Ok(Outcome::Dropped(reason)),
        };
        let lr = draw::decayed(
            settings.learning_rate,
            step,
            steps(settings, self.shapes.len()),
        );
        let adam_settings = Adam {
            lr,
            ..Adam::default()
        };
        if let Err(error) = adam_settings.step(adam, net.parameters_mut(), &found.parameters) {
            return Ok(Outcome::Dropped(error.to_string()));
        }
        warm[shape] = found.nodes;
        Ok(Outcome::Stepped(Box::new(found.step)))
    }

    /// The loss of one shape, simulated near `start`, and the gradient of what it counts by the network's parameters; what is drawn at random
    /// depends on the number of the step. The inner error says why there is none.
    ///
    /// # Errors
    /// When something does not fit.
    pub fn gradient(
        &mut self,
        net: &impl Actuator,
        shape: usize,
        start: &[Vector3<f64>],
        step: u64,
    ) -> Result<std::result::Result<Gradient, String>> {
        let settings = &self.scene.stage2;
        let descriptor = &self.descriptors[shape];
        let points = self.body.actuated();
        let samples = Samples::all(points);
        // What is asked again at few points on the way back need not be remembered for all.
        let is_remembered = !(1..points.count()).contains(&settings.points);
        let (answer, traced) = match ask(net, descriptor, &samples, is_remembered) {
            Ok(asked) => asked,
            Err(error) => return Ok(Err(error.to_string())),
        };
        let options = SolveOptions::new(Stop::Accuracy(
            self.scene.training_accuracy(self.body.diagonal),
        ));
        let reached = self.simulator.equilibrium(&answer, Some(start), &options)?;
        let solution = &reached.solution;
        let name = &self.shapes[shape].name;
        if solution.status != Status::Converged {
            return Ok(Err(format!(
                "{name}: the equilibrium is {:?}",
                solution.status
            )));
        }
        let target = &self.shapes[shape].positions;
        let loss = Loss::new(self.body, target, &self.scene.loss);
        let (mut value, node_bar) = loss.nodes(&solution.positions);
        if !value.is_finite() {
            return Ok(Err(format!("{name}: the loss is {value}")));
        }
        let tolerance = self.scene.adjoint_tolerance(self.body.diagonal);
        let cotangent = self.simulator.cotangent(&reached, &node_bar, tolerance)?;
        let (mut bar, adjoint) = match cotangent {
            Ok(done) => done,
            Err(status) => {
                return Ok(Err(format!("{name}: the adjoint is {status:?}")));
            }
        };
        let hanging = self.simulator.hanging.as_ref().zip(reached.theta);
        if let Some(((hanging, theta), wanted)) = hanging.zip(self.shapes[shape].joint) {
            let (more, known) = hanging.misfit(theta, wanted, self.scene.loss.jaw_weight);
            value += more;
            bar.joint.iter_mut().zip(known).for_each(|(a, b)| *a += b);
        }
        let mut generator = draw::generator(self.scene.seed, 6, step);
        let few = || few_of(points, &bar.actuation, settings.points, &mut generator);
        let gradient = parameter_gradient(net, traced, descriptor, &bar, few);
        let mut gradient = match gradient {
            Ok(gradient) => gradient,
            Err(error) => return Ok(Err(error.to_string())),
        };
        let counts = self.balance.weight(shape) as f32;
        gradient.iter_mut().for_each(|g| *g *= counts);
        if let Some(blends) = &self.blends {
            let mut generator = draw::generator(self.scene.seed, 5, step);
            let weight = settings.blend_weight / BLENDS_PER_STEP as f64;
            let (count, gradient) = (BLENDS_PER_STEP, &mut gradient);
            let added = blends.add_superpositions(net, count, &mut generator, weight, gradient);
            if let Err(error) = added {
                return Ok(Err(error.to_string()));
            }
        }
        let solution = reached.solution;
        let surface = self.body.surface_positions(&solution.positions);
        let (mean_error, _, _) = distances(&surface, target);
        Ok(Ok(Gradient {
            parameters: gradient,
            nodes: solution.positions,
            step: Step {
                shape,
                loss: value,
                mean_error,
                forward: solution.stats,
                adjoint,
            },
        }))
    }
}

/// The network's answer, and what its reverse pass needs if that is to come.
fn ask<'a, N: Actuator>(
    net: &'a N,
    descriptor: &[f32],
    samples: &'a Samples,
    is_remembered: bool,
) -> std::result::Result<(Output, Option<N::Trace<'a>>), actuation_net::Error> {
    if !is_remembered {
        return Ok((net.evaluate(descriptor, samples)?, None));
    }
    let traced = net.trace(descriptor, samples)?;
    Ok((traced.output().clone(), Some(traced)))
}

/// The gradient by the parameters: through the evaluation that was traced, or through one at `few` samples with their cotangents.
fn parameter_gradient<'a, N: Actuator>(
    net: &N,
    traced: Option<N::Trace<'_>>,
    descriptor: &[f32],
    bar: &OutputCotangent,
    few: impl FnOnce() -> (Samples<'a>, Vec<f32>),
) -> std::result::Result<Vec<f32>, actuation_net::Error> {
    if let Some(traced) = traced {
        return Ok(traced.backward(&bar.actuation, &bar.joint));
    }
    let (samples, own) = few();
    let traced = net.trace(descriptor, &samples)?;
    Ok(traced.backward(&own, &bar.joint))
}

/// Draws `count` of the points that have a cotangent, `[n, 6]`, in proportion to its size there, and divides by how likely each was: the
/// gradient through these alone is in the mean that through all. Returns the points drawn, each once, and their cotangents.
fn few_of<'a>(
    points: &Points,
    bar: &[f32],
    count: usize,
    generator: &mut impl Rng,
) -> (Samples<'a>, Vec<f32>) {
    let (chosen, own) = draw_by_size(bar, count, generator);
    (Samples::some(points, chosen), own)
}

fn draw_by_size(bar: &[f32], count: usize, generator: &mut impl Rng) -> (Vec<usize>, Vec<f32>) {
    let size = |row: &[f32]| {
        row.iter()
            .map(|x| f64::from(*x).powi(2))
            .sum::<f64>()
            .sqrt()
    };
    let rows: Vec<&[f32]> = bar.chunks_exact(ACTUATION_SIZE).collect();
    let sizes: Vec<f64> = rows.iter().map(|row| size(row)).collect();
    let Ok(likely) = WeightedIndex::new(&sizes) else {
        // Nothing goes back from any point.
        return (vec![0], vec![0.0; ACTUATION_SIZE]);
    };
    let mut times = vec![0_u32; sizes.len()];
    (0..count).for_each(|_| times[likely.sample(generator)] += 1);
    let chosen: Vec<usize> = (0..times.len()).filter(|&i| times[i] > 0).collect();
    let share = sizes.iter().sum::<f64>() / count as f64;
    let own = chosen.iter().flat_map(|&i| {
        let factor = (f64::from(times[i]) * share / sizes[i]) as f32;
        rows[i].iter().map(move |x| factor * x)
    });
    let own = own.collect();
    (chosen, own)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;
    use crate::train::network_config;
    use actuation_net::ActuationNet;

    /// `bent` moves the ball less than `long` does: it counts more, by the power asked, and only its gradient does.
    #[test]
    fn a_shape_that_moves_little_counts_more_by_balance() {
        let gradients = |balance: f64| {
            let mut scene = fixture::scene("");
            scene.stage2.balance = balance;
            let body = fixture::body(&scene);
            let shapes = fixture::shapes(&scene, &body);
            let training = shapes.training();
            let moved = |s: &&Shape| {
                let off = s.positions.iter().zip(body.surface.vertices());
                let counted = off.zip(&body.vertex_weights);
                counted
                    .map(|((x, r), a)| a * (x - r).norm_squared())
                    .sum::<f64>()
            };
            let moved: Vec<f64> = training.iter().map(moved).collect();
            let mean = moved.iter().sum::<f64>() / moved.len() as f64;
            let descriptors = training
                .iter()
                .map(|s| shapes.descriptor(&s.positions).unwrap());
            let descriptors: Vec<Vec<f32>> = descriptors.collect();
            let net = ActuationNet::new(&network_config(&scene, &shapes), 1).unwrap();
            let mut simulator =
                ThroughSimulator::new(&body, &scene, &training, &descriptors).unwrap();
            let rest = body.mesh.nodes();
            let of = |shape: usize| simulator.gradient(&net, shape, rest, 0).unwrap().unwrap();
            let found: Vec<Gradient> = (0..training.len()).map(of).collect();
            (found, moved.iter().map(|m| m / mean).collect::<Vec<f64>>())
        };
        let ((alike, shares), (balanced, _)) = (gradients(0.0), gradients(0.5));
        assert!(shares[1] < 0.6 * shares[0], "{shares:?}");
        for ((a, b), share) in alike.iter().zip(&balanced).zip(shares) {
            assert_eq!(a.step.loss, b.step.loss);
            let (factor, size) = (share.powf(-0.5) as f32, largest(&a.parameters));
            let pairs = a.parameters.iter().zip(&b.parameters);
            let off = pairs
                .map(|(a, b)| (factor * a - b).abs())
                .fold(0.0, f32::max);
            assert!(size > 0.0 && off < 1e-5 * factor * size, "{off} {size}");
        }
    }

    fn largest(values: &[f32]) -> f32 {
        values.iter().fold(0.0, |most, x| most.max(x.abs()))
    }

    /// Many draws of few points come to all of them in the mean, and a point with most of the cotangent is nearly always there.
    #[test]
    fn few_points_stand_for_all() {
        let bar: Vec<f32> = (0..60)
            .map(|i| if i / 6 == 4 { 30.0 } else { (i as f32).sin() })
            .collect();
        let mut generator = draw::generator(1, 6, 0);
        let (mut sum, mut seen) = (vec![0.0; 60], 0);
        for _ in 0..4000 {
            let (chosen, scaled) = draw_by_size(&bar, 5, &mut generator);
            assert!(chosen.len() <= 5 && scaled.len() == 6 * chosen.len());
            assert!(chosen.is_sorted());
            seen += usize::from(chosen.contains(&4));
            for (i, row) in chosen.iter().zip(scaled.chunks(6)) {
                row.iter()
                    .zip(&mut sum[6 * i..6 * i + 6])
                    .for_each(|(x, s)| *s += f64::from(*x) / 4000.0);
            }
        }
        assert!(seen > 3990, "{seen}");
        for (mean, x) in sum.iter().zip(&bar) {
            assert!(
                (mean - f64::from(*x)).abs() < 0.03 * f64::from(x.abs()) + 0.15,
                "{mean} {x}"
            );
        }
    }

    #[test]
    fn no_cotangent_at_all_is_no_gradient() {
        let (chosen, scaled) = draw_by_size(&[0.0; 18], 2, &mut draw::generator(1, 6, 0));
        assert_eq!((chosen.len(), scaled), (1, vec![0.0; 6]));
    }
}
