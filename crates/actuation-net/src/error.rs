//! Everything that can go wrong with data given to this crate.

use std::path::PathBuf;

/// Bad data, unusable files and impossible settings, each with where it was found and how to mend it.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The width is none of the supported ones.
    #[error("network width {found} is not supported: use 64, 128 or 256")]
    Width {
        /// The width asked for.
        found: usize,
    },
    /// The descriptor's size is out of range.
    #[error("descriptor size {found} is out of range: use 1 to {largest} basis weights")]
    DescriptorSize {
        /// The size asked for.
        found: usize,
        /// The largest size allowed.
        largest: usize,
    },
    /// The latent code's size is out of range.
    #[error("latent size {found} is out of range: use 1 to {largest}")]
    LatentSize {
        /// The size asked for.
        found: usize,
        /// The largest size allowed.
        largest: usize,
    },
    /// The width of an explicit decoder is out of range.
    #[error("decoder width {found} is out of range: use 1 to {largest}")]
    DecoderWidth {
        /// The width asked for.
        found: usize,
        /// The largest width allowed.
        largest: usize,
    },
    /// The number of elements of an explicit decoder is out of range.
    #[error("a decoder for {found} elements cannot be made: use 1 to {largest}")]
    ElementCount {
        /// The number asked for.
        found: usize,
        /// The largest number allowed.
        largest: usize,
    },
    /// The sine frequency is not a positive number.
    #[error("sine frequency omega = {found} must be positive and finite (30 is usual)")]
    Omega {
        /// The frequency asked for.
        found: f32,
    },
    /// The spacings of a field that knows its grid are none.
    #[error(
        "a field between grids of spacing {coarse} and {fine} cannot be: give two lengths above zero, the larger as `coarse`"
    )]
    Resolution {
        /// The larger.
        coarse: f32,
        /// The smaller.
        fine: f32,
    },
    /// The spacing of a grid is no length.
    #[error("a grid cannot have the spacing {found}: give a finite length above zero")]
    Spacing {
        /// The spacing given.
        found: f32,
    },
    /// The descriptor has another length than the network's configuration says.
    #[error(
        "the descriptor has {found} basis weights but the network was made for {expected}: use the basis it was trained on"
    )]
    DescriptorLength {
        /// Length in the network's configuration.
        expected: usize,
        /// Length given.
        found: usize,
    },
    /// A basis weight is NaN or infinite.
    #[error("basis weight {index} of the descriptor is {value}: give finite weights")]
    NonFiniteDescriptor {
        /// Index in the descriptor.
        index: usize,
        /// The value found.
        value: f64,
    },
    /// A latent code of another length than the network's.
    #[error(
        "the latent code has {found} numbers but the network was made for {expected}: use a code of this network"
    )]
    LatentLength {
        /// Length in the network's configuration.
        expected: usize,
        /// Length given.
        found: usize,
    },
    /// A number of a latent code is NaN or infinite.
    #[error("number {index} of the latent code is {value}: give finite numbers")]
    NonFiniteLatent {
        /// Index in the code.
        index: usize,
        /// The value found.
        value: f64,
    },
    /// The flat list of points is not a whole number of points.
    #[error(
        "the flat list of points has {found} entries, which is no multiple of 3: give x, y, z of every point"
    )]
    PointsLength {
        /// Number of entries given.
        found: usize,
    },
    /// A coordinate is NaN or infinite.
    #[error(
        "point {point} has {value} as coordinate {axis}: give finite points, normalised to [-1, 1]"
    )]
    NonFinitePoint {
        /// Index of the point.
        point: usize,
        /// 0, 1, 2 for x, y, z.
        axis: usize,
        /// The value found.
        value: f64,
    },
    /// The network's output is not finite although its input is: the weights are too large.
    #[error(
        "the network's {output} entry {index} is {value}: its weights have grown too large; restart from an earlier checkpoint with a smaller learning rate"
    )]
    NonFiniteOutput {
        /// `actuation` or `joint`.
        output: &'static str,
        /// Index in that output.
        index: usize,
        /// The value found.
        value: f64,
    },
    /// The flat parameter vector has another length than the network needs.
    #[error(
        "{found} parameters were given but the network has {expected}: take them from a network of the same configuration"
    )]
    ParameterCount {
        /// The network's number of parameters.
        expected: usize,
        /// Number given.
        found: usize,
    },
    /// A parameter is NaN or infinite.
    #[error("entry {index} of parameter tensor `{tensor}` is {value}: parameters must be finite")]
    NonFiniteParameter {
        /// Name of the tensor.
        tensor: String,
        /// Index inside the tensor.
        index: usize,
        /// The value found.
        value: f64,
    },
    /// A setting of the optimiser is out of range.
    #[error("Adam's {name} = {value} is out of range: {range}")]
    AdamSetting {
        /// The setting's name.
        name: &'static str,
        /// The value given.
        value: f64,
        /// What is allowed.
        range: &'static str,
    },
    /// Parameters, gradient and moments of the optimiser do not have one length.
    #[error(
        "Adam was given {parameters} parameters, {gradient} gradient entries and moments of length {first_moment} and {second_moment}: all four must belong to one network"
    )]
    AdamLength {
        /// Number of parameters.
        parameters: usize,
        /// Number of gradient entries.
        gradient: usize,
        /// Length of the first moment.
        first_moment: usize,
        /// Length of the second moment.
        second_moment: usize,
    },
    /// A gradient entry is NaN, infinite or so large that its square overflows.
    #[error(
        "gradient entry {index} is {value}, which is not finite or too large to square; nothing was changed: skip this sample or lower the learning rate"
    )]
    NonFiniteGradient {
        /// Index in the flat gradient.
        index: usize,
        /// The value found.
        value: f32,
    },
    /// A step of the optimiser would leave the range of f32.
    #[error(
        "a step of Adam with lr = {lr} takes parameter {index} from {value} out of the range of f32; nothing was changed: lower the learning rate"
    )]
    NonFiniteStep {
        /// Index in the flat parameters.
        index: usize,
        /// The parameter before the step.
        value: f32,
        /// The learning rate.
        lr: f64,
    },
    /// A file could not be read.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file could not be written; an older file of that name is untouched.
    #[error("cannot write {}: {source}; nothing was changed", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file is truncated or is not a safetensors file.
    #[error("{} is truncated or not a safetensors file ({source}): copy or save it again", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What the reader said.
        source: safetensors::SafeTensorError,
    },
    /// A file lacks a metadata entry.
    #[error("{} has no metadata entry `{key}`: it was not written by this crate or holds no network under that prefix", path.display())]
    MissingMetadata {
        /// The file.
        path: PathBuf,
        /// The entry's key.
        key: String,
    },
    /// The network configuration in a file's metadata cannot be read.
    #[error("{}: the network configuration in metadata entry `{key}` cannot be read ({source}): use the version that wrote it or save it again", path.display())]
    MalformedConfig {
        /// The file.
        path: PathBuf,
        /// The entry's key.
        key: String,
        /// What the reader said.
        source: serde_json::Error,
    },
    /// A file's network has another setting than the caller's configuration.
    #[error("{}: the stored network has {field} = {found} but {expected} was asked for: change the configuration or use the weights that fit it", path.display())]
    ConfigMismatch {
        /// The file.
        path: PathBuf,
        /// Name of the configuration's field.
        field: &'static str,
        /// The file's value.
        found: f64,
        /// The caller's value.
        expected: f64,
    },
    /// A file lacks a tensor.
    #[error("{} has no tensor `{tensor}`: use a file written for this configuration", path.display())]
    MissingTensor {
        /// The file.
        path: PathBuf,
        /// The tensor's name.
        tensor: String,
    },
    /// A file holds a tensor that the network does not have.
    #[error("{} holds the tensor `{tensor}`, which this network does not have: use the version that wrote it, or remove the tensor", path.display())]
    UnknownTensor {
        /// The file.
        path: PathBuf,
        /// The tensor's name.
        tensor: String,
    },
    /// A stored tensor has another shape than the configuration asks for.
    #[error("{}: tensor `{tensor}` has shape {found:?} but the configuration asks for {expected:?}: set the width, latent and descriptor sizes the file was written with, or use other weights", path.display())]
    TensorShape {
        /// The file.
        path: PathBuf,
        /// The tensor's name.
        tensor: String,
        /// The file's shape.
        found: Vec<usize>,
        /// The configuration's shape.
        expected: Vec<usize>,
    },
    /// A stored tensor has another number format than expected.
    #[error("{}: tensor `{tensor}` is stored as {found} but {expected} is expected: convert it", path.display())]
    TensorType {
        /// The file.
        path: PathBuf,
        /// The tensor's name.
        tensor: String,
        /// The file's number format.
        found: safetensors::Dtype,
        /// The expected number format.
        expected: safetensors::Dtype,
    },
    /// A stored number is NaN or infinite.
    #[error("{}: entry {index} of tensor `{tensor}` is {value}: the file is damaged or training diverged; use an earlier checkpoint", path.display())]
    NonFiniteTensor {
        /// The file.
        path: PathBuf,
        /// The tensor's name.
        tensor: String,
        /// Index inside the tensor.
        index: usize,
        /// The value found.
        value: f32,
    },
}
