use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::NOMINAL_RANGE;
use crate::Property;

/// The lowest and highest value that properties can take at all, for those of which a source knows
/// them: its device or its scale ends there, so that an interval can. An end may be infinite.
///
/// Every reading of the source lies within, ends included.
///
/// ```
/// use sps_dataset::{Property, PropertyRanges};
///
/// let ranges = PropertyRanges::new([(Property::FRS, [0.0, f64::INFINITY])])?;
/// assert_eq!(ranges.get(Property::FRS), Some([0.0, f64::INFINITY]));
/// assert_eq!(ranges.get(Property::CDF), None);
/// # Ok::<(), sps_dataset::InvalidRange>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "BTreeMap<Property, [f64; 2]>")]
pub struct PropertyRanges(BTreeMap<Property, [f64; 2]>);

/// A range that holds no two values.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("the range of `{property}`: found {low} to {high}, expected a lower end below the upper")]
pub struct InvalidRange {
    /// The property.
    pub property: Property,
    /// Its lower end.
    pub low: f64,
    /// Its upper end.
    pub high: f64,
}

impl PropertyRanges {
    /// The ranges, lower end first.
    ///
    /// # Errors
    /// Where a lower end is not below the upper one.
    pub fn new(
        ranges: impl IntoIterator<Item = (Property, [f64; 2])>,
    ) -> Result<Self, InvalidRange> {
        Self::try_from(ranges.into_iter().collect::<BTreeMap<_, _>>())
    }

    /// [`NOMINAL_RANGE`] for all fifteen.
    pub fn nominal() -> Self {
        let ends = [*NOMINAL_RANGE.start(), *NOMINAL_RANGE.end()];
        Self(Property::ALL.map(|property| (property, ends)).into())
    }

    /// The lowest and highest value of a property, where they are known.
    pub fn get(&self, property: Property) -> Option<[f64; 2]> {
        self.0.get(&property).copied()
    }

    /// The properties with a range, in the order of [`Property::ALL`].
    pub fn properties(&self) -> impl Iterator<Item = Property> {
        self.0.keys().copied()
    }

    /// Whether no property has one.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The range of the property, where the value lies outside of it.
    pub(crate) fn broken_by(&self, property: Property, value: f64) -> Option<[f64; 2]> {
        self.get(property)
            .filter(|[low, high]| !(low..=high).contains(&&value))
    }
}

impl TryFrom<BTreeMap<Property, [f64; 2]>> for PropertyRanges {
    type Error = InvalidRange;

    fn try_from(ranges: BTreeMap<Property, [f64; 2]>) -> Result<Self, InvalidRange> {
        let found = ranges.iter().find(|(_, [low, high])| {
            // Neither is NaN.
            !matches!(low.partial_cmp(high), Some(std::cmp::Ordering::Less))
        });
        if let Some((&property, &[low, high])) = found {
            return Err(InvalidRange {
                property,
                low,
                high,
            });
        }
        Ok(Self(ranges))
    }
}
