//! Networks, decoders and optimiser states in and out of [`TensorFile`]s.

use std::path::Path;

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::{
    ActuationNet, AdamState, Error, ExplicitDecoder, NetworkConfig, ParameterTensor,
    ResolutionRange, TensorFile,
};

/// Metadata key, behind the prefix, of a network's configuration in JSON.
const CONFIG_KEY: &str = "config";

impl NetworkConfig {
    /// The configuration of the network in the part of a file under `prefix`, as it is stored: not validated.
    ///
    /// # Errors
    /// [`Error::MissingMetadata`] and [`Error::MalformedConfig`].
    pub fn from_file(file: &TensorFile, prefix: &str) -> Result<Self, Error> {
        stored_config(file, prefix)
    }
}

impl ActuationNet {
    /// Writes configuration and weights to a safetensors file, whole or not at all.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), Error> {
        let mut file = TensorFile::new();
        self.insert_into(&mut file, "");
        file.write(path)
    }

    /// A new network from a file that [`ActuationNet::save`] wrote, with the configuration stored there.
    ///
    /// # Errors
    /// [`Error::Read`], [`Error::Malformed`] and those of [`ActuationNet::from_file`].
    pub fn load(path: impl AsRef<Path>) -> Result<Self, Error> {
        Self::from_file(&TensorFile::read(path)?, "")
    }

    /// [`ActuationNet::load`] for a caller who knows what configuration the file should have.
    ///
    /// # Errors
    /// Those of [`ActuationNet::load`]; [`Error::TensorShape`] and [`Error::ConfigMismatch`] if the file has another one.
    pub fn load_with(path: impl AsRef<Path>, config: &NetworkConfig) -> Result<Self, Error> {
        Self::from_file_with(&TensorFile::read(path)?, "", config)
    }

    /// Adds configuration and weights to a larger file; all names start with `prefix`.
    ///
    /// The tensors have the names of [`ActuationNet::parameter_layout`], the metadata entry is called `config`.
    pub fn insert_into(&self, file: &mut TensorFile, prefix: &str) {
        let layout = self.parameter_layout();
        insert(file, prefix, self.config(), layout, &self.parameters());
    }

    /// A new network from the part of a file under `prefix`, with the configuration stored there.
    ///
    /// # Errors
    /// [`Error::MissingMetadata`], [`Error::MalformedConfig`], those of [`NetworkConfig::validate`],
    /// [`Error::UnknownTensor`] for any other tensor under the prefix, and those of [`TensorFile::f32_tensor`].
    pub fn from_file(file: &TensorFile, prefix: &str) -> Result<Self, Error> {
        Self::from_file_with(file, prefix, &NetworkConfig::from_file(file, prefix)?)
    }

    /// [`ActuationNet::from_file`] for a caller who knows what configuration the file should have.
    ///
    /// # Errors
    /// Those of [`ActuationNet::from_file`]; [`Error::TensorShape`] and [`Error::ConfigMismatch`] if the file has another one.
    pub fn from_file_with(
        file: &TensorFile,
        prefix: &str,
        config: &NetworkConfig,
    ) -> Result<Self, Error> {
        config.validate()?;
        let parameters = stored_parameters(file, prefix, &config.parameter_layout())?;
        // Equal shapes leave only these to differ.
        let found = NetworkConfig::from_file(file, prefix)?;
        let numbers = |config: &NetworkConfig| {
            let range = config.resolution.unwrap_or(ResolutionRange {
                coarse: 0.0,
                fine: 0.0,
            });
            [
                ("omega", config.omega),
                ("resolution.coarse", range.coarse),
                ("resolution.fine", range.fine),
            ]
        };
        for ((field, found), (_, expected)) in numbers(&found).into_iter().zip(numbers(config)) {
            if found != expected {
                return Err(Error::ConfigMismatch {
                    path: file.path().to_path_buf(),
                    field,
                    found: f64::from(found),
                    expected: f64::from(expected),
                });
            }
        }
        Self::from_parameters(config, parameters)
    }
}

impl ExplicitDecoder {
    /// Adds configuration and weights to a larger file; all names start with `prefix`.
    ///
    /// The tensors have the names of [`ParameterTensor`], the metadata entry is called `config`.
    pub fn insert_into(&self, file: &mut TensorFile, prefix: &str) {
        let layout = self.parameter_layout();
        insert(file, prefix, self.config(), layout, self.parameters());
    }

    /// A decoder from the part of a file under `prefix`, with the configuration stored there.
    ///
    /// # Errors
    /// [`Error::MissingMetadata`], [`Error::MalformedConfig`], those of [`crate::DecoderConfig::validate`],
    /// [`Error::UnknownTensor`] for any other tensor under the prefix, and those of [`TensorFile::f32_tensor`].
    pub fn from_file(file: &TensorFile, prefix: &str) -> Result<Self, Error> {
        let config: crate::DecoderConfig = stored_config(file, prefix)?;
        config.validate()?;
        let parameters = stored_parameters(file, prefix, &config.parameter_layout())?;
        Self::from_parameters(&config, parameters)
    }
}

fn insert(
    file: &mut TensorFile,
    prefix: &str,
    config: &impl Serialize,
    layout: &[ParameterTensor],
    parameters: &[f32],
) {
    let config = serde_json::to_string(config).expect("a plain struct becomes JSON");
    file.insert_metadata(format!("{prefix}{CONFIG_KEY}"), config);
    for tensor in layout {
        let values = &parameters[tensor.range.clone()];
        file.insert_f32(format!("{prefix}{}", tensor.name), &tensor.shape, values);
    }
}

/// The flat parameters of a layout; other tensors under the prefix are refused.
fn stored_parameters(
    file: &TensorFile,
    prefix: &str,
    layout: &[ParameterTensor],
) -> Result<Vec<f32>, Error> {
    file.check_names(prefix, |name| layout.iter().any(|t| t.name == name))?;
    let mut parameters = Vec::new();
    for tensor in layout {
        let name = format!("{prefix}{}", tensor.name);
        parameters.extend(file.f32_tensor(&name, &tensor.shape)?);
    }
    Ok(parameters)
}

fn stored_config<C: DeserializeOwned>(file: &TensorFile, prefix: &str) -> Result<C, Error> {
    let key = format!("{prefix}{CONFIG_KEY}");
    let text = file.metadata(&key)?;
    serde_json::from_str(text).map_err(|source| Error::MalformedConfig {
        path: file.path().to_path_buf(),
        key,
        source,
    })
}

impl AdamState {
    /// Adds the state to a file as the tensors `step` (u64, one entry), `m` and `v`, all behind `prefix`.
    pub fn insert_into(&self, file: &mut TensorFile, prefix: &str) {
        file.insert_u64(format!("{prefix}step"), &[1], &[self.step]);
        file.insert_f32(format!("{prefix}m"), &[self.m.len()], &self.m);
        file.insert_f32(format!("{prefix}v"), &[self.v.len()], &self.v);
    }

    /// The state of an optimiser of `parameters` parameters from the part of a file under `prefix`.
    ///
    /// # Errors
    /// Those of [`TensorFile::f32_tensor`], and [`Error::UnknownTensor`] for any other tensor under the prefix.
    pub fn from_file(file: &TensorFile, prefix: &str, parameters: usize) -> Result<Self, Error> {
        file.check_names(prefix, |name| ["step", "m", "v"].contains(&name))?;
        let step = file.u64_tensor(&format!("{prefix}step"), &[1])?[0];
        let m = file.f32_tensor(&format!("{prefix}m"), &[parameters])?;
        let v = file.f32_tensor(&format!("{prefix}v"), &[parameters])?;
        Ok(Self { step, m, v })
    }
}
