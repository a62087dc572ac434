//! The fifteen properties that the SynTouch Toccare measures (Purri and Dana, ECCV 2020, table 1).
//! All are unitless, nominally 0 to 100.

use super::Property;

/// The range that the device is said to report in (section 3, "Tactile Data").
pub const NOMINAL_RANGE: [f64; 2] = [0.0, 100.0];

/// A property of the Toccare.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Known {
    /// The acronym of the paper.
    pub code: &'static str,
    /// The property in words.
    pub name: &'static str,
    /// Its group (section 3, "Tactile Data").
    pub category: &'static str,
}

/// All fifteen, by category.
pub const ALL: [Known; 15] = [
    known("fRS", "sliding resistance", "friction"),
    known("fST", "tactile stiction", "friction"),
    known("uCO", "microtexture coarseness", "texture"),
    known("uRO", "microtexture roughness", "texture"),
    known("mRG", "macrotexture regularity", "texture"),
    known("mCO", "macrotexture coarseness", "texture"),
    known("mTX", "macrotexture", "texture"),
    known("tCO", "thermal cooling", "thermal conductance"),
    known("tPR", "thermal persistence", "thermal conductance"),
    known("cCM", "tactile compliance", "compliance"),
    known("cDF", "local deformation", "compliance"),
    known("cDP", "damping", "compliance"),
    known("cRX", "relaxation", "compliance"),
    known("cYD", "yielding", "compliance"),
    known("aTK", "adhesive tack", "adhesion"),
];

const fn known(code: &'static str, name: &'static str, category: &'static str) -> Known {
    Known {
        code,
        name,
        category,
    }
}

/// All fifteen, in the order of [`ALL`].
pub fn properties() -> Vec<Property> {
    ALL.map(|known| Property(known.code.into())).to_vec()
}

/// The property of that code; `None` where it is none of the fifteen.
pub fn find(code: &str) -> Option<&'static Known> {
    ALL.iter().find(|known| known.code == code)
}
