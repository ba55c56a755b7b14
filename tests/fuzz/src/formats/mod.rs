//! Files of each format, whole or with values replaced one by one.

pub mod glb;
pub mod json;
pub mod npy;
pub mod tensors;
pub mod text;
pub mod toml;
pub mod zip;
