use super::LongCsv;
use super::csv_lines::csv_lines;
use super::rows::{RawRow, RawTable};
use crate::error::Fault;

pub(super) fn read(bytes: &[u8], format: &LongCsv) -> Result<RawTable, Fault> {
    let (header, lines) = csv_lines(bytes)?;
    let surface = header.column("surface")?;
    let (location, repeat) = (header.column("location")?, header.column("repeat")?);
    let columns = header.properties(&[surface, location, repeat], &format.ignore_columns)?;
    let rows = lines.iter().map(|line| {
        line.check_cells(header.cells.len())?;
        let index = |column: usize, name: &str| {
            let expected = "a whole number from 0 to 4294967295";
            let number = line.cell(column).parse();
            number.map_err(|_| line.not_a_number(column, name, expected))
        };
        Ok(RawRow {
            place: line.place(),
            surface: line.cell(surface).to_owned(),
            location: index(location, "location")?,
            repeat: index(repeat, "repeat")?,
            values: line.measured(&columns)?,
        })
    });
    Ok(RawTable {
        rows: rows.collect::<Result<_, Fault>>()?,
        columns: columns.into_iter().map(|(_, property)| property).collect(),
        restore: None,
    })
}
