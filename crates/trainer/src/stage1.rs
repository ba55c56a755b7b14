//! Stage 1: what actuation would each target need? Springs pull the passive body onto it, and the network learns the stretch
//! that appears.
//!
//! With F = R S at a sample of the pulled body, A = S makes `F - R(F A) A = F - R A = 0`: the pulled shape has zero energy under
//! this actuation, so what remains is the softness of the springs and the error of the network.

use crate::body::{Body, Shape, ShapeSet, Shapes};
use crate::draw;
use crate::error::Result;
use crate::progress::Phase;
use crate::scene::{Scene, Stage1};
use actuation_net::{ActuationNet, Adam, AdamState, OutputCotangent};
use nalgebra::{Matrix3, Vector3};
use pd_solver::{
    EffectSpec, SolveOptions, Solver, SpringPoints, Status, Stop, deformation_gradients,
};
use rand::Rng;

/// A shape pulled into place, and the actuation that holds it there.
pub struct Pulled {
    /// Node positions.
    pub nodes: Vec<Vector3<f64>>,
    /// `b` per sample, `[elements * samples, 6]`.
    pub actuation: Vec<f32>,
}

/// Pulls the passive body onto every shape.
///
/// # Errors
/// When the effects do not fit the body. A pull that does not converge is used as far as it came, and said.
pub fn pull(body: &Body, scene: &Scene, shapes: &[&Shape]) -> Result<Vec<Pulled>> {
    let mut solver = Solver::new(&body.mesh, &pulling_effects(body, scene))?;
    let options = SolveOptions::new(Stop::Accuracy(scene.stage2.accuracy * body.diagonal));
    let mut phase = Phase::new("targets", shapes.len() as u64, 0);
    let mut loose = Vec::new();
    let mut all = Vec::new();
    for shape in shapes {
        let mut parameters = solver.rest_parameters();
        parameters.spring_targets.clone_from(&shape.positions);
        let solution = solver.solve(&parameters, None, &options)?;
        if solution.status != Status::Converged {
            loose.push(shape.name.as_str());
        }
        let gradients = deformation_gradients(&body.mesh, &solution.positions);
        let stretch = |f: &Matrix3<f64>| {
            let s = polar_grad::polar(f).stretch - Matrix3::identity();
            polar_grad::symmetric_entries(&s).map(|x| x as f32)
        };
        all.push(Pulled {
            actuation: gradients.iter().flat_map(stretch).collect(),
            nodes: solution.positions,
        });
        phase.step(|| shape.name.clone());
    }
    let mut word = format!("{} shapes pulled into place", shapes.len());
    if !loose.is_empty() {
        word += &format!("; not to the accuracy asked: {}", loose.join(", "));
    }
    phase.finish(&word);
    Ok(all)
}

/// Blends of two to four shapes of the basis with weights in [0, 1], as surfaces and descriptors: what a blendshape rig would show.
///
/// Training shapes alone only pin the network at a few codes; these say what it should do between and beyond them.
pub fn blends(shapes: &Shapes, count: usize, seed: u64) -> (Vec<Shape>, Vec<Vec<f32>>) {
    let size = shapes.descriptor_size();
    let one = |index: usize| {
        let mut generator = draw::generator(seed, 4, index as u64);
        let members = generator.random_range(2..=4).min(size);
        let mut weights = vec![0.0; size];
        for &member in draw::order(&mut generator, size).iter().take(members) {
            weights[member] = generator.random_range(0.0..=1.0);
        }
        let shape = Shape {
            name: format!("blend {}", index + 1),
            set: ShapeSet::Blend,
            positions: shapes.basis_blend(&weights),
        };
        (shape, weights.iter().map(|&w| w as f32).collect())
    };
    (0..count).map(one).unzip()
}

/// Elasticity and prescribed nodes of the scene, and a spring at every surface vertex.
fn pulling_effects(body: &Body, scene: &Scene) -> Vec<EffectSpec> {
    let is_kept = |e: &&EffectSpec| {
        matches!(
            e,
            EffectSpec::Elasticity { .. } | EffectSpec::Prescribed { .. }
        )
    };
    let mut effects: Vec<EffectSpec> = scene.effects.iter().filter(is_kept).cloned().collect();
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
    effects
}

/// Steps of the whole stage.
pub fn steps(settings: &Stage1, shapes: usize) -> u64 {
    (settings.epochs * shapes.div_ceil(settings.batch)) as u64
}

/// The regression of one batch of shapes at a few sample points each.
pub struct Regression<'a> {
    /// Sample points of the body, `[n, 3]`.
    pub points: &'a [f32],
    /// Descriptor of every shape.
    pub descriptors: &'a [Vec<f32>],
    /// Actuation of every shape.
    pub targets: &'a [Pulled],
    /// Settings of the stage.
    pub settings: &'a Stage1,
    /// Seed of the scene.
    pub seed: u64,
}

impl Regression<'_> {
    /// Does step number `step` and returns the loss before it: the mean squared Frobenius distance of the actuations.
    ///
    /// # Errors
    /// When the gradient is not finite; nothing has changed then.
    pub fn step(&self, net: &mut ActuationNet, adam: &mut AdamState, step: u64) -> Result<f64> {
        let shapes = self.descriptors.len();
        let per_epoch = shapes.div_ceil(self.settings.batch) as u64;
        let (epoch, place) = (step / per_epoch, (step % per_epoch) as usize);
        let order = draw::order(&mut draw::generator(self.seed, 1, epoch), shapes);
        let mut generator = draw::generator(self.seed, 2, step);
        let batch: Vec<usize> = (order.chunks(self.settings.batch).nth(place))
            .expect("a batch of the epoch")
            .to_vec();
        let mut gradient = vec![0.0; net.parameter_count()];
        let mut loss = 0.0;
        for &shape in &batch {
            let n = self.points.len() / 3;
            let chosen = draw::indices(&mut generator, n, self.settings.points);
            let points = gather(self.points, &chosen, 3);
            let target = gather(&self.targets[shape].actuation, &chosen, 6);
            let scale = 1.0 / (chosen.len() * batch.len()) as f64;
            let cotangent = |output: &actuation_net::Output| {
                let (value, actuation) = misfit(&output.actuation, &target, scale);
                loss += value;
                let joint = [0.0; actuation_net::JOINT_SIZE];
                OutputCotangent { actuation, joint }
            };
            let (_, part) = net.evaluate_vjp(&self.descriptors[shape], &points, cotangent)?;
            gradient.iter_mut().zip(part).for_each(|(g, p)| *g += p);
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
        Ok(loss)
    }
}

/// Sum of `scale |A - A_target|^2` over points and its derivative: off-diagonal entries stand twice in the matrix.
fn misfit(actuation: &[f32], target: &[f32], scale: f64) -> (f64, Vec<f32>) {
    const TIMES: [f64; 6] = [1.0, 2.0, 2.0, 1.0, 2.0, 1.0];
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

fn gather(values: &[f32], chosen: &[usize], width: usize) -> Vec<f32> {
    let rows = chosen.iter().map(|&i| &values[i * width..(i + 1) * width]);
    rows.flatten().copied().collect()
}
