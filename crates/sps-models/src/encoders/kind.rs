use std::fmt;
use std::str::FromStr;

use super::se_resnext::SeResNextConfig;
use super::{se_resnext, squeezenet};
use crate::error::{Error, Result};
use crate::weights::TensorSpec;

/// The networks that turn an image into an embedding.
///
/// Parses from and prints as the name used in configurations.
///
/// ```
/// use sps_models::encoders::EncoderKind;
///
/// let kind: EncoderKind = "se-resnext50-32x4d".parse()?;
/// assert_eq!(kind, EncoderKind::SeResNext50);
/// assert_eq!(kind.width(), 2048);
/// # Ok::<(), sps_models::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[non_exhaustive]
pub enum EncoderKind {
    /// `se-resnext50-32x4d`: the paper's encoder, squeeze-and-excitation ResNeXt of 50 layers
    /// (Hu et al., CVPR 2018), with the tensor names of timm's `legacy_seresnext50_32x4d`.
    SeResNext50,
    /// `se-resnext-small`: the same family, a quarter as wide and half as deep, 8 groups of 4
    /// channels: 1.2 M parameters, 0.2 G multiply-adds for an image of 224 x 224.
    SeResNextSmall,
    /// `squeezenet1-0`: `SqueezeNet` 1.0 (Iandola et al., 2016), with the tensor names of
    /// torchvision's `squeezenet1_0`.
    SqueezeNet1_0,
}

impl EncoderKind {
    /// Every encoder.
    pub const ALL: [Self; 3] = [Self::SeResNext50, Self::SeResNextSmall, Self::SqueezeNet1_0];

    /// The name in configurations and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::SeResNext50 => "se-resnext50-32x4d",
            Self::SeResNextSmall => "se-resnext-small",
            Self::SqueezeNet1_0 => "squeezenet1-0",
        }
    }

    /// The length of an embedding.
    pub const fn width(self) -> usize {
        match self.se_resnext() {
            Some(config) => config.width(),
            None => squeezenet::WIDTH,
        }
    }

    /// The smallest height and width of an image in pixels.
    pub const fn min_size(self) -> usize {
        match self {
            Self::SeResNext50 | Self::SeResNextSmall => 1,
            Self::SqueezeNet1_0 => squeezenet::MIN_SIZE,
        }
    }

    /// Multiply-adds to embed one image of so many pixels: those of the convolutions and of the
    /// squeeze-and-excitation gates, by shape. `None` for an image smaller than
    /// [`EncoderKind::min_size`].
    ///
    /// ```
    /// use sps_models::encoders::EncoderKind;
    ///
    /// let paper = EncoderKind::SeResNext50.multiply_adds(224, 224);
    /// assert_eq!(paper.map(|count| count / 100_000_000), Some(42)); // 4.2 G
    /// ```
    pub fn multiply_adds(self, height: usize, width: usize) -> Option<u64> {
        if height.min(width) < self.min_size() {
            return None;
        }
        let size = [1, height, width];
        match self.se_resnext() {
            Some(config) => se_resnext::multiply_adds(&config, size),
            None => squeezenet::multiply_adds(size),
        }
    }

    /// The tensors of the network, in the order of its layers.
    pub fn specs(self) -> Vec<TensorSpec> {
        match self.se_resnext() {
            Some(config) => se_resnext::specs(&config),
            None => squeezenet::specs(),
        }
    }

    pub(super) const fn se_resnext(self) -> Option<SeResNextConfig> {
        match self {
            Self::SeResNext50 => Some(SeResNextConfig::RESNEXT50_32X4D),
            Self::SeResNextSmall => Some(SeResNextConfig::SMALL),
            Self::SqueezeNet1_0 => None,
        }
    }

    /// Whether a weights file may hold this tensor though the embedding does not need it: the
    /// classifier, and batch norm's count of batches.
    pub(super) fn passes(self, tensor: &str) -> bool {
        let classifier = match self {
            Self::SeResNext50 | Self::SeResNextSmall => "last_linear.",
            Self::SqueezeNet1_0 => "classifier.1.",
        };
        tensor.starts_with(classifier) || tensor.ends_with(".num_batches_tracked")
    }
}

impl fmt::Display for EncoderKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for EncoderKind {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        Self::ALL
            .into_iter()
            .find(|kind| kind.name() == name)
            .ok_or_else(|| Error::UnknownEncoder {
                found: name.to_owned(),
                expected: Self::ALL.map(Self::name).join(", "),
            })
    }
}
