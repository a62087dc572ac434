use serde::{Deserialize, Serialize};

use crate::{Property, TactileTable};

/// The range that the device is said to report in (section 3, "Tactile Data").
pub const NOMINAL_RANGE: std::ops::RangeInclusive<f64> = 0.0..=100.0;

/// Beyond this a value is a mistake of its file; sums and squares of what is within cannot overflow.
pub(crate) fn is_plausible(value: f64) -> bool {
    value.abs() <= 1e9
}

/// What is done with a value outside [`NOMINAL_RANGE`]; published tables have some.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RangePolicy {
    /// It stays as it is, and is counted.
    #[default]
    Keep,
    /// It becomes the nearer end of the range.
    Clamp,
    /// It is an error that names the file, the line and the value.
    Reject,
}

impl RangePolicy {
    /// What a reading of that value is read as.
    pub(crate) fn apply(self, value: f64) -> f64 {
        match self {
            Self::Clamp => value.clamp(*NOMINAL_RANGE.start(), *NOMINAL_RANGE.end()),
            Self::Keep | Self::Reject => value,
        }
    }
}

/// How many values of one property lie outside [`NOMINAL_RANGE`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct OutOfRange {
    /// Values below 0.
    pub below: usize,
    /// Values above 100.
    pub above: usize,
}

impl TactileTable {
    /// Counts the values outside [`NOMINAL_RANGE`], one count per property of the table.
    pub fn out_of_range(&self) -> Vec<(Property, OutOfRange)> {
        let mut counts = vec![OutOfRange::default(); self.properties.len()];
        for reading in &self.readings {
            for (count, value) in counts.iter_mut().zip(&reading.values) {
                count.below += usize::from(value.is_some_and(|v| v < *NOMINAL_RANGE.start()));
                count.above += usize::from(value.is_some_and(|v| v > *NOMINAL_RANGE.end()));
            }
        }
        self.properties.iter().copied().zip(counts).collect()
    }

    pub(crate) fn apply(&mut self, policy: RangePolicy) {
        for value in self
            .readings
            .iter_mut()
            .flat_map(|reading| &mut reading.values)
            .flatten()
        {
            *value = policy.apply(*value);
        }
    }
}
