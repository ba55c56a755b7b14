//! What training and evaluation of the default starfish repeat, at an element size of 0.06: one step of stage 1, one
//! step of stage 2 (network, equilibrium from a warm start, adjoint, network backwards), and one shape simulated from rest.

use actuation_net::{ActuationNet, AdamState};
use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use std::path::Path;
use std::time::Duration;
use trainer::body::Body;
use trainer::evaluate::Evaluator;
use trainer::focus::Focus;
use trainer::scene::Scene;
use trainer::shapes::{Shapes, load_shapes};
use trainer::stage1::{self, Regression};
use trainer::stage2::{Outcome, ThroughSimulator};
use trainer::train::network_config;

const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../data/scenes");
/// Passes of stage 1 that come first, so that the network is one that training meets.
const EPOCHS: usize = 20;

fn steps(c: &mut Criterion) {
    let folder = Path::new(FOLDER);
    let (mut scene, _) = Scene::read(&folder.join("starfish.toml")).expect("a valid scene");
    scene.mesh.element_size = 0.06;
    scene.stage1.epochs = EPOCHS;
    let inputs = load_shapes(&scene, folder)
        .expect("a valid starfish")
        .shapes;
    let surface = inputs.surface.clone();
    let body = Body::new("starfish", surface, 0.06, scene.mesh.samples).expect("it fits");
    let shapes = Shapes::new(&scene, &inputs, None, &body.vertex_weights).expect("valid shapes");
    let training = shapes.training();
    let descriptor = |s: &&trainer::shapes::Shape| shapes.descriptor(&s.positions).expect("fits");
    let descriptors: Vec<Vec<f32>> = training.iter().map(descriptor).collect();
    let pulled = stage1::pull(&body, &scene, &training, || Ok(())).expect("valid effects");

    let config = network_config(&scene, &shapes);
    let mut net = ActuationNet::new(&config, scene.seed).expect("a valid network");
    let mut adam = AdamState::new(net.parameter_count());
    let regression = Regression {
        points: &body.samples,
        descriptors: &descriptors,
        targets: &pulled,
        basis: &shapes.basis_in_training(),
        focus: &Focus::new(&pulled, scene.stage1.focus, scene.stage1.balance),
        settings: &scene.stage1,
        seed: scene.seed,
    };
    for step in 0..stage1::steps(&scene.stage1, training.len()) {
        let done = regression.step(&mut net, &mut adam, step);
        done.expect("a finite gradient");
    }
    let warm: Vec<_> = pulled.iter().map(|p| p.nodes.clone()).collect();

    let name = format!("starfish, {} elements", body.mesh.elements().len());
    let mut group = c.benchmark_group(name);
    group
        .sample_size(10)
        .warm_up_time(Duration::from_secs(1))
        .measurement_time(Duration::from_secs(5));
    group.bench_function("stage 1, one step", |b| {
        b.iter_batched_ref(
            || (net.clone(), adam.clone()),
            |(net, adam)| regression.step(net, adam, 0).expect("a finite gradient"),
            BatchSize::PerIteration,
        );
    });
    let mut simulator = ThroughSimulator::new(&body, &scene, &training, &descriptors)
        .expect("valid effects")
        .with_blends(&regression);
    group.bench_function("stage 2, one step", |b| {
        b.iter_batched_ref(
            || (net.clone(), adam.clone(), warm.clone()),
            |(net, adam, warm)| {
                let outcome = simulator.step(net, adam, warm, 0).expect("it fits");
                assert!(matches!(outcome, Outcome::Stepped(_)), "a dropped step");
            },
            BatchSize::PerIteration,
        );
    });
    let mut evaluator = Evaluator::new(&body, &scene).expect("valid effects");
    group.bench_function("evaluation, one shape", |b| {
        b.iter(|| {
            let result = evaluator.shape(&net, training[0], descriptors[0].clone(), None);
            result.expect("it fits")
        });
    });
    group.finish();
}

criterion_group!(benches, steps);
criterion_main!(benches);
