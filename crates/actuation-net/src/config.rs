//! What a network looks like: sizes and the sine frequency.

use serde::{Deserialize, Serialize};

use crate::{Error, ParameterTensor, layout};

/// Largest number of basis weights a network takes.
const MAX_DESCRIPTOR: usize = 64;
/// Largest latent code.
const MAX_LATENT: usize = 256;

/// Width of the four sine layers; written as the number 64, 128 or 256.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "usize", into = "usize")]
pub enum Width {
    /// 64 features.
    W64,
    /// 128 features.
    W128,
    /// 256 features.
    W256,
}

impl Width {
    /// The number of features.
    pub fn size(self) -> usize {
        match self {
            Self::W64 => 64,
            Self::W128 => 128,
            Self::W256 => 256,
        }
    }
}

impl From<Width> for usize {
    fn from(width: Width) -> Self {
        width.size()
    }
}

impl TryFrom<usize> for Width {
    type Error = Error;

    fn try_from(size: usize) -> Result<Self, Error> {
        match size {
            64 => Ok(Self::W64),
            128 => Ok(Self::W128),
            256 => Ok(Self::W256),
            found => Err(Error::Width { found }),
        }
    }
}

/// Sizes of a network.
///
/// Fields that later versions add have serde defaults, so that older files stay readable; a field this version does not
/// know is an error, because ignoring it would change the network's meaning.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NetworkConfig {
    /// Number of basis weights that describe a shape, 1 to 64. The encoder's first layer has exactly this many columns:
    /// nothing is padded, so neither the initial statistics nor the weights file depend on an upper limit.
    pub descriptor: usize,
    /// Width of the four sine layers.
    pub width: Width,
    /// Size of the latent code `z`, 1 to 256 (32 unless told).
    #[serde(default = "default_latent")]
    pub latent: usize,
    /// Frequency `omega` of the sine layers, positive (30 unless told).
    #[serde(default = "default_omega")]
    pub omega: f32,
}

fn default_latent() -> usize {
    32
}

fn default_omega() -> f32 {
    30.0
}

impl NetworkConfig {
    /// A network for `descriptor` basis weights with the default latent size (32) and frequency (30).
    pub fn new(descriptor: usize, width: Width) -> Self {
        Self {
            descriptor,
            width,
            latent: default_latent(),
            omega: default_omega(),
        }
    }

    /// Checks every field against its documented range.
    ///
    /// # Errors
    /// [`Error::DescriptorSize`], [`Error::LatentSize`] or [`Error::Omega`].
    pub fn validate(&self) -> Result<(), Error> {
        check_code_sizes(self.descriptor, self.latent)?;
        if !(self.omega.is_finite() && self.omega > 0.0) {
            return Err(Error::Omega { found: self.omega });
        }
        Ok(())
    }

    /// Names, shapes and places of all parameters in the flat vector, in order.
    pub fn parameter_layout(&self) -> Vec<ParameterTensor> {
        layout::parameter_layout(self)
    }
}

/// Checks the sizes of a descriptor and of the latent code.
///
/// # Errors
/// [`Error::DescriptorSize`] and [`Error::LatentSize`].
pub(crate) fn check_code_sizes(descriptor: usize, latent: usize) -> Result<(), Error> {
    if !(1..=MAX_DESCRIPTOR).contains(&descriptor) {
        return Err(Error::DescriptorSize {
            found: descriptor,
            largest: MAX_DESCRIPTOR,
        });
    }
    if !(1..=MAX_LATENT).contains(&latent) {
        return Err(Error::LatentSize {
            found: latent,
            largest: MAX_LATENT,
        });
    }
    Ok(())
}
