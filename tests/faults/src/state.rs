//! Where a killed training stood, by what it left on the disk.

use crate::Result;
use serde_json::Value;
use std::path::Path;

/// Parts of a training, in order.
pub const PARTS: [&str; 5] = [
    "before there is a run",
    "targets",
    "stage 1",
    "stage 2",
    "evaluation",
];

/// What a training left.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Left {
    /// Which of [`PARTS`] it was in.
    pub part: usize,
    /// Whether a file lies there that was not finished.
    pub is_in_a_file: bool,
    /// Whether the metrics tell of more than the checkpoint knows.
    pub is_ahead: bool,
}

/// Looks at a run that nobody works on.
///
/// # Errors
/// When its checkpoint is damaged.
pub fn left(run: &Path) -> Result<Left> {
    let is_in_a_file = has_unfinished(run);
    let mut left = Left {
        part: 0,
        is_in_a_file,
        is_ahead: false,
    };
    if !run.join("scene.toml").exists() {
        return Ok(left);
    }
    let Ok(bytes) = std::fs::read(run.join("checkpoint.safetensors")) else {
        left.part = 1;
        return Ok(left);
    };
    let (_, training, _) = split(&bytes)?;
    left.part = match training["stage"].as_str() {
        Some("one") => 2,
        Some("two") => 3,
        Some("done") => 4,
        other => return Err(format!("a checkpoint of stage {other:?}")),
    };
    let known = training["metrics_length"].as_u64();
    let known = known.ok_or("a checkpoint without the length of the metrics")?;
    let told = std::fs::metadata(run.join("metrics.jsonl")).map_or(0, |file| file.len());
    if told < known {
        return Err("the checkpoint knows of metrics that are not there".into());
    }
    left.is_ahead = told > known;
    Ok(left)
}

/// Header, the trainer's own entry of it, and data of a checkpoint or of a decoder that is kept.
///
/// # Errors
/// When the file is not whole.
pub fn split(bytes: &[u8]) -> Result<(Value, Value, &[u8])> {
    let broken = || "a checkpoint that is not whole".to_string();
    let (length, rest) = bytes.split_first_chunk::<8>().ok_or_else(broken)?;
    let length = usize::try_from(u64::from_le_bytes(*length)).map_err(|_| broken())?;
    let (header, data) = rest.split_at_checked(length).ok_or_else(broken)?;
    let header: Value = serde_json::from_slice(header).map_err(|_| broken())?;
    let tensors = header.as_object().into_iter().flatten();
    let ends = tensors.filter_map(|(_, tensor)| tensor["data_offsets"][1].as_u64());
    if ends.max() != Some(data.len() as u64) {
        return Err(broken());
    }
    let training = header["__metadata__"]["training"].as_str();
    let training = training.and_then(|text| serde_json::from_str(text).ok());
    Ok((header, training.ok_or_else(broken)?, data))
}

/// Whether a file or folder below this one was not finished.
pub(crate) fn has_unfinished(folder: &Path) -> bool {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut paths = entries.map(|entry| entry.path());
    paths.any(|path| is_unfinished(&path) || path.is_dir() && has_unfinished(&path))
}

/// Whether a file has the name of one that was not finished.
pub(crate) fn is_unfinished(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let begins = |prefix: &&str| name.starts_with(prefix);
    [".part-", ".probe-"].iter().any(begins)
}
