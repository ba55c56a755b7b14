//! The knobs: what a user may choose, and what comes of it.

use crate::error::{AccuracyError, Result};
use crate::subject::Subject;
use actuation_net::Width;
use nalgebra::Vector3;
use pd_solver::{Method, SolveOptions, Status, Stop};
use serde::{Deserialize, Serialize};
use std::time::Instant;
use trainer::actuator::{Actuator, Samples};
use trainer::loss::Loss;
use trainer::loss::mean_distance;
use trainer::scene::{ActuationPer, Scene};
use trainer::simulator::Simulator;

/// How one simulation is made. Lengths are shares of the diagonal of the body's bounding box, so that a choice means the same on another body.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Choice {
    /// Edge of an element.
    pub element_size: f64,
    /// Samples of an element.
    pub samples: usize,
    /// Where the network is asked.
    pub actuation: ActuationPer,
    /// Width of the network.
    pub width: Width,
    /// Method of the solver.
    pub method: Method,
    /// Accuracy asked of the solver.
    pub accuracy: f64,
}

impl Choice {
    /// The scene with these settings.
    pub fn applied(&self, scene: &Scene, diagonal: f64) -> Scene {
        let mut scene = scene.clone();
        scene.mesh.element_size = self.element_size * diagonal;
        scene.mesh.samples = self.samples;
        scene.mesh.actuation = self.actuation;
        scene.evaluation.accuracy = self.accuracy;
        scene.evaluation.method = self.method;
        scene
    }

    /// In a few words: element size in the scene's unit, samples, points.
    pub fn words(&self, diagonal: f64) -> String {
        let per = match self.actuation {
            ActuationPer::Sample => "",
            ActuationPer::Element => "/1",
        };
        format!("{:.3} x{}{per}", self.element_size * diagonal, self.samples)
    }
}

/// Seconds that one shape takes, in its parts.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Split {
    /// Network at all points.
    pub network: f64,
    /// Energy and gradient.
    pub local: f64,
    /// The rest of the solve.
    pub global: f64,
    /// Positions of the surface.
    pub surface: f64,
    /// The adjoint of a loss on the surface; not part of a simulation.
    pub adjoint: f64,
}

impl Split {
    /// A simulation: all but the adjoint.
    pub fn simulation(&self) -> f64 {
        self.network + self.local + self.global + self.surface
    }

    fn add(&mut self, other: &Self, weight: f64) {
        self.network += weight * other.network;
        self.local += weight * other.local;
        self.global += weight * other.global;
        self.surface += weight * other.surface;
        self.adjoint += weight * other.adjoint;
    }
}

/// All shapes under one choice.
pub struct Simulated {
    /// Elements of the body.
    pub elements: usize,
    /// Seconds for voxels and solver, once.
    pub setup: f64,
    /// Seconds per shape.
    pub split: Split,
    /// Steps of the solver per shape.
    pub iterations: f64,
    /// Shapes that did not reach the accuracy.
    pub failed: usize,
    /// Largest estimated error over the shapes, in diagonals.
    pub estimated: f64,
    /// The surface in each shape.
    pub surfaces: Vec<Vec<Vector3<f64>>>,
    /// What the vertices count.
    pub weights: Vec<f64>,
    diagonal: f64,
}

impl Simulated {
    /// Simulates all shapes of a subject from rest.
    ///
    /// # Errors
    /// When the choice does not fit the body, or the network's answer is not finite.
    pub fn new(subject: &Subject, choice: &Choice) -> Result<Self> {
        let scene = choice.applied(&subject.scene, subject.diagonal);
        let clock = Instant::now();
        let body = subject.body(&scene)?;
        let mut simulator = Simulator::new(&body, &scene)?;
        let setup = clock.elapsed().as_secs_f64();
        let options = SolveOptions::new(Stop::Accuracy(choice.accuracy * subject.diagonal));
        let options = options.with_method(choice.method).measuring_error();
        let net = &subject.field(choice.width).net;
        let shapes = subject.shapes()?;
        let share = 1.0 / shapes.len() as f64;
        let mut all = Self {
            elements: body.mesh.elements().len(),
            setup,
            split: Split::default(),
            iterations: 0.0,
            failed: 0,
            estimated: 0.0,
            surfaces: Vec::new(),
            weights: body.vertex_weights.clone(),
            diagonal: subject.diagonal,
        };
        for (shape, descriptor) in shapes {
            let clock = Instant::now();
            let answer = Actuator::evaluate(net, &descriptor, &Samples::all(body.actuated()))?;
            let network = clock.elapsed().as_secs_f64();
            let reached = simulator.equilibrium(&answer, None, &options)?;
            let clock = Instant::now();
            let surface = body.surface_positions(&reached.solution.positions);
            let seconds_of_surface = clock.elapsed().as_secs_f64();
            let loss = Loss::new(&body, &shape.positions, &scene.loss);
            let (_, bar) = loss.nodes(&reached.solution.positions);
            let tolerance = scene.stage2.adjoint_tolerance;
            let clock = Instant::now();
            // An adjoint that fails is told by training; here its time alone counts.
            let _ = simulator.cotangent(&reached, &bar, tolerance)?;
            let stats = &reached.solution.stats;
            let split = Split {
                network,
                local: stats.local_seconds,
                global: (stats.seconds - stats.local_seconds).max(0.0),
                surface: seconds_of_surface,
                adjoint: clock.elapsed().as_secs_f64(),
            };
            all.split.add(&split, share);
            all.iterations += share * stats.iterations as f64;
            all.failed += usize::from(reached.solution.status != Status::Converged);
            let estimated = stats.estimated_error.unwrap_or(0.0) / subject.diagonal;
            all.estimated = all.estimated.max(estimated);
            all.surfaces.push(surface);
        }
        Ok(all)
    }

    /// [`Simulated::new`] for what others are measured by.
    ///
    /// # Errors
    /// As there, and when a shape does not converge.
    pub fn reference(subject: &Subject, choice: &Choice, what: &str) -> Result<Self> {
        let simulated = Self::new(subject, choice)?;
        match simulated.failed {
            0 => Ok(simulated),
            _ => Err(AccuracyError::Reference {
                what: what.into(),
                status: Status::IterationLimit,
            }),
        }
    }

    /// Mean distance of the surface from another, in diagonals: of the shape that is farthest.
    pub fn distance(&self, other: &[Vec<Vector3<f64>>]) -> f64 {
        let pairs = self.surfaces.iter().zip(other);
        let distances = pairs.map(|(a, b)| mean_distance(a, b, &self.weights));
        distances.fold(0.0, f64::max) / self.diagonal
    }
}
