use super::csv_lines::{Columns, Line, csv_lines};
use super::keyed::KeyedTable;
use super::rows::RawTable;
use super::{Header, WideCsv};
use crate::Property;
use crate::error::Fault;

pub(super) fn read(bytes: &[u8], format: &WideCsv) -> Result<RawTable, Fault> {
    let (first, below) = csv_lines(bytes)?;
    let (columns, count) = match (format.header, &format.property_order) {
        (Header::Properties, _) => (named(&first, format)?, first.cells.len()),
        (_, Some(order)) => ((1..).zip(order.iter().cloned()).collect(), order.len() + 1),
        (_, None) => return Err(Fault::no_property_order()),
    };
    // A file without any line has no surface either.
    let is_surface = format.header == Header::Absent && !first.cells.is_empty();
    let first = is_surface.then_some(&first);
    let mut table = KeyedTable::new(&format.statistics);
    for line in first.into_iter().chain(&below) {
        line.check_cells(count)?;
        let values = line.measured(&columns)?;
        table.push(line.place(), line.cell(0), vec![(0, 0, values)])?;
    }
    table.finish(columns.into_iter().map(|(_, property)| property).collect())
}

fn named(header: &Line, format: &WideCsv) -> Result<Columns, Fault> {
    if header.cell(0) != "surface" {
        return Err(header.no_column("surface"));
    }
    let columns = header.properties(&[0], &format.ignore_columns)?;
    let found = columns.iter().map(|(_, property)| property);
    match &format.property_order {
        Some(order) if !found.clone().eq(order.iter()) => {
            let expected = format!("{}, as `property-order` says", codes(order.iter()));
            Err(header.unexpected_header(&codes(found), &expected))
        }
        _ => Ok(columns),
    }
}

fn codes<'a>(properties: impl Iterator<Item = &'a Property>) -> String {
    properties.map(Property::code).collect::<Vec<_>>().join(",")
}
