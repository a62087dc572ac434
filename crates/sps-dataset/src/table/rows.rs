use std::collections::HashMap;
use std::path::Path;

use crate::tactile::is_plausible;
use crate::{
    DatasetError, DatasetErrorKind, NOMINAL_RANGE, OutOfRange, Place, Property, PropertyRanges,
    RangePolicy, Reading, Surface, TactileTable, UnknownName,
};

/// A table as its file has it, before anything is made of its values.
pub(super) struct RawTable {
    /// What each value of a row is.
    pub(super) columns: Vec<Property>,
    pub(super) rows: Vec<RawRow>,
    /// Mean and standard deviation per column; only where the values are to be restored by them.
    pub(super) restore: Option<[Vec<f64>; 2]>,
}

pub(super) struct RawRow {
    pub(super) place: Place,
    pub(super) surface: String,
    pub(super) location: u32,
    pub(super) repeat: u32,
    pub(super) values: Vec<Option<f64>>,
}

/// A table after reading.
pub(crate) struct TactileRead {
    pub(crate) table: TactileTable,
    /// Counted before they were clamped.
    pub(crate) out_of_range: Vec<(Property, OutOfRange)>,
}

/// What a table is read for: the surfaces it may speak of and what is wanted of it.
pub(super) struct Wanted<'a> {
    pub(super) path: &'a Path,
    pub(super) surfaces: &'a [Surface],
    pub(super) properties: &'a [Property],
    pub(super) policy: RangePolicy,
    pub(super) ranges: &'a PropertyRanges,
}

impl Wanted<'_> {
    /// Keeps the wanted columns in the wanted order, finds the surfaces, restores standardised
    /// values, counts those out of range, applies the policy for them and holds what they then are
    /// to the declared ranges.
    pub(super) fn assemble(&self, raw: RawTable) -> Result<TactileRead, DatasetError> {
        let columns = self.find_columns(&raw.columns)?;
        let index: HashMap<&str, usize> = self
            .surfaces
            .iter()
            .enumerate()
            .map(|(i, surface)| (surface.id.as_str(), i))
            .collect();
        let mut first_seen: HashMap<(usize, u32, u32), Place> = HashMap::new();
        let mut readings = Vec::with_capacity(raw.rows.len());
        for row in raw.rows {
            let surface = *index
                .get(row.surface.as_str())
                .ok_or_else(|| self.unknown(&row))?;
            let touch = (surface, row.location, row.repeat);
            if let Some(first) = first_seen.insert(touch, row.place.clone()) {
                return Err(self.twice(row, first));
            }
            let values = self.values(&row, &columns, raw.restore.as_ref())?;
            readings.push(Reading {
                surface,
                location: row.location,
                repeat: row.repeat,
                values,
            });
        }
        let mut table = TactileTable {
            properties: self.properties.to_vec(),
            readings,
        };
        let out_of_range = table.out_of_range();
        table.apply(self.policy);
        Ok(TactileRead {
            table,
            out_of_range,
        })
    }

    fn find_columns(&self, columns: &[Property]) -> Result<Vec<usize>, DatasetError> {
        let find = |&property: &Property| {
            columns
                .iter()
                .position(|&column| column == property)
                .ok_or_else(|| {
                    let listed: Vec<_> = columns.iter().map(|column| column.code()).collect();
                    let kind = DatasetErrorKind::unexpected(
                        "the columns of the table",
                        listed.join(", "),
                        format!("one for `{property}`, which the dataset lists in its properties"),
                    );
                    DatasetError::file(self.path, kind)
                })
        };
        self.properties.iter().map(find).collect()
    }

    fn values(
        &self,
        row: &RawRow,
        columns: &[usize],
        restore: Option<&[Vec<f64>; 2]>,
    ) -> Result<Vec<Option<f64>>, DatasetError> {
        let value = |(&column, &property): (&usize, &Property)| {
            let Some(stored) = row.values.get(column).copied().flatten() else {
                return Ok(None);
            };
            let value = restore.map_or(stored, |[mean, std]| stored * std[column] + mean[column]);
            let surface = || row.surface.clone();
            let refused = |kind| Err(DatasetError::new(self.path, row.place.clone(), kind));
            let rejected = self.policy == RangePolicy::Reject && !NOMINAL_RANGE.contains(&value);
            if rejected || !is_plausible(value) {
                return refused(DatasetErrorKind::OutOfRange {
                    surface: surface(),
                    property,
                    value,
                });
            }
            if let Some([low, high]) = self.ranges.broken_by(property, self.policy.apply(value)) {
                return refused(DatasetErrorKind::OutOfDeclaredRange {
                    surface: surface(),
                    property,
                    value,
                    low,
                    high,
                });
            }
            Ok(Some(value))
        };
        columns.iter().zip(self.properties).map(value).collect()
    }

    fn unknown(&self, row: &RawRow) -> DatasetError {
        let known = self.surfaces.iter().map(|surface| surface.id.as_str());
        let kind = DatasetErrorKind::UnknownName(UnknownName {
            expected: Vec::new(),
            ..UnknownName::new("surface", &row.surface, known)
        });
        DatasetError::new(self.path, row.place.clone(), kind)
    }

    fn twice(&self, row: RawRow, first: Place) -> DatasetError {
        let RawRow {
            place,
            surface,
            location,
            repeat,
            ..
        } = row;
        let kind = DatasetErrorKind::DuplicateReading {
            surface,
            location,
            repeat,
            first,
        };
        DatasetError::new(self.path, place, kind)
    }
}
