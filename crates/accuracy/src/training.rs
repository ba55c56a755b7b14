//! What accuracy in training costs: loss against seconds, with tolerances loosened by factors of ten.

use crate::choice::Choice;
use crate::error::Result;
use crate::subject::Subject;
use actuation_net::{ActuationNet, AdamState};
use nalgebra::Vector3;
use pd_solver::Method;
use serde::Serialize;
use std::time::Instant;
use trainer::body::Body;
use trainer::scene::{ActuationPer, Scene};
use trainer::shapes::Shape;
use trainer::stage2::{Outcome, ThroughSimulator, steps};

/// How tightly training is done.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Tightness {
    /// Which knob differs from the tightest, in words.
    pub name: String,
    /// Accuracy of the equilibria, in diagonals.
    pub accuracy: f64,
    /// Relative residual of the adjoint.
    pub adjoint_tolerance: f64,
    /// Share of the points that the gradient goes through; 1 for all.
    pub points: f64,
}

/// One training.
#[derive(Debug, Clone, Serialize)]
pub struct Course {
    /// How tight.
    pub tightness: Tightness,
    /// Largest angle, in degrees, over the shapes, between its gradient at the start and the tightest one.
    pub angle: f64,
    /// Seconds and mean loss over all shapes, after each pass.
    pub passes: Vec<(f64, f64)>,
    /// Mean error after training, simulated tightly, in diagonals.
    pub error: f64,
    /// Steps that were dropped.
    pub dropped: usize,
}

const TIGHT: f64 = 1e-7;
const TIGHT_ADJOINT: f64 = 1e-6;

/// The tightest, and each knob loosened by itself; the last has all of them as loose as defaults have them.
pub fn tightnesses() -> Vec<Tightness> {
    let of = |name: String, accuracy, adjoint_tolerance, points| Tightness {
        name,
        accuracy,
        adjoint_tolerance,
        points,
    };
    let mut all = vec![of("tight".into(), 1e-6, TIGHT_ADJOINT, 1.0)];
    for accuracy in [1e-5, 1e-4, 1e-3, 1e-2] {
        all.push(of(
            format!("equilibria {accuracy:.0e}"),
            accuracy,
            TIGHT_ADJOINT,
            1.0,
        ));
    }
    for tolerance in [1e-4, 1e-3, 1e-2, 1e-1, 5e-1] {
        all.push(of(format!("adjoint {tolerance:.0e}"), 1e-6, tolerance, 1.0));
    }
    for points in [0.25, 0.05, 0.01] {
        all.push(of(
            format!("{:.0} % of the points", 100.0 * points),
            1e-6,
            TIGHT_ADJOINT,
            points,
        ));
    }
    all.push(of("1e-4, 1e-2, 25 %".into(), 1e-4, 1e-2, 0.25));
    all
}

/// Trains the subject's field for some passes over its shapes, once for each tightness, always from the same start.
///
/// # Errors
/// When something does not fit.
pub fn courses(
    subject: &Subject,
    passes: usize,
    mut told: impl FnMut(&Course),
) -> Result<Vec<Course>> {
    let choice = Choice {
        element_size: subject.scene.mesh.element_size / subject.diagonal,
        samples: subject.scene.mesh.samples,
        actuation: ActuationPer::Sample,
        width: subject.fields[0].width,
        method: Method::Automatic,
        accuracy: TIGHT,
    };
    let scene = choice.applied(&subject.scene, subject.diagonal);
    let body = subject.body(&scene)?;
    let described = subject.shapes()?;
    let shapes: Vec<&Shape> = described.iter().map(|s| s.0).collect();
    let descriptors: Vec<Vec<f32>> = described.iter().map(|s| s.1.clone()).collect();
    let start = &subject.fields[0].net;
    let case = Case {
        body: &body,
        shapes: &shapes,
        descriptors: &descriptors,
        start,
        warm: vec![body.mesh.nodes().to_vec(); shapes.len()],
        passes,
    };
    let exact = Tightness {
        name: String::new(),
        accuracy: 1e-8,
        adjoint_tolerance: 1e-8,
        points: 1.0,
    };
    let exact = case.gradients(&exact.applied(&scene, &body, passes))?;
    let mut courses = Vec::new();
    for tightness in tightnesses() {
        let course = case.course(tightness, &scene, &exact)?;
        told(&course);
        courses.push(course);
    }
    Ok(courses)
}

impl Tightness {
    fn applied(&self, scene: &Scene, body: &Body, passes: usize) -> Scene {
        let mut scene = scene.clone();
        scene.stage2.accuracy = self.accuracy;
        scene.stage2.adjoint_tolerance = self.adjoint_tolerance;
        scene.stage2.blend_weight = 0.0;
        scene.stage2.epochs = passes;
        scene.stage2.points = match self.points {
            share if share < 1.0 => ((share * body.samples.count() as f64) as usize).max(1),
            _ => 0,
        };
        scene
    }
}

struct Case<'a> {
    body: &'a Body,
    shapes: &'a [&'a Shape],
    descriptors: &'a [Vec<f32>],
    start: &'a ActuationNet,
    warm: Vec<Vec<Vector3<f64>>>,
    passes: usize,
}

impl Case<'_> {
    fn simulator<'b>(&'b self, scene: &'b Scene) -> Result<ThroughSimulator<'b>> {
        let simulator = ThroughSimulator::new(self.body, scene, self.shapes, self.descriptors)?;
        Ok(simulator)
    }

    /// The gradient of each shape at the start, from rest; nothing where a step would be dropped.
    fn gradients(&self, scene: &Scene) -> Result<Vec<Option<Vec<f32>>>> {
        let mut simulator = self.simulator(scene)?;
        let of = |shape: usize| {
            let found = simulator.gradient(self.start, shape, &self.warm[shape], 0)?;
            Ok(found.ok().map(|g| g.parameters))
        };
        (0..self.shapes.len()).map(of).collect()
    }

    fn course(
        &self,
        tightness: Tightness,
        scene: &Scene,
        exact: &[Option<Vec<f32>>],
    ) -> Result<Course> {
        let scene = tightness.applied(scene, self.body, self.passes);
        let own = self.gradients(&scene)?;
        let angles = own
            .iter()
            .zip(exact)
            .map(|(own, exact)| match (own, exact) {
                (Some(own), Some(exact)) => angle(own, exact),
                _ => f64::NAN,
            });
        let angle = angles.fold(
            0.0,
            |most: f64, x| if x > most || x.is_nan() { x } else { most },
        );
        let mut net = self.start.clone();
        let mut adam = AdamState::new(net.parameter_count());
        let mut warm = self.warm.clone();
        let mut simulator = self.simulator(&scene)?;
        let (mut passes, mut dropped) = (Vec::new(), 0);
        let (mut seconds, mut sum) = (0.0, 0.0);
        for step in 0..steps(&scene.stage2, self.shapes.len()) {
            let clock = Instant::now();
            let outcome = simulator.step(&mut net, &mut adam, &mut warm, step)?;
            seconds += clock.elapsed().as_secs_f64();
            match outcome {
                Outcome::Stepped(done) => sum += done.loss,
                Outcome::Dropped(_) => dropped += 1,
            }
            if (step + 1).is_multiple_of(self.shapes.len() as u64) {
                passes.push((seconds, sum / self.shapes.len() as f64));
                sum = 0.0;
            }
        }
        Ok(Course {
            angle,
            passes,
            dropped,
            error: self.error(&scene, &net)?,
            tightness,
        })
    }

    /// Mean error over the shapes, in diagonals, simulated tightly from rest.
    fn error(&self, scene: &Scene, net: &ActuationNet) -> Result<f64> {
        let mut evaluator = trainer::evaluate::Evaluator::new(self.body, scene)?;
        let mut sum = 0.0;
        for (shape, descriptor) in self.shapes.iter().zip(self.descriptors) {
            let result = evaluator.shape(net, shape, descriptor.clone(), None)?;
            sum += result.mean_error / self.body.diagonal;
        }
        Ok(sum / self.shapes.len() as f64)
    }
}

/// Between two gradients, in degrees.
fn angle(a: &[f32], b: &[f32]) -> f64 {
    let dot = |a: &[f32], b: &[f32]| -> f64 {
        let products = a.iter().zip(b).map(|(x, y)| f64::from(*x) * f64::from(*y));
        products.sum()
    };
    let cosine = dot(a, b) / (dot(a, a) * dot(b, b)).sqrt();
    cosine.clamp(-1.0, 1.0).acos().to_degrees()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_are_those_of_geometry() {
        assert!((angle(&[1.0, 0.0], &[1.0, 1.0]) - 45.0).abs() < 1e-5);
        assert!((angle(&[1.0, 0.0], &[-2.0, 0.0]) - 180.0).abs() < 1e-5);
        assert!(angle(&[0.0, 0.0], &[1.0, 0.0]).is_nan());
    }
}
