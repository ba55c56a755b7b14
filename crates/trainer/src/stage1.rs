//! Stage 1: what actuation would each target need? Springs pull the passive body onto it, and the network learns the stretch
//! that appears.
//!
//! With F = R S at a sample of the pulled body, A = S makes `F - R(F A) A = F - R A = 0`: the pulled shape has zero energy under
//! this actuation, so what remains is the softness of the springs and the error of the network.

use crate::actuator::{Actuator, Points, Reverse, Samples};
use crate::body::Body;
use crate::draw;
use crate::error::Result;
use crate::focus::{Focus, TIMES};
use crate::hanging::Hanging;
use crate::loss::distances;
use crate::progress::Phase;
use crate::scene::{Scene, Stage1};
use crate::shapes::Shape;
use crate::table::mean_of;
use actuation_net::{Adam, AdamState, JOINT_SIZE};
use nalgebra::{Matrix3, Vector3};
use pd_solver::{
    EffectSpec, SolveOptions, Solver, SpringPoints, Status, Stop, deformation_gradients,
};
use rand::Rng;

/// What an error of the joint counts beside one of the actuation: with 1, the jaw lags behind the flesh.
const JOINT_WEIGHT: f64 = 10.0;

/// The shortest that an actuation of stage 1 wants material to be. Where the pulled body is squeezed flat or turned inside out, its own
/// stretch would have the network want that too.
const LEAST_STRETCH: f64 = 0.2;

/// `weight` times the squared error of the joint's answer and its derivative; nothing where no answer is known.
fn joint_misfit(
    answer: &[f32; JOINT_SIZE],
    wanted: JointAnswer,
    weight: f64,
) -> (f64, [f32; JOINT_SIZE]) {
    let mut value = 0.0;
    let mut bar = [0.0; JOINT_SIZE];
    for (k, wanted) in wanted.iter().flatten().enumerate() {
        let off = f64::from(answer[k] - wanted);
        value += JOINT_WEIGHT * weight * off * off;
        bar[k] = (2.0 * JOINT_WEIGHT * weight * off) as f32;
    }
    (value, bar)
}

/// The network's answer for the joint, where something hangs on it.
pub type JointAnswer = Option<[f32; JOINT_SIZE]>;

/// A shape pulled into place, and the actuation that holds it there.
pub struct Pulled {
    /// Node positions.
    pub nodes: Vec<Vector3<f64>>,
    /// `b` per sample, `[elements * samples, 6]`.
    pub actuation: Vec<f32>,
    /// What the network has to answer for the joint; absent where nothing hangs on it.
    pub joint: Option<[f32; JOINT_SIZE]>,
}

/// Pulls the passive body onto every shape, with the bones moved as in the shape; `between` is asked before each whether to go on.
///
/// # Errors
/// When the effects do not fit the body, and what `between` returns. A pull that does not converge is used as far as it came, and said.
pub fn pull(
    body: &Body,
    scene: &Scene,
    shapes: &[&Shape],
    mut between: impl FnMut() -> Result<()>,
) -> Result<Vec<Pulled>> {
    let mut solver = Solver::new(&body.mesh, &pulling_effects(body, scene)?)?;
    let hanging = Hanging::new(body, &[], &solver);
    let options = SolveOptions::new(Stop::Accuracy(scene.training_accuracy(body.diagonal)));
    let mut phase = Phase::new("targets", shapes.len() as u64, 0);
    let (mut loose, mut left) = (Vec::new(), Vec::new());
    let mut all = Vec::new();
    for shape in shapes {
        between()?;
        let mut parameters = solver.rest_parameters();
        parameters.spring_targets.clone_from(&shape.positions);
        let theta = hanging.as_ref().zip(shape.joint);
        if let Some((hanging, theta)) = &theta {
            hanging.place(*theta, &mut parameters);
        }
        let solution = solver.solve(&parameters, None, &options)?;
        if solution.status != Status::Converged {
            loose.push(shape.name.as_str());
        }
        let reached = body.surface_positions(&solution.positions);
        left.push(distances(&reached, &shape.positions).0);
        let gradients = deformation_gradients(&body.mesh, &solution.positions);
        let stretch = |f: &Matrix3<f64>| {
            let s = at_least(&polar_grad::polar(f).stretch, LEAST_STRETCH) - Matrix3::identity();
            polar_grad::symmetric_entries(&s).map(|x| x as f32)
        };
        all.push(Pulled {
            actuation: gradients.iter().flat_map(stretch).collect(),
            nodes: solution.positions,
            joint: theta.map(|(hanging, theta)| hanging.answer(&theta)),
        });
        phase.step(|| shape.name.clone());
    }
    let left = 100.0 * mean_of(left.into_iter()) / body.diagonal;
    let mut word = format!(
        "{} shapes pulled into place, to {left:.3} % of the diagonal in the mean",
        shapes.len()
    );
    if !loose.is_empty() {
        word += &format!("; not to the accuracy asked: {}", loose.join(", "));
    }
    phase.finish(&word);
    Ok(all)
}

/// A symmetric matrix whose eigenvalues below `least` are raised to it.
fn at_least(s: &Matrix3<f64>, least: f64) -> Matrix3<f64> {
    if s.symmetric_eigenvalues().min() >= least {
        return *s;
    }
    let mut eigen = s.symmetric_eigen();
    eigen.eigenvalues.apply(|x| *x = x.max(least));
    eigen.recompose()
}

/// Elasticity and prescribed nodes of the scene, and a spring at every surface vertex.
fn pulling_effects(body: &Body, scene: &Scene) -> Result<Vec<EffectSpec>> {
    let is_kept = |e: &&EffectSpec| {
        matches!(
            e,
            EffectSpec::Elasticity { .. } | EffectSpec::Prescribed { .. }
        )
    };
    let mut effects = body.effects(scene)?;
    effects.retain(|e| is_kept(&e));
    let elasticity = effects.iter().find_map(|e| match e {
        EffectSpec::Elasticity { stiffness } => Some(*stiffness),
        _ => None,
    });
    let per_area = scene.stage1.spring_stiffness / body.mesh.element_size();
    effects.push(EffectSpec::Springs {
        points: SpringPoints::Embedded {
            points: body.embedding.vertices().to_vec(),
            factors: body.surface.vertex_areas(),
        },
        stiffness: per_area * elasticity.unwrap_or(1.0),
    });
    Ok(effects)
}

/// Steps of the whole stage.
pub fn steps(settings: &Stage1, shapes: usize) -> u64 {
    (settings.epochs * shapes.div_ceil(settings.batch)) as u64
}

/// The regression of one batch of shapes at a few sample points each.
pub struct Regression<'a> {
    /// All samples of the body.
    pub points: &'a Points,
    /// Descriptor of every shape.
    pub descriptors: &'a [Vec<f32>],
    /// Actuation of every shape.
    pub targets: &'a [Pulled],
    /// Which of these shapes each weight of a descriptor belongs to.
    pub basis: &'a [usize],
    /// Which points are drawn and what each shape counts.
    pub focus: &'a Focus,
    /// Settings of the stage.
    pub settings: &'a Stage1,
    /// Seed of the scene.
    pub seed: u64,
}

/// What the network is to answer to a descriptor at some samples.
struct Lesson<'a> {
    descriptor: &'a [f32],
    /// Six values per sample.
    actuation: &'a [f32],
    joint: JointAnswer,
}

/// Shapes of the basis, added with weights.
#[cfg_attr(test, derive(Debug, PartialEq))]
struct Superposition {
    /// The weights.
    descriptor: Vec<f32>,
    actuation: Vec<f32>,
    joint: JointAnswer,
    /// What it counts, by its members.
    counts: f64,
}

impl Superposition {
    fn lesson(&self) -> Lesson<'_> {
        Lesson {
            descriptor: &self.descriptor,
            actuation: &self.actuation,
            joint: self.joint,
        }
    }
}

impl Regression<'_> {
    /// Does step number `step` and returns the loss before it: the mean squared Frobenius distance of the actuations
    /// at the points drawn, by the weights of the shapes.
    ///
    /// # Errors
    /// Says why the step is dropped, when the network's answer, the loss or the gradient is not finite; nothing has changed then.
    pub fn step(
        &self,
        net: &mut impl Actuator,
        adam: &mut AdamState,
        step: u64,
    ) -> std::result::Result<f64, String> {
        self.try_step(net, adam, step)
            .map_err(|error| error.to_string())?
            .ok_or_else(|| "the loss is not finite".to_string())
    }

    /// The loss before the step; none, and no step, where it is not finite.
    fn try_step(
        &self,
        net: &mut impl Actuator,
        adam: &mut AdamState,
        step: u64,
    ) -> Result<Option<f64>> {
        let shapes = self.descriptors.len();
        let per_epoch = shapes.div_ceil(self.settings.batch) as u64;
        let (epoch, place) = (step / per_epoch, (step % per_epoch) as usize);
        let order = draw::order(&mut draw::generator(self.seed, 1, epoch), shapes);
        let mut generator = draw::generator(self.seed, 2, step);
        let batch: Vec<usize> = (order.chunks(self.settings.batch).nth(place))
            .expect("a batch of the epoch")
            .to_vec();
        let mut gradient = vec![0.0; net.parameter_count()];
        let count = (batch.len() + self.settings.blends) as f64;
        let mut loss = 0.0;
        for &shape in &batch {
            let chosen = self.focus.draw(&mut generator, self.settings.points);
            let target = gather(&self.targets[shape].actuation, &chosen, 6);
            let lesson = Lesson {
                descriptor: &self.descriptors[shape],
                actuation: &target,
                joint: self.targets[shape].joint,
            };
            let weight = self.focus.balance().weight(shape) / count;
            loss += self.add_misfit(net, &chosen, &lesson, weight, &mut gradient)?;
        }
        let blends = self.settings.blends;
        loss += self.add_superpositions(net, blends, &mut generator, 1.0 / count, &mut gradient)?;
        if !loss.is_finite() {
            return Ok(None);
        }
        let lr = draw::decayed(
            self.settings.learning_rate,
            step,
            steps(self.settings, shapes),
        );
        let adam_settings = Adam {
            lr,
            ..Adam::default()
        };
        adam_settings.step(adam, net.parameters_mut(), &gradient)?;
        Ok(Some(loss))
    }

    /// Adds the gradient of the loss of random superpositions, each with a weight, and returns that loss.
    ///
    /// The codes of training shapes alone pin the network at a few places. A superposition of two to four shapes of the basis, its
    /// code the weights and its actuation the weighted sum of theirs, says what the network should do between and beyond them: half the
    /// code is half the actuation, which bends half as far.
    ///
    /// # Errors
    /// When the network's answer is not finite.
    pub fn add_superpositions(
        &self,
        net: &impl Actuator,
        count: usize,
        generator: &mut impl Rng,
        weight: f64,
        gradient: &mut [f32],
    ) -> Result<f64> {
        let mut loss = 0.0;
        for _ in 0..count {
            let chosen = self.focus.draw(generator, self.settings.points);
            let sum = self.superposition(&chosen, generator);
            loss += self.add_misfit(net, &chosen, &sum.lesson(), weight * sum.counts, gradient)?;
        }
        Ok(loss)
    }

    /// Random weights over the basis, two to four of them not zero, with the weighted sums at some samples.
    fn superposition(&self, chosen: &[usize], generator: &mut impl Rng) -> Superposition {
        let size = self.basis.len();
        let members = generator.random_range(2..=4).min(size);
        let order = draw::order(generator, size);
        let mut descriptor = vec![0.0; size];
        let mut actuation = vec![0.0; chosen.len() * 6];
        let mut joint: JointAnswer = None;
        let members = &order[..members];
        for &member in members {
            let weight = generator.random_range(0.0..=1.0);
            descriptor[member] = weight;
            let part = gather(&self.targets[self.basis[member]].actuation, chosen, 6);
            let sums = actuation.iter_mut().zip(part);
            sums.for_each(|(sum, part)| *sum += weight * part);
            if let Some(own) = self.targets[self.basis[member]].joint {
                let sum = joint.get_or_insert_default();
                sum.iter_mut().zip(own).for_each(|(s, x)| *s += weight * x);
            }
        }
        let members = members.iter().map(|&member| self.basis[member]);
        let counts = self.focus.balance().weight_of(members);
        Superposition {
            descriptor,
            actuation,
            joint,
            counts,
        }
    }

    /// Adds the gradient of `weight` times the mean squared distance of the network from a lesson at some samples.
    fn add_misfit(
        &self,
        net: &impl Actuator,
        chosen: &[usize],
        lesson: &Lesson,
        weight: f64,
        gradient: &mut [f32],
    ) -> Result<f64> {
        let samples = Samples::some(self.points, chosen.to_vec());
        let scale = weight / chosen.len() as f64;
        let traced = net.trace(lesson.descriptor, &samples)?;
        let output = traced.output();
        let (value, actuation_bar) = misfit(&output.actuation, lesson.actuation, scale);
        let (joint_value, joint_bar) = joint_misfit(&output.joint, lesson.joint, weight);
        let part = traced.backward(&actuation_bar, &joint_bar);
        gradient.iter_mut().zip(part).for_each(|(g, p)| *g += p);
        Ok(value + joint_value)
    }
}

/// Sum of `scale |A - A_target|^2` over points and its derivative: off-diagonal entries stand twice in the matrix.
fn misfit(actuation: &[f32], target: &[f32], scale: f64) -> (f64, Vec<f32>) {
    let mut value = 0.0;
    let pairs = actuation.iter().zip(target).enumerate();
    let bar = pairs.map(|(i, (a, t))| {
        let off = f64::from(*a) - f64::from(*t);
        value += scale * TIMES[i % 6] * off * off;
        (2.0 * scale * TIMES[i % 6] * off) as f32
    });
    let bar = bar.collect();
    (value, bar)
}

/// The rows `chosen` of `values`, each `width` long.
pub(crate) fn gather(values: &[f32], chosen: &[usize], width: usize) -> Vec<f32> {
    let rows = chosen.iter().map(|&i| &values[i * width..(i + 1) * width]);
    rows.flatten().copied().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;
    use crate::loss::distances;
    use crate::simulator::set_actuation;
    use actuation_net::{ActuationNet, NetworkConfig, Width};

    fn norm(gradient: &[Vector3<f64>]) -> f64 {
        gradient
            .iter()
            .map(Vector3::norm_squared)
            .sum::<f64>()
            .sqrt()
    }

    fn pulled(scene: &Scene) -> (Body, Vec<Shape>, Vec<Pulled>) {
        let body = fixture::body(scene);
        let shapes = fixture::shapes(scene, &body).all;
        let all: Vec<&Shape> = shapes.iter().collect();
        let pulled = pull(&body, scene, &all, || Ok(())).unwrap();
        (body, shapes, pulled)
    }

    /// The claim that stage 1 stands on: F - R(F S) S = 0.
    #[test]
    fn a_pulled_shape_rests_under_its_own_stretch() {
        let scene = fixture::scene("");
        let (body, shapes, pulled) = pulled(&scene);
        let mut solver = Solver::new(&body.mesh, &scene.effects).unwrap();
        let passive = solver.rest_parameters();
        for (shape, pulled) in shapes.iter().zip(&pulled) {
            let reached = body.surface_positions(&pulled.nodes);
            let (far, _, _) = distances(body.surface.vertices(), &shape.positions);
            let (near, _, _) = distances(&reached, &shape.positions);
            assert!(near < 0.3 * far, "{}: {near} {far}", shape.name);
            let mut actuated = passive.clone();
            set_actuation(&mut actuated, &pulled.actuation);
            let (energy, gradient) = solver.energy_gradient(&actuated, &pulled.nodes).unwrap();
            let (full, pull) = solver.energy_gradient(&passive, &pulled.nodes).unwrap();
            // The actuation is in single precision.
            assert!(energy < 1e-11 * full, "{}: {energy} {full}", shape.name);
            let (left, pull) = (norm(&gradient), norm(&pull));
            assert!(left < 1e-5 * pull, "{}: {left} {pull}", shape.name);
        }
    }

    #[test]
    fn the_pull_leaves_out_gravity() {
        let gravity = "[[effects]]\ntype = \"gravity\"\nacceleration = [0, -1, 0]\ndensity = 1\n";
        let (_, _, with) = pulled(&fixture::scene(gravity));
        let (_, _, without) = pulled(&fixture::scene(""));
        assert!(with.iter().zip(&without).all(|(a, b)| a.nodes == b.nodes));
    }

    #[test]
    fn stiffer_springs_follow_more_closely() {
        let off = |stiffness: f64| {
            let mut scene = fixture::scene("");
            scene.stage1.spring_stiffness = stiffness;
            let (body, shapes, pulled) = pulled(&scene);
            let reached = body.surface_positions(&pulled[0].nodes);
            distances(&reached, &shapes[0].positions).0
        };
        assert!(off(100.0) < 0.5 * off(1.0));
    }

    #[test]
    fn a_pull_ends_when_asked() {
        let scene = fixture::scene("");
        let body = fixture::body(&scene);
        let shapes = fixture::shapes(&scene, &body).all;
        let stop = || crate::TrainerError::EvaluationStopped;
        let ended = pull(&body, &scene, &[&shapes[0]], || Err(stop()));
        assert!(ended.is_err());
    }

    #[test]
    fn superpositions_add_up_and_stay_within_bounds() {
        let scene = fixture::scene("");
        let (body, _, pulled) = pulled(&scene);
        let descriptors = vec![vec![1.0, 0.0], vec![0.0, 1.0]];
        let regression = Regression {
            points: &body.samples,
            descriptors: &descriptors,
            targets: &pulled,
            basis: &[0, 1],
            focus: &Focus::new(&pulled, 0.0, 0.0),
            settings: &scene.stage1,
            seed: 5,
        };
        let (mut one, mut same) = (draw::generator(5, 4, 0), draw::generator(5, 4, 0));
        for _ in 0..30 {
            let chosen = [0, 7, 3];
            let sum = regression.superposition(&chosen, &mut one);
            let again = regression.superposition(&chosen, &mut same);
            assert_eq!(sum, again);
            assert_eq!((sum.joint, sum.counts), (None, 1.0));
            let weights = &sum.descriptor;
            assert!(weights.iter().all(|w| (0.0..=1.0).contains(w)));
            for (i, &point) in chosen.iter().enumerate() {
                for k in 0..6 {
                    let of = |shape: usize| pulled[shape].actuation[6 * point + k];
                    let expected = weights[0] * of(0) + weights[1] * of(1);
                    assert!((sum.actuation[6 * i + k] - expected).abs() < 1e-6);
                }
            }
        }
    }

    #[test]
    fn flattened_material_wants_to_be_flat_no_more() {
        let turn = nalgebra::Rotation3::from_euler_angles(0.3, -0.5, 1.1);
        let with = |x: [f64; 3]| turn * Matrix3::from_diagonal(&x.into()) * turn.transpose();
        let (flat, open) = (with([-0.3, 0.05, 1.7]), with([0.25, 0.9, 1.7]));
        assert!((at_least(&flat, 0.2) - with([0.2, 0.2, 1.7])).norm() < 1e-12);
        assert_eq!(at_least(&open, 0.2), open);
    }

    #[test]
    fn the_misfit_is_the_frobenius_distance_of_matrices() {
        let full = |b: &[f32]| {
            let b: Vec<f64> = b.iter().map(|&x| f64::from(x)).collect();
            Matrix3::new(b[0], b[1], b[2], b[1], b[3], b[4], b[2], b[4], b[5])
        };
        let (a, t) = (
            [0.5, 0.25, -1.0, 2.0, 0.125, 0.75],
            [0.0, 1.0, 0.5, 0.25, -0.5, 1.0],
        );
        let (value, bar) = misfit(&a, &t, 0.5);
        assert_eq!(value, 0.5 * (full(&a) - full(&t)).norm_squared());
        for i in 0..6 {
            // Exact in binary, and a quadratic has no error of third order.
            let at = |step: f32| {
                let mut moved = a;
                moved[i] += step;
                misfit(&moved, &t, 0.5).0
            };
            assert_eq!(f64::from(bar[i]), (at(0.125) - at(-0.125)) / 0.25);
        }
    }

    #[test]
    fn regression_comes_nearer_and_depends_on_the_step_alone() {
        let scene = fixture::scene("");
        let (body, _, pulled) = pulled(&scene);
        let settings = Stage1 {
            epochs: 150,
            points: 64,
            learning_rate: 2e-3,
            ..scene.stage1.clone()
        };
        let descriptors = [vec![1.0, 0.0], vec![0.0, 1.0], vec![1.0, 1.0]];
        let regression = Regression {
            points: &body.samples,
            descriptors: &descriptors,
            targets: &pulled,
            basis: &[0, 1],
            focus: &Focus::new(&pulled, 0.0, 0.0),
            settings: &settings,
            seed: 1,
        };
        let config = NetworkConfig {
            descriptor: 2,
            width: Width::W64,
            latent: 4,
            omega: 30.0,
            resolution: None,
        };
        assert_eq!(steps(&settings, 3), 300);
        let start = ActuationNet::new(&config, 1).unwrap();
        let mut net = start.clone();
        let mut adam = AdamState::new(net.parameter_count());
        let losses = (0..300).map(|i| regression.step(&mut net, &mut adam, i).unwrap());
        let losses: Vec<f64> = losses.collect();
        let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
        let (first, last) = (mean(&losses[..10]), mean(&losses[290..]));
        assert!(last < 0.3 * first, "{last} {first}");
        let mut again = start;
        let mut adam = AdamState::new(again.parameter_count());
        assert_eq!(
            regression.step(&mut again, &mut adam, 0).unwrap(),
            losses[0]
        );

        let regression = Regression {
            focus: &Focus::new(&pulled, 0.5, 0.5),
            ..regression
        };
        let mut adam = AdamState::new(again.parameter_count());
        let elsewhere = regression.step(&mut again, &mut adam, 0).unwrap();
        assert_ne!(elsewhere, losses[0]);
    }
}
