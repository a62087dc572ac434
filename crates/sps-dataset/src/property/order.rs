use std::collections::HashSet;
use std::ops::Deref;

use serde::{Deserialize, Serialize};

use super::Property;
use crate::InvalidValue;

/// Properties in an explicit order: at least one, none twice.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "Vec<Property>")]
pub struct PropertyOrder(Vec<Property>);

impl PropertyOrder {
    /// Where a property stands in the order.
    pub fn position(&self, property: &Property) -> Option<usize> {
        self.0.iter().position(|listed| listed == property)
    }
}

impl TryFrom<Vec<Property>> for PropertyOrder {
    type Error = InvalidValue;

    fn try_from(properties: Vec<Property>) -> Result<Self, InvalidValue> {
        let mut seen = HashSet::new();
        let twice = properties.iter().find(|property| !seen.insert(*property));
        let wrong = match twice {
            Some(twice) => format!("property `{twice}` is listed twice"),
            None if properties.is_empty() => {
                "the list of properties is empty, expected at least one".to_owned()
            }
            None => return Ok(Self(properties)),
        };
        Err(InvalidValue(wrong))
    }
}

impl Deref for PropertyOrder {
    type Target = [Property];

    fn deref(&self) -> &[Property] {
        &self.0
    }
}
