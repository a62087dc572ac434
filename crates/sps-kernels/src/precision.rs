use std::fmt;
use std::str::FromStr;

use crate::error::{Error, Result};

/// What a network computes in.
///
/// Parses from and prints as the name used in configurations.
///
/// ```
/// use sps_kernels::Precision;
///
/// assert_eq!("bf16".parse::<Precision>()?, Precision::Bf16);
/// # Ok::<(), sps_kernels::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "kebab-case")
)]
#[non_exhaustive]
pub enum Precision {
    /// Single precision.
    #[default]
    F32,
    /// Feature maps and weights of bf16, eight bits of precision, with sums of f32. Several times as fast as f32 with
    /// matrix tiles, nearly twice on some processors with AVX512-BF16; slower on others. An embedding moves by one to
    /// six hundredths of its norm.
    Bf16,
    /// As f32, but where there are matrix tiles, dense layers multiply numbers as the sum of two of bf16, 16 bits of
    /// precision: faster where most of the work is dense layers of many channels, as in ResNets. An embedding moves by
    /// some hundred thousandths of its norm. Elsewhere it is f32.
    Bf16x2,
    /// Feature maps of 0 to 255 in steps of each map's own, weights of -127 to 127 in steps of each
    /// channel's own, sums exact in i32; gates, means and embeddings of f32. The steps of the maps come
    /// from [`calibrate`](crate::inference::calibrate). A value beyond what calibration made of
    /// a map's range counts as its end, one that is no number as its lower end.
    Int8,
}

impl Precision {
    /// Every precision.
    pub const ALL: [Self; 4] = [Self::F32, Self::Bf16x2, Self::Bf16, Self::Int8];

    /// The name in configurations and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::F32 => "f32",
            Self::Bf16x2 => "bf16x2",
            Self::Bf16 => "bf16",
            Self::Int8 => "int8",
        }
    }
}

impl fmt::Display for Precision {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Precision {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        let found = Self::ALL.into_iter().find(|p| p.name() == name);
        found.ok_or_else(|| {
            let names = Self::ALL.map(Self::name).join(", ");
            Error::input("precision", name, names)
        })
    }
}
