use std::collections::HashMap;

use super::Statistics;
use super::rows::{RawRow, RawTable};
use crate::Property;
use crate::error::{Fault, Place};

/// The values of one touch, in the order of the table's columns.
pub(super) type Values = Vec<Option<f64>>;

/// One touch of an entry: location, repeat, values.
pub(super) type Touch = (u32, u32, Values);

/// A table that has one entry per surface, and perhaps its own statistics among them.
pub(super) struct KeyedTable<'a> {
    names: &'a Statistics,
    first_seen: HashMap<String, Place>,
    rows: Vec<RawRow>,
    statistics: HashMap<String, (Place, Values)>,
}

impl<'a> KeyedTable<'a> {
    pub(super) fn new(names: &'a Statistics) -> Self {
        Self {
            names,
            first_seen: HashMap::new(),
            rows: Vec::new(),
            statistics: HashMap::new(),
        }
    }

    /// Takes the entry of a surface, or of the statistics.
    pub(super) fn push(
        &mut self,
        place: Place,
        name: &str,
        touches: Vec<Touch>,
    ) -> Result<(), Fault> {
        if let Some(first) = self.first_seen.insert(name.to_owned(), place.clone()) {
            return Err(Fault::twice(name, &first).at(place));
        }
        if name == self.names.mean || name == self.names.std {
            let Ok([(_, _, values)]) = <[Touch; 1]>::try_from(touches) else {
                let found = "several values per property";
                return Err(unexpected_statistics(found, "one").at(place));
            };
            self.statistics.insert(name.to_owned(), (place, values));
            return Ok(());
        }
        let row = |(location, repeat, values)| RawRow {
            place: place.clone(),
            surface: name.to_owned(),
            location,
            repeat,
            values,
        };
        self.rows.extend(touches.into_iter().map(row));
        Ok(())
    }

    pub(super) fn finish(self, columns: Vec<Property>) -> Result<RawTable, Fault> {
        let Statistics { mean, std, restore } = self.names;
        let restore = if *restore {
            if mean == std {
                let found = format!("`{mean}` as mean and std");
                return Err(unexpected_statistics(&found, "two names"));
            }
            Some([self.complete(mean)?, self.complete(std)?])
        } else {
            None
        };
        Ok(RawTable {
            columns,
            rows: self.rows,
            restore,
        })
    }

    /// Statistics that values are to be restored by must be there for every property.
    fn complete(&self, name: &str) -> Result<Vec<f64>, Fault> {
        let expected = "one number per property, for the values are to be restored by them";
        let Some((place, values)) = self.statistics.get(name) else {
            return Err(unexpected_statistics(
                &format!("no entry `{name}`"),
                expected,
            ));
        };
        let values: Option<_> = values.iter().copied().collect();
        values.ok_or_else(|| unexpected_statistics("a missing value", expected).at(place.clone()))
    }
}

fn unexpected_statistics(found: &str, expected: &str) -> Fault {
    Fault::unexpected("the file's own statistics", found, expected)
}
