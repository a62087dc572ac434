use serde::{Deserialize, Serialize};

use crate::folder::Manifest;
use crate::{Property, PropertyRange, toccare};

/// Beyond this a value is a mistake of its file; sums and squares of what is within cannot overflow.
pub(crate) fn is_plausible(value: f64) -> bool {
    value.abs() <= 1e9
}

/// What is done with a value outside of the range of its property: 0 to 100 for the Toccare's, of which
/// published tables leave it, and the one that the dataset declares for others.
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
    /// What a reading of that value is read as, where values should lie in `range`.
    pub(crate) fn apply(self, value: f64, range: Option<[f64; 2]>) -> f64 {
        match (self, range) {
            (Self::Clamp, Some([low, high])) => value.clamp(low, high),
            _ => value,
        }
    }
}

/// Where values of a property should lie; `None` where nobody says.
pub(crate) fn nominal_range(property: &Property, manifest: &Manifest) -> Option<[f64; 2]> {
    match toccare::find(property) {
        Some(_) => Some(toccare::NOMINAL_RANGE),
        None => manifest.range(property).map(PropertyRange::ends),
    }
}

/// How many values of one property lie outside of its range.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct OutOfRange {
    /// Values below its lower end.
    pub below: usize,
    /// Values above its upper end.
    pub above: usize,
}

impl OutOfRange {
    /// Counts one value.
    pub(crate) fn count(&mut self, value: f64, range: Option<[f64; 2]>) {
        if let Some([low, high]) = range {
            self.below += usize::from(value < low);
            self.above += usize::from(value > high);
        }
    }
}
