//! The explicit decoder of a run: trained in the two stages of the field, and kept in a file.

use super::{CompareRequest, check_stop};
use crate::error::{Result, TrainerError};
use crate::failures::Failures;
use crate::focus::Focus;
use crate::progress::{Phase, note};
use crate::scene::{Scene, Stage1};
use crate::stage1::{self, Regression};
use crate::stage2::{self, Outcome, ThroughSimulator};
use crate::trained::Trained;
use actuation_net::{AdamState, DecoderConfig, ExplicitDecoder, TensorFile};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::time::Instant;

/// Width of the hidden layers where nothing else is said.
const WIDTH: usize = 64;
/// Steps that tell how long a step takes.
const PILOT: u64 = 3;
/// Name of the file, and of its metadata entry.
const FILE: &str = "decoder.safetensors";
const TRAINING: &str = "training";

/// How a decoder was trained.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Training {
    /// Seconds of training: pulled shapes and both stages.
    pub seconds: f64,
    /// Seconds that were asked for.
    pub seconds_asked: Option<f64>,
    /// Steps of stage 1.
    pub stage1_steps: u64,
    /// Steps of stage 2, dropped ones too.
    pub stage2_steps: u64,
    /// Steps of stage 2 that were dropped.
    pub dropped: u64,
}

/// What the file says of its decoder beside the network.
#[derive(Serialize, Deserialize)]
struct Label {
    training: Training,
    /// The scene, as JSON: a decoder of another scene or of other settings is no match.
    scene: String,
}

/// The decoder that a request calls for.
pub(super) struct Wanted {
    config: DecoderConfig,
    width: Option<usize>,
    seconds: Option<f64>,
    retrain: bool,
}

impl Wanted {
    /// # Errors
    /// When the width is out of range.
    pub fn of(trained: &Trained, request: &CompareRequest) -> Result<Self> {
        let config = DecoderConfig {
            descriptor: trained.shapes.descriptor_size(),
            latent: trained.scene.network.latent,
            width: request.width.unwrap_or(WIDTH),
            elements: trained.body.mesh.elements().len(),
        };
        config.validate()?;
        Ok(Self {
            config,
            width: request.width,
            seconds: request.seconds,
            retrain: request.retrain,
        })
    }

    /// Why a decoder that is kept is not the one; `None` where it is.
    fn misfit(&self, config: &DecoderConfig, label: &Label, scene: &str) -> Option<&'static str> {
        let expected = DecoderConfig {
            width: self.width.unwrap_or(config.width),
            ..self.config.clone()
        };
        if self.retrain {
            Some("--retrain was given")
        } else if label.scene != scene {
            Some("it was trained for another scene or other settings")
        } else if *config != expected {
            Some("it has another size")
        } else if self.seconds.is_some() && self.seconds != label.training.seconds_asked {
            Some("it was trained for another time")
        } else {
            None
        }
    }
}

/// A decoder and how it came to be.
pub(super) struct Kept {
    pub decoder: ExplicitDecoder,
    pub training: Training,
}

/// The decoder kept in a folder where it is the one wanted; otherwise a new one, which is kept there.
///
/// # Errors
/// When the file that is there is damaged, training fails, the user stops, or the file cannot be written.
pub(super) fn kept_or_trained(folder: &Path, trained: &Trained, wanted: &Wanted) -> Result<Kept> {
    let path = folder.join(FILE);
    let scene = serde_json::to_string(&trained.scene).expect("plain data serialises");
    // A file that cannot be read is in the way only of those who want it.
    if path.exists() && !wanted.retrain {
        let (net, label) = read(&path)?;
        match wanted.misfit(net.config(), &label, &scene) {
            None => {
                let (decoder, training) = (net, label.training);
                return Ok(Kept { decoder, training });
            }
            Some(reason) => note(&format!("the decoder that was kept is replaced: {reason}")),
        }
    }
    let mut decoder = ExplicitDecoder::new(&wanted.config, trained.scene.seed)?;
    let training = train(trained, &mut decoder, wanted.seconds)?;
    let label = Label {
        training: training.clone(),
        scene,
    };
    let mut file = TensorFile::new();
    let label = serde_json::to_string(&label).expect("plain data serialises");
    file.insert_metadata(TRAINING, label);
    decoder.insert_into(&mut file, "");
    file.write(&path)?;
    Ok(Kept { decoder, training })
}

/// # Errors
/// When the file is damaged or of another version.
fn read(path: &Path) -> Result<(ExplicitDecoder, Label)> {
    let unusable = |reason: String| TrainerError::Checkpoint {
        path: path.to_path_buf(),
        problem: format!(
            "the decoder that is kept cannot be used ({reason}): train it anew with --retrain"
        ),
    };
    let parts = || -> std::result::Result<_, actuation_net::Error> {
        let file = TensorFile::read(path)?;
        let label = file.metadata(TRAINING)?.to_string();
        Ok((ExplicitDecoder::from_file(&file, "")?, label))
    };
    let (net, label) = parts().map_err(|error| unusable(error.to_string()))?;
    let label = serde_json::from_str(&label).map_err(|error| unusable(error.to_string()))?;
    Ok((net, label))
}

/// Trains as the field was trained, by the scene's settings: the same targets, the same number of steps, or what fits into `seconds`.
///
/// # Errors
/// When something does not fit, steps fail again and again, or the user stops.
fn train(
    trained: &Trained,
    decoder: &mut ExplicitDecoder,
    seconds: Option<f64>,
) -> Result<Training> {
    let clock = Instant::now();
    let left = |share: f64| seconds.map(|s| share * (s - clock.elapsed().as_secs_f64()));
    let Trained {
        scene,
        body,
        shapes,
        ..
    } = trained;
    let training = shapes.training();
    let descriptors = training.iter().map(|s| shapes.descriptor(&s.positions));
    let descriptors: Vec<Vec<f32>> = descriptors.collect::<Result<_>>()?;
    let pulled = stage1::pull(body, scene, &training, check_stop)?;
    let whole = Stage1 {
        // It answers for all elements in any case, and learns those alone that are looked at.
        points: body.mesh.elements().len(),
        ..scene.stage1.clone()
    };
    let basis = shapes.basis_in_training();
    let focus = Focus::new(&pulled, scene.stage1.focus, scene.stage1.balance);
    let regression = |settings| Regression {
        points: &body.samples,
        descriptors: &descriptors,
        targets: &pulled,
        basis: &basis,
        focus: &focus,
        settings,
        seed: scene.seed,
    };
    let mut settings = whole.clone();
    if let Some(left) = left(0.5) {
        let per_epoch = training.len().div_ceil(whole.batch) as u64;
        let (mut pilot, regression) = (decoder.clone(), regression(&whole));
        let mut adam = AdamState::new(pilot.parameter_count());
        let step = seconds_per_step(|i| {
            // A step that is dropped takes as long.
            let _ = regression.step(&mut pilot, &mut adam, i);
            Ok(())
        })?;
        settings.epochs = epochs_within(left, step, per_epoch).min(whole.epochs);
    }
    let regression = regression(&settings);
    let (stage1_steps, dropped) = regress(&regression, decoder)?;

    let hastened: Scene;
    let mut simulator =
        ThroughSimulator::new(body, scene, &training, &descriptors)?.with_blends(&regression);
    let mut warm: Vec<Vec<Vector3<f64>>> = pulled.iter().map(|p| p.nodes.clone()).collect();
    if let Some(left) = left(1.0) {
        let (mut pilot, mut warm) = (decoder.clone(), warm.clone());
        let mut adam = AdamState::new(pilot.parameter_count());
        let step = seconds_per_step(|i| {
            let outcome = simulator.step(&mut pilot, &mut adam, &mut warm, i);
            outcome.map(drop)
        })?;
        let mut changed = scene.clone();
        changed.stage2.epochs = epochs_within(left, step, training.len() as u64);
        hastened = changed;
        simulator.scene = &hastened;
    }
    let (stage2_steps, more) = through_simulator(&mut simulator, decoder, &mut warm)?;
    Ok(Training {
        seconds: clock.elapsed().as_secs_f64(),
        seconds_asked: seconds,
        stage1_steps,
        stage2_steps,
        dropped: dropped + more,
    })
}

/// Mean seconds of the first steps.
fn seconds_per_step(mut step: impl FnMut(u64) -> Result<()>) -> Result<f64> {
    let clock = Instant::now();
    for i in 0..PILOT {
        check_stop()?;
        step(i)?;
    }
    Ok(clock.elapsed().as_secs_f64() / PILOT as f64)
}

/// Whole epochs that fit into some seconds; at least one.
fn epochs_within(seconds: f64, per_step: f64, steps_per_epoch: u64) -> usize {
    let epochs = seconds / (per_step * steps_per_epoch as f64);
    // The conversion saturates.
    (epochs.floor() as usize).max(1)
}

/// Returns the steps, and how many of them were dropped.
fn regress(regression: &Regression, decoder: &mut ExplicitDecoder) -> Result<(u64, u64)> {
    let steps = stage1::steps(regression.settings, regression.descriptors.len());
    let mut adam = AdamState::new(decoder.parameter_count());
    let mut phase = Phase::new("decoder 1", steps, 0);
    let (mut failures, mut dropped) = (Failures::default(), 0);
    for step in 0..steps {
        check_stop()?;
        match regression.step(decoder, &mut adam, step) {
            Ok(loss) => {
                failures.end();
                phase.step(|| format!("loss {loss:.2e}"));
            }
            Err(reason) => {
                dropped += 1;
                if let Some(count) = failures.add() {
                    return Err(TrainerError::DecoderDiverged { count, reason });
                }
                phase.step(|| format!("dropped: {reason}"));
            }
        }
    }
    phase.finish(&format!("{steps} steps, {dropped} dropped"));
    Ok((steps, dropped))
}

/// Returns the steps, and how many of them were dropped.
fn through_simulator(
    simulator: &mut ThroughSimulator,
    decoder: &mut ExplicitDecoder,
    warm: &mut [Vec<Vector3<f64>>],
) -> Result<(u64, u64)> {
    let steps = stage2::steps(&simulator.scene.stage2, simulator.shapes.len());
    let percent = 100.0 / simulator.body.diagonal;
    let mut adam = AdamState::new(decoder.parameter_count());
    let mut phase = Phase::new("decoder 2", steps, 0);
    let (mut failures, mut dropped) = (Failures::default(), 0);
    for step in 0..steps {
        check_stop()?;
        match simulator.step(decoder, &mut adam, warm, step)? {
            Outcome::Stepped(done) => {
                failures.end();
                let error = done.mean_error * percent;
                phase.step(|| format!("loss {:.2e}, error {error:.3} %", done.loss));
            }
            Outcome::Dropped(reason) => {
                dropped += 1;
                if let Some(count) = failures.add() {
                    return Err(TrainerError::DecoderDiverged { count, reason });
                }
                phase.step(|| format!("dropped: {reason}"));
            }
        }
    }
    phase.finish(&format!("{steps} steps, {dropped} dropped"));
    Ok((steps, dropped))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::Evaluator;
    use crate::fixture;
    use crate::table::mean_of;
    use crate::train::network_config;
    use actuation_net::ActuationNet;

    fn trained(scene: Scene) -> Trained {
        let body = fixture::body(&scene);
        let shapes = fixture::shapes(&scene, &body);
        Trained {
            net: ActuationNet::new(&network_config(&scene, &shapes), 1).unwrap(),
            inputs: fixture::inputs(),
            scene,
            body,
            shapes,
        }
    }

    fn wanted(trained: &Trained, request: CompareRequest) -> Wanted {
        Wanted::of(trained, &request).unwrap()
    }

    fn mean_error(trained: &Trained, decoder: &ExplicitDecoder) -> f64 {
        let mut evaluator = Evaluator::new(&trained.body, &trained.scene).unwrap();
        let errors = trained.shapes.all.iter().map(|shape| {
            let descriptor = trained.shapes.descriptor(&shape.positions).unwrap();
            let result = evaluator.shape(decoder, shape, descriptor, None).unwrap();
            result.mean_error
        });
        mean_of(errors)
    }

    #[test]
    fn the_decoder_learns_in_both_stages() {
        let mut scene = fixture::scene("");
        scene.stage1.epochs = 100;
        scene.stage1.blends = 0;
        scene.stage2.epochs = 0;
        let mut case = trained(scene);
        let config = wanted(&case, CompareRequest::default()).config;
        let fresh = || ExplicitDecoder::new(&config, 1).unwrap();
        let mut decoder = fresh();
        let at_rest = mean_error(&case, &decoder);
        let first = train(&case, &mut decoder, None).unwrap();
        assert_eq!((first.stage1_steps, first.stage2_steps), (200, 0));
        let regressed = mean_error(&case, &decoder);
        assert!(regressed < 0.5 * at_rest, "{regressed} {at_rest}");
        let mut decoder = fresh();
        case.scene.stage2.epochs = 10;
        case.scene.stage2.learning_rate = 3e-4;
        let second = train(&case, &mut decoder, None).unwrap();
        assert_eq!((second.stage2_steps, second.dropped), (30, 0));
        let learned = mean_error(&case, &decoder);
        assert!(learned < 0.95 * regressed, "{learned} {regressed}");
    }

    #[test]
    fn a_decoder_is_kept_until_another_is_wanted() {
        let folder = tempfile::tempdir().unwrap();
        let mut case = trained(fixture::scene(""));
        let ask = |case: &Trained, request: CompareRequest| {
            kept_or_trained(folder.path(), case, &wanted(case, request)).unwrap()
        };
        let of_width = |width| CompareRequest {
            width: Some(width),
            ..CompareRequest::default()
        };
        let first = ask(&case, of_width(7));
        assert_eq!(first.decoder.config().width, 7);
        // The time that training took tells one training from another.
        let again = ask(&case, CompareRequest::default());
        assert_eq!(
            (&again.training, &again.decoder),
            (&first.training, &first.decoder)
        );
        assert_eq!(ask(&case, of_width(7)).training, first.training);
        let wider = ask(&case, of_width(9));
        assert_eq!(wider.decoder.config().width, 9);
        let hasty = CompareRequest {
            seconds: Some(1e-6),
            ..CompareRequest::default()
        };
        let hastened = ask(&case, hasty.clone()).training;
        // One epoch of each stage is the least.
        assert_eq!((hastened.stage1_steps, hastened.stage2_steps), (2, 3));
        assert_eq!(hastened.seconds_asked, Some(1e-6));
        assert_eq!(ask(&case, hasty).training, hastened);
        let anew = CompareRequest {
            retrain: true,
            ..CompareRequest::default()
        };
        let retrained = ask(&case, anew.clone());
        assert_eq!(retrained.decoder.config().width, WIDTH);
        assert_eq!(retrained.training.seconds_asked, None);
        case.scene.seed += 1;
        let other = ask(&case, CompareRequest::default());
        assert_ne!(other.decoder, retrained.decoder);

        let path = folder.path().join(FILE);
        let whole = std::fs::read(&path).unwrap();
        std::fs::write(&path, &whole[..whole.len() / 2]).unwrap();
        let any = wanted(&case, CompareRequest::default());
        let refused = kept_or_trained(folder.path(), &case, &any);
        let message = refused.err().map(|e| e.to_string()).unwrap_or_default();
        assert!(
            message.contains(FILE) && message.contains("--retrain"),
            "{message}"
        );
        assert_eq!(ask(&case, anew).decoder, other.decoder);
    }

    #[test]
    fn epochs_are_what_fits_and_at_least_one() {
        assert_eq!(epochs_within(10.0, 0.5, 4), 5);
        assert_eq!(epochs_within(10.9, 0.5, 4), 5);
        assert_eq!(epochs_within(-1.0, 0.5, 4), 1);
        assert_eq!(epochs_within(1.0, 0.5, 4), 1);
    }
}
