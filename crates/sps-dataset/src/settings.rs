use serde::{Deserialize, Serialize};

use crate::{DecodeSettings, TableFormat, TactileSettings};

/// How a dataset is to be read, as a config says it; every key has a default.
///
/// ```
/// use sps_dataset::{Average, RangePolicy, ReadSettings, parse_toml};
///
/// let text = r#"
///     [tactile]
///     out-of-range = "clamp"
///     repeats = "median"
///
///     [images]
///     exposure-stops = -1.5
/// "#;
/// let settings: ReadSettings = parse_toml("run.toml".as_ref(), text)?;
/// assert_eq!(settings.tactile.out_of_range, RangePolicy::Clamp);
/// assert_eq!(settings.tactile.locations, Average::Mean);
/// # Ok::<(), sps_dataset::DatasetError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
pub struct ReadSettings {
    /// The tactile table's layout, where not the one that `dataset.toml` gives is to be used.
    pub table: Option<TableFormat>,
    /// What is made of tactile readings.
    pub tactile: TactileSettings,
    /// How images become frames.
    pub images: DecodeSettings,
    /// The most bytes of a table or of `dataset.toml`, and of an archive once unpacked. Default
    /// 64 MiB.
    pub table_bytes: u64,
}

impl Default for ReadSettings {
    fn default() -> Self {
        Self {
            table: None,
            tactile: TactileSettings::default(),
            images: DecodeSettings::default(),
            table_bytes: 64 << 20,
        }
    }
}
