use std::collections::HashMap;
use std::path::Path;

use sps_base::names::nearest;

use crate::folder::Manifest;
use crate::tactile::{is_plausible, nominal_range};
use crate::{
    DatasetError, DatasetErrorKind, OutOfRange, Place, Property, PropertyRange, RangePolicy,
    Reading, Surface, TactileTable, UnknownName,
};

/// Readings further from 0 than this are a mistake of their file.
const PLAUSIBLE: [f64; 2] = [-1e9, 1e9];

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
    /// Says which properties, and where they end.
    pub(super) manifest: &'a Manifest,
    pub(super) policy: RangePolicy,
}

/// A wanted property: its column in the file, and where its values should and must lie.
struct Column<'a> {
    property: &'a Property,
    at: usize,
    nominal: Option<[f64; 2]>,
    declared: Option<PropertyRange>,
}

impl Wanted<'_> {
    /// Keeps the wanted columns in the wanted order, finds the surfaces, restores standardised
    /// values, counts those out of range, applies the policy for them and holds what they then are
    /// to the declared ranges.
    pub(super) fn assemble(&self, raw: RawTable) -> Result<TactileRead, DatasetError> {
        let columns = self.find_columns(&raw.columns)?;
        let mut out_of_range = vec![OutOfRange::default(); columns.len()];
        let ids = self.surfaces.iter().map(|surface| surface.id.as_str());
        let index: HashMap<&str, usize> = ids.zip(0..).collect();
        let mut first_seen: HashMap<(usize, u32, u32), Place> = HashMap::new();
        let mut readings = Vec::with_capacity(raw.rows.len());
        for row in raw.rows {
            let surface = index.get(row.surface.as_str());
            let surface = *surface.ok_or_else(|| self.unknown(&row))?;
            let touch = (surface, row.location, row.repeat);
            if let Some(first) = first_seen.insert(touch, row.place.clone()) {
                let touch = format!("location {}, repeat {}", row.location, row.repeat);
                let what = format!("{touch} of surface `{}`", row.surface);
                let twice = format!("{what} is listed twice, first at {first}");
                return Err(self.invalid(&row, twice));
            }
            let values = columns.iter().zip(&mut out_of_range);
            let values = values
                .map(|(column, count)| self.value(&row, column, raw.restore.as_ref(), count))
                .collect::<Result<_, _>>()?;
            readings.push(Reading {
                surface,
                location: row.location,
                repeat: row.repeat,
                values,
            });
        }
        let properties = self.manifest.properties.to_vec();
        Ok(TactileRead {
            out_of_range: properties.iter().cloned().zip(out_of_range).collect(),
            table: TactileTable {
                properties,
                readings,
            },
        })
    }

    fn find_columns(&self, columns: &[Property]) -> Result<Vec<Column<'_>>, DatasetError> {
        let places: HashMap<&Property, usize> = columns.iter().zip(0..).collect();
        let find = |property| {
            let at = *places
                .get(property)
                .ok_or_else(|| self.missing(property, columns))?;
            Ok(Column {
                property,
                at,
                nominal: nominal_range(property, self.manifest),
                declared: self.manifest.range(property),
            })
        };
        self.manifest.properties.iter().map(find).collect()
    }

    fn missing(&self, property: &Property, columns: &[Property]) -> DatasetError {
        let listed: Vec<_> = columns.iter().map(Property::code).collect();
        let near = nearest(property, listed.iter().copied());
        let near = near.map_or(String::new(), |near| format!(" (is it `{near}`?)"));
        let kind = DatasetErrorKind::unexpected(
            "the columns of the table",
            listed.join(", "),
            format!("one for `{property}`, which the dataset lists in its properties{near}"),
        );
        DatasetError::file(self.path, kind)
    }

    /// The value of a cell, restored where the file says so and as the policy takes it; counted where it
    /// lies out of range.
    fn value(
        &self,
        row: &RawRow,
        column: &Column<'_>,
        restore: Option<&[Vec<f64>; 2]>,
        count: &mut OutOfRange,
    ) -> Result<Option<f64>, DatasetError> {
        let (at, nominal) = (column.at, column.nominal);
        let Some(stored) = row.values.get(at).copied().flatten() else {
            return Ok(None);
        };
        let value = restore.map_or(stored, |[mean, std]| stored * std[at] + mean[at]);
        let refused = |[low, high]: [f64; 2], why| {
            let of = format!("{} of `{}`", column.property, row.surface);
            let text = format!("{of} is {value}, outside {low} to {high}, {why}");
            Err(self.invalid(row, text))
        };
        let outside = |[low, high]: &[f64; 2]| !(low..=high).contains(&&value);
        let rejected = nominal.filter(|range| self.policy == RangePolicy::Reject && outside(range));
        let implausible = (!is_plausible(value)).then_some(PLAUSIBLE);
        if let Some(range) = rejected.or(implausible) {
            return refused(range, "and is to be rejected");
        }
        count.count(value, nominal);
        let taken = self.policy.apply(value, nominal);
        match column.declared.filter(|range| !range.holds(taken)) {
            None => Ok(Some(taken)),
            Some(range) => refused(range.ends(), "the range that the dataset declares"),
        }
    }

    fn invalid(&self, row: &RawRow, text: String) -> DatasetError {
        DatasetError::new(
            self.path,
            row.place.clone(),
            DatasetErrorKind::Invalid(text),
        )
    }

    fn unknown(&self, row: &RawRow) -> DatasetError {
        let known = self.surfaces.iter().map(|surface| surface.id.as_str());
        let kind = DatasetErrorKind::UnknownName(UnknownName {
            expected: Vec::new(),
            ..UnknownName::new("surface", &row.surface, known)
        });
        DatasetError::new(self.path, row.place.clone(), kind)
    }
}
