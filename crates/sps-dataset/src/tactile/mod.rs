mod aggregate;

use serde::{Deserialize, Serialize};

use crate::Property;

pub use aggregate::{Average, Cell, SurfaceAverages, TactileSettings};

/// Values further from 0 are a mistake of their file; sums and squares of nearer ones cannot overflow.
pub(crate) const PLAUSIBLE: f64 = 1e9;

pub(crate) fn is_plausible(value: f64) -> bool {
    value.abs() <= PLAUSIBLE
}

/// One touch of one surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading {
    /// Index of the surface in its source.
    pub surface: usize,
    /// Where on the surface.
    pub location: u32,
    /// Which of the repeated touches at that location.
    pub repeat: u32,
    /// One value per property of the table; `None` was not measured.
    pub values: Vec<Option<f64>>,
}

/// Every reading of a source, with the meaning of its columns.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct TactileTable {
    /// What each value of a reading is.
    pub properties: Vec<Property>,
    /// In the order of the source.
    pub readings: Vec<Reading>,
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

/// How many values of one property lie outside of its range.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct OutOfRange {
    /// Values below its lower end.
    pub below: usize,
    /// Values above its upper end.
    pub above: usize,
}
