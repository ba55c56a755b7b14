//! Networks of a transfer that are kept in its folder, those in training too: it may be stopped at any time, and goes on by the same command.

use crate::error::{AccuracyError, Result};
use actuation_net::{ActuationNet, AdamState, TensorFile};
use nalgebra::Vector3;
use std::cell::Cell;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use trainer::checkpoint::{insert_positions, positions};
use trainer::files::{create_folder, parse_json, read_json, remove, write_json};
use trainer::stop_requested;

/// How often a network in training is written: the starts of a large body on many grids are hundreds of megabytes.
const BETWEEN: Duration = Duration::from_secs(300);

/// Networks by name.
pub struct Kept {
    folder: PathBuf,
}

impl Kept {
    /// What is kept in `folder` for what `of` says.
    ///
    /// # Errors
    /// When the folder is of something else, or cannot be written.
    pub fn open(folder: &Path, of: &serde_json::Value) -> Result<Self> {
        let folder = folder.join("networks");
        create_folder(&folder)?;
        let path = folder.join("plan.json");
        // Through text, as that of the file: numbers may lose their last digit there.
        let own: serde_json::Value = parse_json(&of.to_string(), &path)?;
        match path.exists() {
            true if read_json::<serde_json::Value>(&path)? != own => Err(AccuracyError::Folder {
                path,
                problem: "is of another transfer: give another --out, or remove the folder".into(),
            }),
            true => Ok(Self { folder }),
            false => {
                write_json(&path, &own)?;
                Ok(Self { folder })
            }
        }
    }

    /// The network of this name; trained and kept where it is not there.
    ///
    /// # Errors
    /// When its file is damaged or cannot be written, and what `train` returns.
    pub fn network(
        &self,
        name: &str,
        train: impl FnOnce(&Unfinished) -> Result<ActuationNet>,
    ) -> Result<ActuationNet> {
        let path = self.folder.join(format!("{name}.safetensors"));
        if path.exists() {
            return Ok(ActuationNet::load(&path)?);
        }
        let unfinished = Unfinished::new(self.folder.join(format!("{name}.unfinished")), BETWEEN);
        let net = train(&unfinished)?;
        net.save(&path)?;
        remove(&unfinished.path)?;
        Ok(net)
    }
}

/// A network in training on one or more grids.
#[derive(Debug, Clone, PartialEq)]
pub struct InTraining {
    /// Steps done.
    pub step: u64,
    /// Steps dropped in a row.
    pub dropped: u64,
    /// The network.
    pub net: ActuationNet,
    /// The optimiser.
    pub adam: AdamState,
    /// Node positions of every shape at its last visit, for every grid.
    pub warm: Vec<Vec<Vec<Vector3<f64>>>>,
}

impl InTraining {
    /// Before the first step.
    pub fn new(net: &ActuationNet, warm: Vec<Vec<Vec<Vector3<f64>>>>) -> Self {
        Self {
            step: 0,
            dropped: 0,
            adam: AdamState::new(net.parameter_count()),
            net: net.clone(),
            warm,
        }
    }
}

/// Where a network in training is kept until it is done.
#[derive(Debug)]
pub struct Unfinished {
    path: PathBuf,
    between: Duration,
    written: Cell<Instant>,
}

impl Unfinished {
    fn new(path: PathBuf, between: Duration) -> Self {
        Self {
            path,
            between,
            written: Cell::new(Instant::now()),
        }
    }

    /// Where the training was left, or `start`, which has its shapes, where there is nothing.
    ///
    /// # Errors
    /// When the file is damaged or of other shapes.
    pub fn read(&self, start: InTraining) -> Result<InTraining> {
        if !self.path.exists() {
            return Ok(start);
        }
        let file = TensorFile::read(&self.path)?;
        let counts = file.u64_tensor("counts", &[2])?;
        let net = ActuationNet::from_file_with(&file, "network.", start.net.config())?;
        let warm = start.warm.iter().enumerate().map(|(grid, shapes)| {
            let nodes = shapes.first().map_or(0, Vec::len);
            positions(&file, &warm_name(grid), shapes.len(), nodes)
        });
        Ok(InTraining {
            step: counts[0],
            dropped: counts[1],
            adam: AdamState::from_file(&file, "adam.", net.parameter_count())?,
            net,
            warm: warm.collect::<trainer::error::Result<_>>()?,
        })
    }

    /// Writes the state where the last one is old; and where the user asked to stop, which is an error then.
    ///
    /// # Errors
    /// When the file cannot be written, and when the user asked to stop.
    pub fn keep(&self, state: &InTraining) -> Result<()> {
        let is_stopped = stop_requested();
        if is_stopped || self.written.get().elapsed() >= self.between {
            self.write(state)?;
            self.written.set(Instant::now());
        }
        match is_stopped {
            true => Err(AccuracyError::Stopped),
            false => Ok(()),
        }
    }

    fn write(&self, state: &InTraining) -> Result<()> {
        let mut file = TensorFile::new();
        file.insert_u64("counts", &[2], &[state.step, state.dropped]);
        state.net.insert_into(&mut file, "network.");
        state.adam.insert_into(&mut file, "adam.");
        for (grid, shapes) in state.warm.iter().enumerate() {
            insert_positions(&mut file, &warm_name(grid), shapes);
        }
        Ok(file.write(&self.path)?)
    }
}

fn warm_name(grid: usize) -> String {
    format!("warm_starts.{grid}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use actuation_net::NetworkConfig;

    fn network() -> ActuationNet {
        let config = NetworkConfig {
            latent: 4,
            ..NetworkConfig::new(3, actuation_net::Width::W64)
        };
        ActuationNet::new(&config, 1).unwrap()
    }

    /// Two grids of different size with two shapes each.
    fn start() -> InTraining {
        let nodes = |count| vec![vec![Vector3::new(0.1, 0.2, 0.3); count]; 2];
        InTraining::new(&network(), vec![nodes(5), nodes(3)])
    }

    #[test]
    fn a_state_comes_back_to_the_last_bit() {
        let folder = tempfile::tempdir().unwrap();
        let unfinished = Unfinished::new(folder.path().join("a.unfinished"), Duration::ZERO);
        assert_eq!(unfinished.read(start()).unwrap(), start(), "nothing there");
        let mut state = start();
        (state.step, state.dropped) = (7, 2);
        state.warm[1][0][2].y = 1.0 / 3.0;
        unfinished.keep(&state).unwrap();
        assert_eq!(unfinished.read(start()).unwrap(), state);
        let larger = InTraining::new(&network(), vec![vec![vec![Vector3::zeros(); 6]; 2]]);
        let error = unfinished.read(larger).unwrap_err().to_string();
        assert!(
            error.contains("a.unfinished") && error.contains("warm_starts.0"),
            "{error}"
        );
    }

    #[test]
    fn a_state_is_not_written_at_every_step() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.unfinished");
        let unfinished = Unfinished::new(path.clone(), BETWEEN);
        unfinished.keep(&start()).unwrap();
        assert!(!path.exists());
    }

    /// A training that fails leaves its state, one that is done takes it away, and a network that is there is not trained again.
    #[test]
    fn a_network_is_trained_once_and_goes_on_where_it_was() {
        let folder = tempfile::tempdir().unwrap();
        let kept = Kept::open(folder.path(), &serde_json::json!({"plan": 1})).unwrap();
        let stopped = kept.network("a", |unfinished| {
            let mut state = start();
            state.step = 5;
            unfinished.write(&state)?;
            Err(AccuracyError::Stopped)
        });
        assert!(matches!(stopped, Err(AccuracyError::Stopped)));
        let done = kept.network("a", |unfinished| {
            let state = unfinished.read(start())?;
            assert_eq!(state.step, 5);
            Ok(state.net)
        });
        assert!(done.unwrap() == network());
        let names: Vec<_> = std::fs::read_dir(folder.path().join("networks"))
            .unwrap()
            .collect();
        assert_eq!(names.len(), 2, "plan and network, {names:?}");
        kept.network("a", |_| panic!("it is there")).unwrap();
    }
}
