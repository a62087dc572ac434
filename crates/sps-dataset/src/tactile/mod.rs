mod aggregate;
mod range;

use crate::Property;

pub use aggregate::{Average, Cell, SurfaceAverages, TactileSettings};
pub use range::{OutOfRange, RangePolicy};
pub(crate) use range::{is_plausible, nominal_range};

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

impl TactileTable {
    /// Which value of a reading is the given property.
    pub fn column(&self, property: &str) -> Option<usize> {
        self.properties
            .iter()
            .position(|column| column == &property)
    }
}
