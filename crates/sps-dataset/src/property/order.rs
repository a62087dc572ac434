use std::collections::HashSet;
use std::ops::Deref;

use serde::{Deserialize, Serialize};

use super::{Property, toccare};

/// Properties in an explicit order: at least one, none twice.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "Vec<Property>", into = "Vec<Property>")]
pub struct PropertyOrder(Vec<Property>);

/// A list of properties that is no order.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum InvalidOrder {
    /// It is empty.
    #[error("the list of properties is empty, expected at least one")]
    Empty,
    /// It has a property twice.
    #[error("property `{0}` is listed twice")]
    Twice(Property),
}

impl PropertyOrder {
    /// The Toccare's fifteen, in the order of [`toccare::ALL`].
    pub fn toccare() -> Self {
        Self(toccare::properties())
    }

    /// Where a property stands in the order.
    pub fn position(&self, property: &Property) -> Option<usize> {
        self.0.iter().position(|listed| listed == property)
    }
}

impl TryFrom<Vec<Property>> for PropertyOrder {
    type Error = InvalidOrder;

    fn try_from(properties: Vec<Property>) -> Result<Self, InvalidOrder> {
        if properties.is_empty() {
            return Err(InvalidOrder::Empty);
        }
        let mut seen = HashSet::new();
        match properties.iter().find(|property| !seen.insert(*property)) {
            Some(twice) => Err(InvalidOrder::Twice(twice.clone())),
            None => Ok(Self(properties)),
        }
    }
}

impl From<PropertyOrder> for Vec<Property> {
    fn from(order: PropertyOrder) -> Self {
        order.0
    }
}

impl Deref for PropertyOrder {
    type Target = [Property];

    fn deref(&self) -> &[Property] {
        &self.0
    }
}
