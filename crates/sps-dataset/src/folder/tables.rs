use crate::{Source, Surface};

/// `surfaces.csv` of a dataset.
pub(super) fn surfaces_csv(surfaces: &[Surface]) -> Result<String, String> {
    let header = ["surface", "material", "group"].map(str::to_owned).to_vec();
    let rows = surfaces.iter().map(
        |Surface {
             id,
             material,
             group,
         }| { vec![id.clone(), material.clone(), group.clone()] },
    );
    csv(std::iter::once(header).chain(rows))
}

/// `tactile.csv` of a dataset, in the long form. Numbers read back as they were.
pub(super) fn tactile_csv(source: &dyn Source) -> Result<String, String> {
    let table = source.tactile();
    let mut header = ["surface", "location", "repeat"]
        .map(str::to_owned)
        .to_vec();
    header.extend(table.properties.iter().map(ToString::to_string));
    let rows = table.readings.iter().map(|reading| {
        let surface = source.surfaces().get(reading.surface);
        let id = surface
            .map(|surface| surface.id.clone())
            .unwrap_or_default();
        let mut row = vec![id, reading.location.to_string(), reading.repeat.to_string()];
        let number = |value: &Option<f64>| value.map(|value| value.to_string()).unwrap_or_default();
        row.extend(reading.values.iter().map(number));
        row
    });
    csv(std::iter::once(header).chain(rows))
}

fn csv(rows: impl Iterator<Item = Vec<String>>) -> Result<String, String> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for row in rows {
        writer
            .write_record(&row)
            .map_err(|error| error.to_string())?;
    }
    let bytes = writer.into_inner().map_err(|error| error.to_string())?;
    String::from_utf8(bytes).map_err(|error| error.to_string())
}
