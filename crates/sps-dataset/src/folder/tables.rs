use std::{io, iter};

use super::surfaces::HEADER;
use crate::property::RESERVED;
use crate::{Property, Source, Surface};

/// `surfaces.csv` of a dataset.
pub(super) fn surfaces_csv(surfaces: &[Surface]) -> io::Result<Vec<u8>> {
    let rows = surfaces.iter();
    let rows = rows.map(|surface| [&*surface.id, &surface.material, &surface.group]);
    csv(iter::once(HEADER).chain(rows))
}

/// `tactile.csv` of a dataset, in the long form. Numbers read back as they were.
pub(super) fn tactile_csv(source: &dyn Source) -> io::Result<Vec<u8>> {
    let table = source.tactile();
    let codes = table.properties.iter().map(Property::code);
    let header = RESERVED.into_iter().chain(codes).map(str::to_owned);
    let rows = table.readings.iter().map(|reading| {
        let surface = source.surfaces().get(reading.surface);
        let id = surface.map_or("", |surface| &surface.id).to_owned();
        let mut row = vec![id, reading.location.to_string(), reading.repeat.to_string()];
        let number = |value: &Option<f64>| value.map(|value| value.to_string()).unwrap_or_default();
        row.extend(reading.values.iter().map(number));
        row
    });
    csv(iter::once(header.collect()).chain(rows))
}

fn csv(rows: impl Iterator<Item: IntoIterator<Item: AsRef<[u8]>>>) -> io::Result<Vec<u8>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for row in rows {
        writer.write_record(row)?;
    }
    writer.into_inner().map_err(csv::IntoInnerError::into_error)
}
