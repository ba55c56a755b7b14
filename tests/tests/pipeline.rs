//! Gradients through the whole pipeline: network -> actuation and joint -> equilibrium -> loss on the embedded surface, and back,
//! against central differences in which everything is computed again, the equilibrium included.

use actuation_net::{
    ActuationNet, NetworkConfig, OutputCotangent, ParameterTensor, PlainNet, Width,
};
use face_rig::Joint;
use nalgebra::Vector3;
use pd_solver::{
    AdjointOptions, AdjointStatus, EffectSpec, NodeSet, Parameters, Solution, SolveOptions, Solver,
    Status, Stop,
};
use surface_mesh::primitives::icosphere;
use trainer::body::Body;
use trainer::loss::Loss;
use trainer::scene::LossSettings;

/// Relative error of a directional derivative.
const TOLERANCE: f64 = 1e-5;
/// Basis weights that describe the shape to the network.
const DESCRIPTOR: [f64; 3] = [0.8, 0.1, -0.3];
/// Distance of the target from the shape that is reached, per axis.
const ROUGHNESS: f64 = 0.03;
/// Where the ends of the body begin that do not deform freely: one is held, the other hangs on the joint.
const BONES: f64 = 1.0;

/// Everything between the parameters of the network and the loss.
struct Pipeline {
    body: Body,
    solver: Solver,
    net: PlainNet<f64>,
    layout: Vec<ParameterTensor>,
    points: Vec<f64>,
    joint: Joint,
    /// Places in the list of prescribed nodes of those that hang on the joint, and their rest positions.
    hanging: Vec<usize>,
    hanging_rest: Vec<Vector3<f64>>,
    target: Vec<Vector3<f64>>,
    settings: LossSettings,
    /// The last equilibrium: every solve starts from it.
    warm: Vec<Vector3<f64>>,
}

impl Pipeline {
    /// An egg of about a hundred elements, held at one end and moved at the other, against a rough target that it nearly reaches, as
    /// in training: the loss of the normals then counts beside that of the positions.
    fn new(normal_weight: f64) -> Self {
        let egg = icosphere(2, 1.0);
        let stretched = egg
            .vertices()
            .iter()
            .map(|x| Vector3::new(1.4 * x.x, x.y, 0.9 * x.z));
        let surface = egg
            .with_vertices(stretched.collect())
            .expect("as many vertices");
        let mut body = Body::new("egg", surface, 0.36, 8).expect("a closed surface");
        // A mask: some vertices do not count, others more than their area.
        for (v, weight) in body.vertex_weights.iter_mut().enumerate() {
            *weight *= [0.0, 1.0, 2.5][v % 3];
        }
        assert!((60..150).contains(&body.mesh.elements().len()));
        let ends = (0..body.mesh.nodes().len() as u32)
            .filter(|&node| body.mesh.nodes()[node as usize].x.abs() > BONES)
            .collect();
        let effects = [
            EffectSpec::Elasticity { stiffness: 1.0 },
            EffectSpec::Prescribed {
                nodes: NodeSet::Indices(ends),
            },
        ];
        let solver = Solver::new(&body.mesh, &effects).expect("a valid problem");
        let rest = solver.rest_parameters().prescribed;
        let hanging: Vec<usize> = (0..rest.len()).filter(|&i| rest[i].x > 0.0).collect();
        assert!(hanging.len() > 8 && hanging.len() < rest.len());
        let net = lively_net();
        let mut pipeline = Self {
            points: body
                .samples
                .coordinates
                .iter()
                .map(|&x| f64::from(x))
                .collect(),
            joint: Joint::new(Vector3::new(0.9, -0.2, 0.1)),
            hanging_rest: hanging.iter().map(|&i| rest[i]).collect(),
            hanging,
            target: Vec::new(),
            settings: LossSettings {
                normal_weight,
                inversion_weight: 0.02,
                ..LossSettings::default()
            },
            warm: body.mesh.nodes().to_vec(),
            layout: net.parameter_layout().to_vec(),
            net: PlainNet::from_net(&net),
            solver,
            body,
        };
        let (parameters, _) = pipeline.parameters();
        pipeline.warm = pipeline.equilibrium(&parameters).positions;
        let reached = pipeline.body.surface_positions(&pipeline.warm);
        let noise = vectors(9, reached.len());
        pipeline.target = reached
            .iter()
            .zip(noise)
            .map(|(x, n)| x + n * ROUGHNESS)
            .collect();
        pipeline
    }

    /// What the network makes of the shape: actuation at all samples, and the bones where its joint takes them.
    fn parameters(&self) -> (Parameters, [f64; 5]) {
        let output = self.net.evaluate(&DESCRIPTOR, &self.points).expect("fits");
        let mut parameters = self.solver.rest_parameters();
        let rows = output.actuation.chunks_exact(6);
        for (out, row) in parameters.actuation.iter_mut().zip(rows) {
            out.copy_from_slice(row);
        }
        let moved = self.joint.positions(output.joint, &self.hanging_rest);
        for (&i, x) in self.hanging.iter().zip(moved) {
            parameters.prescribed[i] = x;
        }
        (parameters, output.joint)
    }

    /// The equilibrium, as sharp as floating point allows.
    fn equilibrium(&mut self, parameters: &Parameters) -> Solution {
        let sharp = SolveOptions::new(Stop::RelativeGradient(1e-13));
        let solution = self
            .solver
            .solve(parameters, Some(&self.warm), &sharp)
            .expect("fits");
        assert_eq!(solution.status, Status::Converged);
        solution
    }

    fn loss(&mut self, parameters: &Parameters) -> f64 {
        let positions = self.equilibrium(parameters).positions;
        Loss::new(&self.body, &self.target, &self.settings)
            .nodes(&positions)
            .0
    }

    /// The loss as a function of the network alone.
    fn network_loss(&mut self, weights: &[f64]) -> f64 {
        self.net.set_parameters(weights).expect("finite");
        let (parameters, _) = self.parameters();
        self.loss(&parameters)
    }

    /// dL/d(parameters of the solver).
    fn gradient(&mut self, parameters: &Parameters) -> Parameters {
        let solution = self.equilibrium(parameters);
        let loss = Loss::new(&self.body, &self.target, &self.settings);
        let (_, cotangent) = loss.nodes(&solution.positions);
        let exact = AdjointOptions {
            tolerance: 1e-12,
            ..AdjointOptions::default()
        };
        let adjoint = self
            .solver
            .adjoint(parameters, &solution, &cotangent, &exact)
            .expect("fits");
        assert_eq!(adjoint.status, AdjointStatus::Converged);
        adjoint.gradient.expect("converged")
    }

    /// dL/d(parameters of the network), through field and joint.
    fn network_gradient(&mut self) -> Vec<f64> {
        let (parameters, theta) = self.parameters();
        let gradient = self.gradient(&parameters);
        let bones_bar: Vec<_> = self
            .hanging
            .iter()
            .map(|&i| gradient.prescribed[i])
            .collect();
        let joint = self.joint.vjp(theta, &self.hanging_rest, &bones_bar);
        let actuation = gradient.actuation.into_iter().flatten().collect();
        let bar = OutputCotangent { actuation, joint };
        let (_, gradient) = self
            .net
            .evaluate_vjp(&DESCRIPTOR, &self.points, |_| bar)
            .expect("fits");
        gradient
    }
}

/// A network whose every part matters: what starts near zero is drawn anew and larger, so that stretches reach some tens of per cent
/// and the joint turns and slides.
fn lively_net() -> ActuationNet {
    let net =
        ActuationNet::new(&NetworkConfig::new(DESCRIPTOR.len(), Width::W64), 3).expect("valid");
    let mut weights = net.parameters();
    for (index, tensor) in net.parameter_layout().iter().enumerate() {
        let bound = match tensor.name.as_str() {
            name if name.contains("modulation") => 0.08,
            name if name.starts_with("head") => 0.03,
            name if name.starts_with("joint.2") => 0.05,
            _ => continue,
        };
        for (weight, x) in weights[tensor.range.clone()]
            .iter_mut()
            .zip(numbers(index as u64))
        {
            *weight = (bound * x) as f32;
        }
    }
    ActuationNet::from_parameters(net.config(), weights).expect("finite")
}

/// Numbers in [-1, 1] that look random and never change (SplitMix64).
fn numbers(seed: u64) -> impl Iterator<Item = f64> {
    let mut state = seed;
    std::iter::repeat_with(move || {
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    })
}

fn vectors(seed: u64, count: usize) -> Vec<Vector3<f64>> {
    let mut numbers = numbers(seed);
    let mut next = || numbers.next().expect("endless");
    (0..count)
        .map(|_| Vector3::new(next(), next(), next()))
        .collect()
}

/// Fourth-order central difference at zero.
fn difference(step: f64, mut f: impl FnMut(f64) -> f64) -> f64 {
    let near = f(step) - f(-step);
    let far = f(2.0 * step) - f(-2.0 * step);
    (8.0 * near - far) / (12.0 * step)
}

/// Asserts the agreement of a slope found by differences with the one the gradient gives, relative to `scale`.
fn check(what: &str, found: f64, exact: f64, scale: f64) {
    let error = (found - exact).abs() / scale.abs();
    println!("{what}: {exact:.6e}, error {error:.1e}");
    assert!(
        error < TOLERANCE,
        "{what}: {found:e} for {exact:e}, error {error:e}"
    );
}

/// The gradient by what the solver takes: along a random direction over all entries relative to the slope itself, and single entries
/// relative to the largest one.
fn solver_parameters(normal_weight: f64) {
    let mut pipeline = Pipeline::new(normal_weight);
    let (parameters, _) = pipeline.parameters();
    let gradient = pipeline.gradient(&parameters);
    let actuation: Vec<f64> = gradient.actuation.iter().flatten().copied().collect();
    let prescribed: Vec<f64> = gradient
        .prescribed
        .iter()
        .flat_map(|v| [v.x, v.y, v.z])
        .collect();
    let largest = |v: &[f64]| v.iter().fold(0.0f64, |a, x| a.max(x.abs()));
    let along = |v: &[f64], d: &[f64]| -> f64 { v.iter().zip(d).map(|(a, b)| a * b).sum() };

    let direction: Vec<f64> = numbers(1).take(actuation.len()).collect();
    let found = difference(1e-3, |t| {
        let mut moved = parameters.clone();
        let entries = moved.actuation.iter_mut().flatten().zip(&direction);
        entries.for_each(|(b, d)| *b += t * d);
        pipeline.loss(&moved)
    });
    let exact = along(&actuation, &direction);
    check("actuation, random direction", found, exact, exact);
    let middle = actuation.len() / 2;
    for entry in (middle..middle + 6).chain([0, middle / 2 + 3, middle + middle / 2 + 1]) {
        let found = difference(4e-3, |t| {
            let mut moved = parameters.clone();
            moved.actuation[entry / 6][entry % 6] += t;
            pipeline.loss(&moved)
        });
        check(
            "actuation, one entry",
            found,
            actuation[entry],
            largest(&actuation),
        );
    }

    let direction = vectors(2, parameters.prescribed.len());
    let found = difference(1e-3, |t| {
        let mut moved = parameters.clone();
        let nodes = moved.prescribed.iter_mut().zip(&direction);
        nodes.for_each(|(x, d)| *x += d * t);
        pipeline.loss(&moved)
    });
    let flat: Vec<f64> = direction.iter().flat_map(|v| [v.x, v.y, v.z]).collect();
    let exact = along(&prescribed, &flat);
    check("prescribed, random direction", found, exact, exact);
    for entry in [0, 17, prescribed.len() - 1] {
        let found = difference(4e-3, |t| {
            let mut moved = parameters.clone();
            moved.prescribed[entry / 3][entry % 3] += t;
            pipeline.loss(&moved)
        });
        check(
            "prescribed, one entry",
            found,
            prescribed[entry],
            largest(&prescribed),
        );
    }
}

/// The gradient by the network: along a random direction over all parameters, and one within every tensor.
fn network_parameters(normal_weight: f64) {
    let mut pipeline = Pipeline::new(normal_weight);
    let weights = pipeline.net.parameters().to_vec();
    let layout = pipeline.layout.clone();
    let gradient = pipeline.network_gradient();
    let mut along = |what: &str, direction: &[f64], entries: usize| {
        // A phase collects as many changes as a row has entries, so the step shrinks as their sum grows.
        let step = 1e-3 / (entries as f64).sqrt();
        let found = difference(step, |t| {
            let moved: Vec<f64> = weights
                .iter()
                .zip(direction)
                .map(|(w, d)| w + t * d)
                .collect();
            pipeline.network_loss(&moved)
        });
        let exact: f64 = gradient.iter().zip(direction).map(|(g, d)| g * d).sum();
        check(what, found, exact, exact);
    };
    let all: Vec<f64> = numbers(4).take(weights.len()).collect();
    along("all tensors", &all, weights.len());
    for (index, tensor) in layout.iter().enumerate() {
        let mut direction = vec![0.0; weights.len()];
        let part = &mut direction[tensor.range.clone()];
        part.iter_mut()
            .zip(numbers(100 + index as u64))
            .for_each(|(d, x)| *d = x);
        along(&tensor.name, &direction, tensor.range.len());
    }
}

#[test]
fn by_actuation_and_bones() {
    solver_parameters(0.0);
}

#[test]
fn by_actuation_and_bones_with_normals() {
    solver_parameters(1.0);
}

#[test]
fn by_the_network() {
    network_parameters(0.0);
}

#[test]
fn by_the_network_with_normals() {
    network_parameters(1.0);
}
