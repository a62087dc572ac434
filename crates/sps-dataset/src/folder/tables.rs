use std::io;

use super::surfaces::HEADER;
use crate::{Source, Surface};

/// `surfaces.csv` of a dataset.
pub(super) fn surfaces_csv(surfaces: &[Surface]) -> io::Result<Vec<u8>> {
    let row =
        |surface: &Surface| [&surface.id, &surface.material, &surface.group].map(Clone::clone);
    let header = HEADER.map(str::to_owned);
    csv([header].into_iter().chain(surfaces.iter().map(row)))
}

/// `tactile.csv` of a dataset, in the long form. Numbers read back as they were.
pub(super) fn tactile_csv(source: &dyn Source) -> io::Result<Vec<u8>> {
    let table = source.tactile();
    let header = ["surface", "location", "repeat"].map(str::to_owned);
    let codes = table.properties.iter().map(ToString::to_string);
    let rows = table.readings.iter().map(|reading| {
        let surface = source.surfaces().get(reading.surface);
        let id = surface.map_or("", |surface| &surface.id).to_owned();
        let mut row = vec![id, reading.location.to_string(), reading.repeat.to_string()];
        let number = |value: &Option<f64>| value.map(|value| value.to_string()).unwrap_or_default();
        row.extend(reading.values.iter().map(number));
        row
    });
    csv([header.into_iter().chain(codes).collect()]
        .into_iter()
        .chain(rows))
}

fn csv(rows: impl Iterator<Item: AsRef<[String]>>) -> io::Result<Vec<u8>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for row in rows {
        writer.write_record(row.as_ref())?;
    }
    let written = writer.into_inner();
    written.map_err(|error| io::Error::other(error.to_string()))
}
