//! The state of training in one file, written whole: whatever kills the process, the run goes on from the last one, bit for bit.

use crate::error::{Result, TrainerError};
use crate::run::Run;
use actuation_net::{ActuationNet, AdamState, NetworkConfig, TensorFile};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Where training stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stage {
    /// Fitting the actuation of pulled shapes.
    One,
    /// Through the simulator.
    Two,
    /// Finished.
    Done,
}

/// Errors of one shape after stage 1, kept to be shown beside those after stage 2.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StageError {
    /// Name of the shape.
    pub name: String,
    /// Mean distance of the surface's vertices from the target.
    pub mean: f64,
    /// Largest distance.
    pub max: f64,
}

/// A mean that starts anew when it is taken.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct RunningMean {
    sum: f64,
    count: u64,
}

impl RunningMean {
    /// Takes one more value in.
    pub fn add(&mut self, value: f64) {
        self.sum += value;
        self.count += 1;
    }

    /// The mean since it was last taken; nothing of none.
    pub fn take(&mut self) -> Option<f64> {
        let all = std::mem::take(self);
        (all.count > 0).then(|| all.sum / all.count as f64)
    }
}

/// Everything that the next step depends on.
pub struct Checkpoint {
    /// The stage.
    pub stage: Stage,
    /// Steps done in this stage.
    pub step: u64,
    /// Steps dropped so far because they failed.
    pub dropped: u64,
    /// Bytes of the metrics file at this state.
    pub metrics_length: u64,
    /// Seconds of training so far.
    pub seconds: f64,
    /// Losses of the epoch of stage 1 that is under way.
    pub epoch_loss: RunningMean,
    /// Errors after stage 1, once it is done.
    pub stage1_errors: Vec<StageError>,
    /// The network.
    pub net: ActuationNet,
    /// The optimiser.
    pub adam: AdamState,
    /// Node positions of every training shape at its last visit.
    pub warm: Vec<Vec<Vector3<f64>>>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    stage: Stage,
    step: u64,
    dropped: u64,
    metrics_length: u64,
    seconds: f64,
    epoch_loss: RunningMean,
    stage1_errors: Vec<StageError>,
    shapes: usize,
    nodes: usize,
}

const HEADER: &str = "training";
const WARM: &str = "warm_starts";

/// Adds positions of the same nodes in several shapes to a file, as bit patterns: they must come back exactly.
///
/// # Panics
/// When the shapes have different numbers of nodes.
pub fn insert_positions(file: &mut TensorFile, name: &str, shapes: &[Vec<Vector3<f64>>]) {
    let nodes = shapes.first().map_or(0, Vec::len);
    let bits = shapes.iter().flatten();
    let bits: Vec<u64> = bits
        .flat_map(|x| [x.x, x.y, x.z].map(f64::to_bits))
        .collect();
    file.insert_u64(name, &[shapes.len(), nodes, 3], &bits);
}

/// What [`insert_positions`] added, of so many shapes and nodes.
///
/// # Errors
/// When the file has no such positions.
pub fn positions(
    file: &TensorFile,
    name: &str,
    shapes: usize,
    nodes: usize,
) -> Result<Vec<Vec<Vector3<f64>>>> {
    let bits = file.u64_tensor(name, &[shapes, nodes, 3])?;
    let entries: Vec<f64> = bits.into_iter().map(f64::from_bits).collect();
    let all: Vec<_> = entries
        .chunks_exact(3)
        .map(Vector3::from_column_slice)
        .collect();
    Ok(match nodes {
        0 => Vec::new(),
        nodes => all.chunks_exact(nodes).map(<[_]>::to_vec).collect(),
    })
}

impl Checkpoint {
    /// Writes the checkpoint of a run.
    ///
    /// # Errors
    /// When the file cannot be written; the older one then stays.
    pub fn write(&self, run: &Run) -> Result<()> {
        let mut file = TensorFile::new();
        let nodes = self.warm.first().map_or(0, Vec::len);
        let header = Header {
            stage: self.stage,
            step: self.step,
            dropped: self.dropped,
            metrics_length: self.metrics_length,
            seconds: self.seconds,
            epoch_loss: self.epoch_loss,
            stage1_errors: self.stage1_errors.clone(),
            shapes: self.warm.len(),
            nodes,
        };
        let header = serde_json::to_string(&header).expect("plain data serialises");
        file.insert_metadata(HEADER, header);
        self.net.insert_into(&mut file, "network.");
        self.adam.insert_into(&mut file, "adam.");
        insert_positions(&mut file, WARM, &self.warm);
        Ok(file.write(run.checkpoint_path())?)
    }

    /// Reads the checkpoint of a run, which must fit the network of its scene.
    ///
    /// # Errors
    /// When the file is missing, damaged, or of another network.
    pub fn read(run: &Run, config: &NetworkConfig) -> Result<Self> {
        Self::from_file(&TensorFile::read(run.checkpoint_path())?, config)
    }

    /// As [`Checkpoint::read`], from a file that is at hand already.
    ///
    /// # Errors
    /// When it is damaged, or of another network.
    pub fn from_file(file: &TensorFile, config: &NetworkConfig) -> Result<Self> {
        let header = file.metadata(HEADER)?;
        let header: Header =
            serde_json::from_str(header).map_err(|e| TrainerError::Checkpoint {
                path: file.path().to_path_buf(),
                problem: format!(
                    "its header cannot be read ({e}); it is of another version or damaged"
                ),
            })?;
        let net = ActuationNet::from_file_with(file, "network.", config)?;
        let adam = AdamState::from_file(file, "adam.", net.parameter_count())?;
        let warm = positions(file, WARM, header.shapes, header.nodes)?;
        Ok(Self {
            stage: header.stage,
            step: header.step,
            dropped: header.dropped,
            metrics_length: header.metrics_length,
            seconds: header.seconds,
            epoch_loss: header.epoch_loss,
            stage1_errors: header.stage1_errors,
            net,
            adam,
            warm,
        })
    }
}
