use std::path::Path;

use super::csv_lines::{Line, check_cells, csv_lines};
use super::rows::{RawRow, RawTable};
use super::{LongCsv, no_such_column, property_of_column};
use crate::{DatasetError, Place, Property};

/// Which column is what.
struct Columns {
    surface: usize,
    location: usize,
    repeat: usize,
    properties: Vec<(usize, Property)>,
    count: usize,
}

pub(super) fn read(path: &Path, bytes: &[u8], format: &LongCsv) -> Result<RawTable, DatasetError> {
    let lines = csv_lines(path, bytes)?;
    let Some((header, lines)) = lines.split_first() else {
        return Err(no_such_column(path, 1, "surface", ""));
    };
    let columns = Columns::find(path, header, format)?;
    let rows = lines
        .iter()
        .map(|line| columns.row(path, line))
        .collect::<Result<_, _>>()?;
    let properties = columns.properties.into_iter();
    Ok(RawTable {
        columns: properties.map(|(_, property)| property).collect(),
        rows,
        restore: None,
    })
}

impl Columns {
    fn find(path: &Path, header: &Line, format: &LongCsv) -> Result<Self, DatasetError> {
        let named = |name: &str| {
            let found = header.cells.iter().position(|cell| cell == name);
            found.ok_or_else(|| {
                let listed: Vec<_> = header.cells.iter().collect();
                no_such_column(path, header.number, name, &listed.join(","))
            })
        };
        let (surface, location, repeat) = (named("surface")?, named("location")?, named("repeat")?);
        let mut properties = Vec::new();
        for (column, name) in header.cells.iter().enumerate() {
            let ignored = format.ignore_columns.iter().any(|ignored| ignored == name);
            if [surface, location, repeat].contains(&column) || ignored {
                continue;
            }
            let listed = properties.iter().map(|(_, property)| property);
            let property = property_of_column(path, header.number, name, listed)?;
            properties.push((column, property));
        }
        Ok(Self {
            surface,
            location,
            repeat,
            properties,
            count: header.cells.len(),
        })
    }

    fn row(&self, path: &Path, line: &Line) -> Result<RawRow, DatasetError> {
        check_cells(path, line, self.count)?;
        let index = |column: usize, name: &str| {
            let expected = "a whole number from 0 to 4294967295";
            let number = line.cell(column).parse::<u32>();
            number.map_err(|_| line.not_a_number(path, column, name, expected))
        };
        let values = self.properties.iter();
        let values = values.map(|(column, property)| line.measured(path, *column, property));
        Ok(RawRow {
            place: Place::Line(line.number),
            surface: line.cell(self.surface).to_owned(),
            location: index(self.location, "location")?,
            repeat: index(self.repeat, "repeat")?,
            values: values.collect::<Result<_, _>>()?,
        })
    }
}
