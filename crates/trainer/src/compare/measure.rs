//! What is measured of a frame, whatever made it.

use crate::body::Body;
use crate::error::Result;
use crate::evaluate::{ShapeResult, weighted};
use crate::geometry::{Geometry, GeometryMeasure};
use crate::loss::distances;
use crate::shapes::{Shape, ShapeSet, Shapes};
use crate::table::mean_of;
use nalgebra::Vector3;
use pd_solver::Status;
use serde::Serialize;
use std::time::Instant;

/// A frame as a method reaches it.
pub(super) struct Reached {
    /// Positions of the surface's vertices.
    pub surface: Vec<Vector3<f64>>,
    /// Seconds from the descriptor to the surface.
    pub seconds: f64,
    /// Inverted elements, and whether the solver converged; nothing for what has no inside.
    pub simulated: Option<(usize, bool)>,
}

impl From<ShapeResult> for Reached {
    fn from(result: ShapeResult) -> Self {
        let converged = result.status == Status::Converged;
        Self {
            surface: result.surface,
            seconds: result.seconds,
            simulated: Some((result.inverted_elements, converged)),
        }
    }
}

/// All frames as linear blends: neutral plus the weights that the network sees times the displacements of the basis.
pub(super) fn blend(shapes: &Shapes, frames: &[Shape]) -> Result<Vec<Reached>> {
    let reached = frames.iter().map(|frame| {
        let descriptor = shapes.descriptor(&frame.positions)?;
        let clock = Instant::now();
        let surface = shapes.linear(&descriptor);
        Ok(Reached {
            surface,
            seconds: clock.elapsed().as_secs_f64(),
            simulated: None,
        })
    });
    reached.collect()
}

/// One frame by one method.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FrameNumbers {
    /// Name of the frame.
    pub name: String,
    /// What it is for.
    pub set: ShapeSet,
    /// Mean distance from the target, weighted as the loss weights vertices, in scene units.
    pub weighted_error: f64,
    /// Distance that 99 of 100 vertices with a weight do not exceed.
    pub error_p99: f64,
    /// Seconds from the descriptor to the surface.
    pub seconds: f64,
    /// What the surface does not keep.
    #[serde(flatten)]
    pub geometry: Geometry,
    /// Elements with a sample turned inside out; absent for what has no inside.
    pub inverted_elements: Option<usize>,
    /// Whether the solver converged; absent without a solver.
    pub converged: Option<bool>,
}

/// The frames of one set by one method; means over frames.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SetNumbers {
    /// Number of frames.
    pub frames: usize,
    /// Mean of [`FrameNumbers::weighted_error`].
    pub weighted_error: f64,
    /// Mean of [`FrameNumbers::error_p99`].
    pub error_p99: f64,
    /// Mean seconds of a frame.
    pub seconds_per_frame: f64,
    /// What the surfaces do not keep.
    #[serde(flatten)]
    pub geometry: SetGeometry,
    /// Mean number of inverted elements.
    pub inverted_elements: Option<f64>,
    /// Frames whose solve did not converge.
    pub not_converged: Option<usize>,
}

/// What the surfaces of one set do not keep.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SetGeometry {
    /// Mean of the absolute changes of volume, in percent.
    pub volume_change_percent: f64,
    /// The largest of them.
    pub largest_volume_change_percent: f64,
    /// Mean of [`Geometry::crossing_pairs`].
    pub crossing_pairs: f64,
}

impl SetGeometry {
    fn of(all: &[Geometry]) -> Self {
        let volumes = || all.iter().map(|g| g.volume_change_percent.abs());
        Self {
            volume_change_percent: mean_of(volumes()),
            largest_volume_change_percent: volumes().fold(0.0, f64::max),
            crossing_pairs: mean_of(all.iter().map(|g| g.crossing_pairs as f64)),
        }
    }
}

/// What the targets themselves do not keep, by set.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TargetNumbers {
    /// Of the frames that were trained on.
    pub train: Option<SetGeometry>,
    /// Of all others.
    pub held_out: Option<SetGeometry>,
}

/// Everything about one method.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MethodNumbers {
    /// Its name.
    pub method: &'static str,
    /// Numbers that it keeps: parameters of a network, displacements of a basis.
    pub numbers_stored: usize,
    /// Seconds of training; absent where nothing is trained.
    pub training_seconds: Option<f64>,
    /// The frames that were trained on.
    pub train: Option<SetNumbers>,
    /// All others.
    pub held_out: Option<SetNumbers>,
    /// Every frame.
    pub frames: Vec<FrameNumbers>,
}

/// Measures surfaces of one body.
pub(super) struct Measure<'a> {
    body: &'a Body,
    geometry: GeometryMeasure<'a>,
}

impl<'a> Measure<'a> {
    pub fn new(body: &'a Body) -> Self {
        Self {
            body,
            geometry: GeometryMeasure::new(&body.surface),
        }
    }

    /// What the targets do not keep.
    pub fn targets(&self, frames: &[Shape]) -> Result<TargetNumbers> {
        let of = |trained: bool| -> Result<Option<SetGeometry>> {
            let set = frames.iter().filter(|f| is_trained(f.set) == trained);
            let all: Vec<Geometry> = set
                .map(|frame| self.geometry.of(&frame.positions))
                .collect::<Result<_>>()?;
            Ok((!all.is_empty()).then(|| SetGeometry::of(&all)))
        };
        Ok(TargetNumbers {
            train: of(true)?,
            held_out: of(false)?,
        })
    }

    /// What a method makes of the frames.
    pub fn method(
        &self,
        method: &'static str,
        numbers_stored: usize,
        training_seconds: Option<f64>,
        frames: &[Shape],
        reached: &[Reached],
    ) -> Result<MethodNumbers> {
        let numbers = frames.iter().zip(reached).map(|(f, r)| self.frame(f, r));
        let frames = numbers.collect::<Result<Vec<_>>>()?;
        Ok(MethodNumbers {
            method,
            numbers_stored,
            training_seconds,
            train: of_set(&frames, true),
            held_out: of_set(&frames, false),
            frames,
        })
    }

    fn frame(&self, frame: &Shape, reached: &Reached) -> Result<FrameNumbers> {
        let (_, _, all) = distances(&reached.surface, &frame.positions);
        let (weighted_error, error_p99) = weighted(&all, &self.body.vertex_weights);
        Ok(FrameNumbers {
            name: frame.name.clone(),
            set: frame.set,
            weighted_error,
            error_p99,
            seconds: reached.seconds,
            geometry: self.geometry.of(&reached.surface)?,
            inverted_elements: reached.simulated.map(|(inverted, _)| inverted),
            converged: reached.simulated.map(|(_, converged)| converged),
        })
    }
}

fn is_trained(set: ShapeSet) -> bool {
    set == ShapeSet::Train
}

/// Sums up the frames that were trained on, or the others.
fn of_set(frames: &[FrameNumbers], trained: bool) -> Option<SetNumbers> {
    let set: Vec<&FrameNumbers> = (frames.iter())
        .filter(|f| is_trained(f.set) == trained)
        .collect();
    let first = set.first()?;
    let mean = |of: fn(&FrameNumbers) -> f64| mean_of(set.iter().map(|f| of(f)));
    let geometry: Vec<Geometry> = set.iter().map(|f| f.geometry).collect();
    let inverted = || set.iter().filter_map(|f| f.inverted_elements);
    let failed = || set.iter().filter(|f| f.converged == Some(false));
    Some(SetNumbers {
        frames: set.len(),
        weighted_error: mean(|f| f.weighted_error),
        error_p99: mean(|f| f.error_p99),
        seconds_per_frame: mean(|f| f.seconds),
        geometry: SetGeometry::of(&geometry),
        inverted_elements: (first.inverted_elements).map(|_| mean_of(inverted().map(|n| n as f64))),
        not_converged: first.converged.map(|_| failed().count()),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;

    /// A basis shape is met, and a shape that nothing of the basis reaches is as far off as it was moved.
    #[test]
    fn linear_blends_meet_the_basis_and_miss_what_lies_outside_it() {
        let scene = fixture::scene("");
        let body = fixture::body(&scene);
        let shapes = fixture::shapes(&scene, &body);
        let mut frames = shapes.all.clone();
        // Every vertex goes 0.25 to the side; weights that do not fit stay at zero where that is all that helps.
        let mut aside = frames[0].clone();
        aside.set = ShapeSet::HeldOut;
        let aside_of = |x: &Vector3<f64>| x + Vector3::new(0.0, 0.0, 0.25);
        aside.positions = body.surface.vertices().iter().map(aside_of).collect();
        frames.push(aside);
        let measure = Measure::new(&body);
        let linear = blend(&shapes, &frames).unwrap();
        let method = measure.method("linear", 1, None, &frames, &linear).unwrap();
        for basis in &method.frames[..2] {
            assert!(basis.weighted_error < 1e-5, "{basis:?}");
        }
        assert!((method.frames[3].weighted_error - 0.25).abs() < 1e-3);
        assert!((method.frames[3].error_p99 - 0.25).abs() < 1e-3);
        let held_out = method.held_out.unwrap();
        assert_eq!(held_out.frames, 1);
        assert_eq!(held_out.weighted_error, method.frames[3].weighted_error);
        assert_eq!(held_out.inverted_elements, None);
        assert_eq!(method.train.unwrap().frames, 3);
        // 1.3 * 0.9 * 0.9 of the volume, and no more or less by moving aside.
        let volume = |i: usize| method.frames[i].geometry.volume_change_percent;
        assert!((volume(0) - 5.3).abs() < 1e-2, "{}", volume(0));
        assert!(volume(3).abs() < 1e-2, "{}", volume(3));
    }
}
