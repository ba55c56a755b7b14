//! The field beside what a rigger has today: the same frames by linear blendshapes, and by an explicit decoder that is trained as the
//! field was.

mod decoder;
mod measure;
mod write;

pub use crate::geometry::Geometry;
pub use decoder::Training;
pub use measure::{FrameNumbers, MethodNumbers, SetGeometry, SetNumbers, TargetNumbers};
pub use write::{Comparison, markdown};

use crate::actuator::Actuator;
use crate::checkpoint::Checkpoint;
use crate::error::{Result, TrainerError};
use crate::evaluate::{self, more_shapes};
use crate::files::create_folder;
use crate::progress::stop_requested;
use crate::run::Run;
use crate::shapes::Shape;
use crate::trained::{Changes, Trained};
use decoder::Wanted;
use measure::{Measure, Reached};
use std::path::PathBuf;

/// What to compare, and how much the decoder may cost.
#[derive(Debug, Default, Clone)]
pub struct CompareRequest {
    /// Held-out shapes beside those of the run, as in [`evaluate::EvaluationRequest`].
    pub shapes: Option<PathBuf>,
    /// What frames weigh instead of the run's shapes.
    pub units: Option<PathBuf>,
    /// Width of the decoder's hidden layers; that of the decoder that is kept, or 64, where not given.
    pub width: Option<usize>,
    /// About how many seconds the decoder is trained; as many steps as the field where not given.
    pub seconds: Option<f64>,
    /// Train the decoder even if one is kept.
    pub retrain: bool,
    /// Where to write; the folder `comparison` of the run otherwise.
    pub out: Option<PathBuf>,
}

/// Simulates the shapes of a run, and others, by field and by decoder, blends them linearly, and writes `comparison.json`,
/// `comparison.md`, the pictures `comparison.png` and the decoder `decoder.safetensors`. Returns the comparison and the folder.
///
/// # Errors
/// When the run is not finished or damaged, an option or a file does not fit, the decoder's training fails, the user stops, or the
/// output cannot be written.
pub fn compare(run: &Run, request: &CompareRequest) -> Result<(Comparison, PathBuf)> {
    check_seconds(request.seconds)?;
    let trained = Trained::load(run, &Changes::default())?;
    let training_seconds = Checkpoint::read(run, trained.net.config())?.seconds;
    let wanted = Wanted::of(&trained, request)?;
    let mut frames: Vec<Shape> = trained.shapes.all.clone();
    let more = (request.shapes.as_deref(), request.units.as_deref());
    let Trained {
        scene,
        shapes,
        inputs,
        ..
    } = &trained;
    frames.extend(more_shapes(more.0, more.1, scene, shapes, inputs)?);
    let folder = create_folder(&request.out.clone().unwrap_or(run.comparison_folder()))?;
    let kept = decoder::kept_or_trained(&folder, &trained, &wanted)?;

    let measure = Measure::new(&trained.body);
    let linear = measure::blend(&trained.shapes, &frames)?;
    let field = simulate(&trained, &trained.net, &frames)?;
    let explicit = simulate(&trained, &kept.decoder, &frames)?;
    let basis = trained.shapes.descriptor_size();
    let stored = 3 * trained.body.surface.vertex_count() * basis;
    let field_method = measure.method(
        "field",
        trained.net.parameter_count(),
        Some(training_seconds),
        &frames,
        &field,
    );
    let linear_method = measure.method("linear blendshapes", stored, None, &frames, &linear);
    let decoder_method = measure.method(
        "explicit decoder",
        Actuator::parameter_count(&kept.decoder),
        Some(kept.training.seconds),
        &frames,
        &explicit,
    );
    let comparison = Comparison {
        scene: trained.scene.name.clone(),
        unit: trained.scene.unit.clone(),
        bbox_diagonal: trained.body.diagonal,
        element_size: trained.body.mesh.element_size(),
        elements: trained.body.mesh.elements().len(),
        vertices: trained.body.surface.vertex_count(),
        basis,
        decoder_width: kept.decoder.config().width,
        decoder_training: kept.training,
        targets: measure.targets(&frames)?,
        methods: [field_method?, linear_method?, decoder_method?],
    };
    check_stop()?;
    let shown = write::Shown {
        frames: &frames,
        reached: [&field, &linear, &explicit],
    };
    write::write(&folder, &trained, &comparison, &shown)?;
    Ok((comparison, folder))
}

fn check_seconds(seconds: Option<f64>) -> Result<()> {
    match seconds {
        Some(value) if !(value.is_finite() && value > 0.0) => Err(TrainerError::Option {
            option: "--seconds",
            text: value.to_string(),
            mend: "give a number above zero",
        }),
        _ => Ok(()),
    }
}

fn check_stop() -> Result<()> {
    match stop_requested() {
        true => Err(TrainerError::ComparisonStopped),
        false => Ok(()),
    }
}

/// All frames by a network and the solver.
fn simulate(trained: &Trained, net: &impl Actuator, frames: &[Shape]) -> Result<Vec<Reached>> {
    let Trained {
        scene,
        body,
        shapes,
        ..
    } = trained;
    let results = evaluate::simulate(scene, body, shapes, net, frames);
    let results = results.map_err(|error| match error {
        TrainerError::EvaluationStopped => TrainerError::ComparisonStopped,
        other => other,
    })?;
    Ok(results.into_iter().map(Reached::from).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;
    use crate::rig::Rig;
    use crate::train::train;
    use serde_json::Value;

    #[test]
    fn a_comparison_holds_finite_numbers_for_every_frame() {
        let folder = tempfile::tempdir().unwrap();
        let scene = fixture::SCENE.replace("basis =", "held_out = [\"both\"]\nbasis =");
        let inputs = fixture::inputs();
        let run = Run::create(folder.path(), &scene, &inputs, &Rig::default(), None).unwrap();
        let request = CompareRequest::default();
        let refused = |request: &CompareRequest| compare(&run, request).unwrap_err().to_string();
        assert!(refused(&request).contains("finish training"));
        train(&run).unwrap();
        let seconds = CompareRequest {
            seconds: Some(f64::NAN),
            ..request.clone()
        };
        assert!(refused(&seconds).contains("--seconds"));
        let width = CompareRequest {
            width: Some(0),
            ..request.clone()
        };
        assert!(refused(&width).contains("1 to 4096"));
        let units = CompareRequest {
            units: Some("units.glb".into()),
            ..request.clone()
        };
        assert!(refused(&units).contains("--units"));
        assert!(!run.comparison_folder().exists());

        let frames = folder.path().join("frames.json");
        let text =
            r#"{ "frames": [{ "name": "half", "weights": { "long": 0.5, "both": 0.25 } }] }"#;
        std::fs::write(&frames, text).unwrap();
        let request = CompareRequest {
            shapes: Some(frames),
            ..request
        };
        let (comparison, out) = compare(&run, &request).unwrap();
        assert_eq!(out, run.comparison_folder());
        assert!(out.join("comparison.png").exists() && out.join("decoder.safetensors").exists());
        let text = std::fs::read_to_string(out.join("comparison.md")).unwrap();
        assert_eq!(text, markdown(&comparison));
        let text = std::fs::read_to_string(out.join("comparison.json")).unwrap();
        let json: Value = serde_json::from_str(&text).unwrap();
        let stored = |i: usize| json["methods"][i]["numbers_stored"].as_u64().unwrap() as usize;
        assert_eq!(stored(1), 3 * 2 * comparison.vertices);
        assert!(stored(2) > 6 * 64 * comparison.elements);
        // What is not finite is written as null.
        for (i, method) in json["methods"].as_array().unwrap().iter().enumerate() {
            let has_inside = i != 1;
            for (set, frames) in [("train", 2), ("held_out", 2)] {
                let numbers = &method[set];
                assert_eq!(numbers["frames"], frames);
                for key in ["weighted_error", "error_p99", "seconds_per_frame"] {
                    assert!(numbers[key].is_f64(), "{set} {key}: {numbers}");
                }
                for key in ["volume_change_percent", "largest_volume_change_percent"] {
                    assert!(numbers[key].is_f64(), "{set} {key}: {numbers}");
                }
                assert_eq!(numbers["inverted_elements"].is_f64(), has_inside);
            }
            let names = method["frames"].as_array().unwrap().iter();
            let names: Vec<&str> = names.map(|f| f["name"].as_str().unwrap()).collect();
            assert_eq!(names, ["long", "bent", "both", "half"]);
            assert_eq!(method["training_seconds"].is_f64(), has_inside);
        }
        assert!(json["targets"]["held_out"]["volume_change_percent"].is_f64());
    }
}
