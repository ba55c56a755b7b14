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
    /// Grids between which the field also depends on the spacing of the grid that it is for; absent for a field that does not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub resolution: Option<ResolutionRange>,
}

/// Spacings of the coarsest and the finest grid that a field is trained for, in its own coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ResolutionRange {
    /// Edge of the largest element.
    pub coarse: f32,
    /// Edge of the smallest element.
    pub fine: f32,
}

impl ResolutionRange {
    /// Four numbers that say a spacing, the logarithm of which lies at `s` between the coarsest (0) and the finest (1): sine and cosine of
    /// `pi s` and `2 pi s` (the positional encoding of the supplement, Fig. 11).
    pub(crate) fn encoded(&self, spacing: f32) -> [f64; 4] {
        let [coarse, fine, own] = [self.coarse, self.fine, spacing].map(f64::from);
        let s = std::f64::consts::PI * (coarse / own).ln() / (coarse / fine).ln();
        [s.sin(), s.cos(), (2.0 * s).sin(), (2.0 * s).cos()]
    }

    fn is_valid(&self) -> bool {
        self.coarse.is_finite() && self.fine > 0.0 && self.fine < self.coarse
    }
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
            resolution: None,
        }
    }

    /// Checks every field against its documented range.
    ///
    /// # Errors
    /// [`Error::DescriptorSize`], [`Error::LatentSize`], [`Error::Omega`] or [`Error::Resolution`].
    pub fn validate(&self) -> Result<(), Error> {
        check_code_sizes(self.descriptor, self.latent)?;
        if !(self.omega.is_finite() && self.omega > 0.0) {
            return Err(Error::Omega { found: self.omega });
        }
        if let Some(range) = self.resolution.filter(|range| !range.is_valid()) {
            return Err(Error::Resolution {
                coarse: range.coarse,
                fine: range.fine,
            });
        }
        Ok(())
    }

    /// Number of parameters before those of the branch that knows the spacing.
    pub(crate) fn layout_without_resolution(&self) -> usize {
        let without = Self {
            resolution: None,
            ..self.clone()
        };
        let last = layout::parameter_layout(&without).pop();
        last.map_or(0, |tensor| tensor.range.end)
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
