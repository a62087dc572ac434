use std::collections::HashMap;
use std::path::Path;

use super::Statistics;
use super::rows::{RawRow, RawTable};
use crate::{DatasetError, DatasetErrorKind, Place, Property};

/// The values of one touch, in the order of the table's columns.
pub(super) type Values = Vec<Option<f64>>;

/// One touch of an entry: location, repeat, values.
pub(super) type Touch = (u32, u32, Values);

/// A table that has one entry per surface, and perhaps its own statistics among them.
pub(super) struct KeyedTable<'a> {
    path: &'a Path,
    statistics: &'a Statistics,
    first_seen: HashMap<String, Place>,
    rows: Vec<RawRow>,
    mean: Option<(Place, Values)>,
    std: Option<(Place, Values)>,
}

impl<'a> KeyedTable<'a> {
    pub(super) fn new(path: &'a Path, statistics: &'a Statistics) -> Self {
        let (first_seen, rows) = (HashMap::new(), Vec::new());
        Self {
            path,
            statistics,
            first_seen,
            rows,
            mean: None,
            std: None,
        }
    }

    /// Takes the entry of a surface, or of the statistics.
    pub(super) fn push(
        &mut self,
        place: Place,
        name: &str,
        touches: Vec<Touch>,
    ) -> Result<(), DatasetError> {
        if let Some(first) = self.first_seen.insert(name.to_owned(), place.clone()) {
            let kind = DatasetErrorKind::twice(name, &first);
            return Err(DatasetError::new(self.path, place, kind));
        }
        if name == self.statistics.mean || name == self.statistics.std {
            let Ok([(_, _, values)]) = <[Touch; 1]>::try_from(touches) else {
                let found = "several values per property";
                let kind = DatasetErrorKind::unexpected("the file's own statistics", found, "one");
                return Err(DatasetError::new(self.path, place, kind));
            };
            let to = if name == self.statistics.mean {
                &mut self.mean
            } else {
                &mut self.std
            };
            *to = Some((place, values));
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

    pub(super) fn finish(self, columns: Vec<Property>) -> Result<RawTable, DatasetError> {
        let (path, names) = (self.path, self.statistics);
        let restore = if names.restore {
            let mean = complete(path, &names.mean, self.mean)?;
            Some([mean, complete(path, &names.std, self.std)?])
        } else {
            None
        };
        Ok(RawTable {
            columns,
            rows: self.rows,
            restore,
        })
    }
}

/// Statistics that values are to be restored by must be there for every property.
fn complete(
    path: &Path,
    name: &str,
    entry: Option<(Place, Values)>,
) -> Result<Vec<f64>, DatasetError> {
    let expected = "one number per property, for the values are to be restored by them";
    let unexpected = |place, found: &str| {
        let kind = DatasetErrorKind::unexpected("the file's own statistics", found, expected);
        DatasetError::new(path, place, kind)
    };
    let (place, values) =
        entry.ok_or_else(|| unexpected(Place::File, &format!("no entry `{name}`")))?;
    let complete: Option<Vec<f64>> = values.into_iter().collect();
    complete.ok_or_else(|| unexpected(place, "a missing value"))
}
