use std::path::Path;

use super::csv_lines::{Line, check_cells, csv_lines};
use super::keyed::KeyedTable;
use super::rows::RawTable;
use super::{Header, WideCsv, no_such_column, property_of_column};
use crate::{DatasetError, DatasetErrorKind, Place, Property};

pub(super) fn read(path: &Path, bytes: &[u8], format: &WideCsv) -> Result<RawTable, DatasetError> {
    let lines = csv_lines(path, bytes)?;
    let (columns, count, lines) = columns(path, &lines, format)?;
    let mut table = KeyedTable::new(path, &format.statistics);
    for line in lines {
        check_cells(path, line, count)?;
        let values = columns
            .iter()
            .map(|(column, property)| line.measured(path, *column, property));
        let values = values.collect::<Result<_, _>>()?;
        table.push(Place::Line(line.number), line.cell(0), vec![(0, 0, values)])?;
    }
    table.finish(columns.into_iter().map(|(_, property)| property).collect())
}

/// Which column is which property, how many columns there are, and the lines below the header.
type Columns<'a> = (Vec<(usize, Property)>, usize, &'a [Line]);

fn columns<'a>(
    path: &Path,
    lines: &'a [Line],
    format: &WideCsv,
) -> Result<Columns<'a>, DatasetError> {
    let (first, rest) = lines
        .split_first()
        .map_or((None, lines), |(a, b)| (Some(a), b));
    let ordered = || {
        let order = format.property_order.as_ref();
        let order =
            order.ok_or_else(|| DatasetError::file(path, DatasetErrorKind::no_property_order()))?;
        Ok((1..).zip(order.iter().cloned()).collect::<Vec<_>>())
    };
    match format.header {
        Header::Properties => {
            let first = first.ok_or_else(|| no_such_column(path, 1, "surface", ""))?;
            Ok((named(path, first, format)?, first.cells.len(), rest))
        }
        Header::Ignored => ordered().map(|columns| (columns.clone(), columns.len() + 1, rest)),
        Header::Absent => ordered().map(|columns| (columns.clone(), columns.len() + 1, lines)),
    }
}

fn named(
    path: &Path,
    header: &Line,
    format: &WideCsv,
) -> Result<Vec<(usize, Property)>, DatasetError> {
    if header.cell(0) != "surface" {
        let found = header.cells.iter().collect::<Vec<_>>().join(",");
        return Err(no_such_column(path, header.number, "surface", &found));
    }
    let mut columns = Vec::new();
    for (column, name) in header.cells.iter().enumerate().skip(1) {
        if format.ignore_columns.iter().any(|ignored| ignored == name) {
            continue;
        }
        let listed = columns.iter().map(|(_, property)| property);
        let property = property_of_column(path, header.number, name, listed)?;
        columns.push((column, property));
    }
    let found = columns.iter().map(|(_, property)| property);
    match &format.property_order {
        Some(order) if !found.clone().eq(order.iter()) => {
            let expected = format!("{}, as `property-order` says", codes(order.iter()));
            let kind = DatasetErrorKind::unexpected("the header", codes(found), expected);
            Err(DatasetError::line(path, header.number, kind))
        }
        _ => Ok(columns),
    }
}

fn codes<'a>(properties: impl Iterator<Item = &'a Property>) -> String {
    properties.map(Property::code).collect::<Vec<_>>().join(",")
}
