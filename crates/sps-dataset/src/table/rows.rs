use std::collections::HashMap;

use sps_base::names::{UnknownName, nearest};

use crate::error::{Fault, Place};
use crate::folder::Manifest;
use crate::tactile::{PLAUSIBLE, is_plausible};
use crate::{
    OutOfRange, Property, PropertyRange, RangePolicy, Reading, Surface, TactileTable, toccare,
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

/// A wanted property: its column in the file, where its values should and must lie, and how many
/// do not lie where they should.
struct Column<'a> {
    property: &'a Property,
    at: usize,
    nominal: Option<[f64; 2]>,
    declared: Option<PropertyRange>,
    outside: OutOfRange,
}

/// Keeps the columns that the manifest lists in its order, finds the surfaces, restores standardised
/// values, counts those out of range, applies the policy for them and holds what they then are
/// to the declared ranges.
pub(super) fn assemble(
    raw: RawTable,
    surfaces: &[Surface],
    manifest: &Manifest,
    policy: RangePolicy,
) -> Result<TactileRead, Fault> {
    let mut columns = find_columns(&raw.columns, manifest)?;
    let ids = surfaces.iter().map(|surface| surface.id.as_str());
    let index: HashMap<&str, usize> = ids.clone().zip(0..).collect();
    let mut first_seen: HashMap<(usize, u32, u32), Place> = HashMap::new();
    let mut readings = Vec::with_capacity(raw.rows.len());
    for row in raw.rows {
        let Some(&surface) = index.get(row.surface.as_str()) else {
            let unknown = UnknownName {
                expected: Vec::new(),
                ..UnknownName::new("surface", &row.surface, ids)
            };
            return Err(Fault::invalid(unknown.to_string()).at(row.place));
        };
        let touch = (surface, row.location, row.repeat);
        if let Some(first) = first_seen.insert(touch, row.place.clone()) {
            let touch = format!("location {}, repeat {}", row.location, row.repeat);
            let of = format!("{touch} of surface `{}`", row.surface);
            let text = format!("{of} is listed twice, first at {first}");
            return Err(Fault::invalid(text).at(row.place));
        }
        let values = columns.iter_mut();
        let values = values.map(|column| column.take(&row, raw.restore.as_ref(), policy));
        let values = values.collect::<Result<_, _>>();
        readings.push(Reading {
            surface,
            location: row.location,
            repeat: row.repeat,
            values: values.map_err(|fault| fault.at(row.place))?,
        });
    }
    let out_of_range = columns.into_iter();
    let out_of_range = out_of_range.map(|column| (column.property.clone(), column.outside));
    Ok(TactileRead {
        out_of_range: out_of_range.collect(),
        table: TactileTable {
            properties: manifest.properties.to_vec(),
            readings,
        },
    })
}

fn find_columns<'a>(
    columns: &[Property],
    manifest: &'a Manifest,
) -> Result<Vec<Column<'a>>, Fault> {
    let find = |property: &'a Property| {
        let at = columns.iter().position(|column| column == property);
        let at = at.ok_or_else(|| {
            let listed: Vec<_> = columns.iter().map(Property::code).collect();
            let near = nearest(property, listed.iter().copied());
            let near = near.map_or(String::new(), |near| format!(" (is it `{near}`?)"));
            let expected =
                format!("one for `{property}`, which the dataset lists in its properties{near}");
            Fault::unexpected("the columns of the table", listed.join(", "), expected)
        })?;
        let declared = manifest.range(property);
        let nominal = match toccare::find(property) {
            Some(_) => Some(toccare::NOMINAL_RANGE),
            None => declared.map(PropertyRange::ends),
        };
        Ok(Column {
            property,
            at,
            nominal,
            declared,
            outside: OutOfRange::default(),
        })
    };
    manifest.properties.iter().map(find).collect()
}

impl Column<'_> {
    /// The value of a cell, restored where the file says so and as the policy takes it; counted where it
    /// lies out of range.
    fn take(
        &mut self,
        row: &RawRow,
        restore: Option<&[Vec<f64>; 2]>,
        policy: RangePolicy,
    ) -> Result<Option<f64>, Fault> {
        let at = self.at;
        let Some(stored) = row.values.get(at).copied().flatten() else {
            return Ok(None);
        };
        let value = restore.map_or(stored, |[mean, std]| stored * std[at] + mean[at]);
        let (property, surface) = (self.property, &row.surface);
        let refused = |[low, high]: [f64; 2], why| {
            let outside = format!("outside {low} to {high}, {why}");
            let text = format!("{property} of `{surface}` is {value}, {outside}");
            Err(Fault::invalid(text))
        };
        if !is_plausible(value) {
            return refused([-PLAUSIBLE, PLAUSIBLE], "and is to be rejected");
        }
        let mut taken = value;
        if let Some([low, high]) = self.nominal {
            if policy == RangePolicy::Reject && !(low..=high).contains(&value) {
                return refused([low, high], "and is to be rejected");
            }
            self.outside.below += usize::from(value < low);
            self.outside.above += usize::from(value > high);
            if policy == RangePolicy::Clamp {
                taken = value.clamp(low, high);
            }
        }
        match self.declared.filter(|range| !range.holds(taken)) {
            None => Ok(Some(taken)),
            Some(range) => refused(range.ends(), "the range that the dataset declares"),
        }
    }
}
