//! safetensors files: tensors of all kinds, networks, decoders, checkpoints.

use actuation_net::{
    ActuationNet, AdamState, DecoderConfig, ExplicitDecoder, NetworkConfig, TensorFile, Width,
};
use rand::Rng;
use rand::seq::IndexedRandom;
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};

use super::json::{change, number, text};

/// The network that checkpoints are asked for: the smallest.
pub fn config() -> NetworkConfig {
    NetworkConfig {
        latent: 1,
        ..NetworkConfig::new(1, Width::W64)
    }
}

/// The bytes of a file.
fn bytes(file: &TensorFile) -> Vec<u8> {
    let folder = tempfile::tempdir().expect("a folder for a moment");
    let path = folder.path().join("seed.safetensors");
    file.write(&path).expect("it can be written");
    std::fs::read(path).expect("it can be read")
}

fn network_file(prefix: &str) -> TensorFile {
    let mut file = TensorFile::new();
    let net = ActuationNet::new(&config(), 0).expect("a valid configuration");
    net.insert_into(&mut file, prefix);
    file
}

/// Two small tensors and some metadata.
pub fn small_seed() -> Vec<u8> {
    let mut file = TensorFile::new();
    file.insert_f32("a", &[2, 3], &[0.5; 6]);
    file.insert_u64("b", &[2], &[7; 2]);
    file.insert_metadata("config", "{}");
    bytes(&file)
}

/// A network.
pub fn network_seed() -> Vec<u8> {
    bytes(&network_file(""))
}

/// An explicit decoder.
pub fn decoder_seed() -> Vec<u8> {
    let config = DecoderConfig {
        descriptor: 1,
        latent: 1,
        width: 2,
        elements: 3,
    };
    let decoder = ExplicitDecoder::new(&config, 0).expect("a valid configuration");
    let mut file = TensorFile::new();
    decoder.insert_into(&mut file, "");
    bytes(&file)
}

/// A checkpoint of [`config`] with two shapes over two nodes.
pub fn checkpoint_seed() -> Vec<u8> {
    let mut file = network_file("network.");
    let header = json!({
        "stage": "two", "step": 3, "dropped": 0, "metrics_length": 10, "seconds": 1.5,
        "epoch_loss": { "sum": 0.5, "count": 2 },
        "stage1_errors": [{ "name": "a", "mean": 0.1, "max": 0.2 }],
        "shapes": 2, "nodes": 2,
    });
    file.insert_metadata("training", header.to_string());
    let count = config()
        .parameter_layout()
        .last()
        .map_or(0, |t| t.range.end);
    let adam = AdamState {
        step: 3,
        m: vec![0.0; count],
        v: vec![0.0; count],
    };
    adam.insert_into(&mut file, "adam.");
    file.insert_u64("warm_starts", &[2, 2, 3], &[0; 12]);
    bytes(&file)
}

/// A file like `seed` with values of its header replaced, or of the JSON in its metadata.
pub fn generate(seed: &[u8], rng: &mut ChaCha8Rng) -> Vec<u8> {
    let length = u64::from_le_bytes(seed[..8].try_into().expect("8 bytes")) as usize;
    let mut header: Value = serde_json::from_slice(&seed[8..8 + length]).expect("a seed is whole");
    for _ in 0..rng.random_range(0..4_u32) {
        change_header(&mut header, rng);
    }
    let header = serde_json::to_vec(&header).expect("JSON is written");
    let told = match rng.random_range(0..16_u32) {
        0 => number(rng).as_u64().unwrap_or(u64::MAX),
        _ => header.len() as u64,
    };
    let mut bytes = told.to_le_bytes().to_vec();
    bytes.extend(header);
    bytes.extend(&seed[8 + length..]);
    bytes
}

fn change_header(header: &mut Value, rng: &mut ChaCha8Rng) {
    let keys: Vec<String> = header
        .as_object()
        .into_iter()
        .flatten()
        .map(|(k, _)| k.clone())
        .collect();
    let Some(key) = keys.choose(rng) else {
        return change(header, 1, rng);
    };
    let entry = &mut header[key];
    if !entry.is_object() {
        return change(entry, 1, rng);
    }
    match rng.random_range(0..8_u32) {
        0 => change(header, 1, rng),
        1 => {
            entry["dtype"] = (*[
                "F64", "F32", "F16", "U64", "I8", "BOOL", "F4", "F8_E4M3", "X",
            ]
            .choose(rng)
            .expect("types"))
            .into()
        }
        2 => {
            entry["shape"] = (0..rng.random_range(0..5_u32))
                .map(|_| number(rng))
                .collect()
        }
        3 => entry["data_offsets"] = (0..2).map(|_| number(rng)).collect(),
        4 => {
            header[text(rng)] = entry.clone();
        }
        _ => {
            let metadata = &mut header["__metadata__"];
            if !metadata.is_object() {
                return change(metadata, 1, rng);
            }
            let names: Vec<String> = metadata
                .as_object()
                .into_iter()
                .flatten()
                .map(|(k, _)| k.clone())
                .collect();
            let Some(name) = names.choose(rng) else {
                return;
            };
            let inner = metadata[name]
                .as_str()
                .and_then(|text| serde_json::from_str(text).ok());
            let mut inner: Value = inner.unwrap_or_default();
            change(&mut inner, 1, rng);
            metadata[name] = inner.to_string().into();
        }
    }
}
