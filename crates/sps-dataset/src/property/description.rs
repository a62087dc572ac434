use serde::{Deserialize, Serialize};

use super::{Property, toccare};
use crate::InvalidValue;

/// What is known of a property beside its code. All of it may be missing.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
pub struct Description {
    /// In a few words: "coefficient of sliding friction".
    #[serde(skip_serializing_if = "String::is_empty")]
    pub name: String,
    /// The unit of its values, `1` for a pure number; empty where values have none.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub unit: String,
    /// The lowest and highest value that it can take at all: its device or its scale ends there, so
    /// an interval can. Every reading lies within.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub range: Option<PropertyRange>,
    /// A sentence about it.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub description: String,
}

impl Description {
    /// What the project knows of the property by itself.
    pub fn known(property: &Property) -> Self {
        let known = toccare::find(property);
        Self {
            name: known.map_or("", |known| known.name).to_owned(),
            ..Self::default()
        }
    }
}

/// The lowest and highest value that a property can take. An end may be infinite.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "[f64; 2]")]
pub struct PropertyRange([f64; 2]);

impl PropertyRange {
    /// The ends, lower first.
    pub const fn ends(self) -> [f64; 2] {
        self.0
    }

    /// Whether a value lies within, ends included.
    pub fn holds(self, value: f64) -> bool {
        let [low, high] = self.0;
        (low..=high).contains(&value)
    }
}

impl TryFrom<[f64; 2]> for PropertyRange {
    type Error = InvalidValue;

    fn try_from([low, high]: [f64; 2]) -> Result<Self, InvalidValue> {
        // Neither is NaN.
        if low < high {
            return Ok(Self([low, high]));
        }
        let found = format!("found a range of {low} to {high}");
        Err(InvalidValue(format!(
            "{found}, expected a lower end below the upper"
        )))
    }
}
