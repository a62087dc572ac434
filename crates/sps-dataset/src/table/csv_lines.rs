use csv::{ReaderBuilder, StringRecord, Trim};

use super::property_of_column;
use crate::Property;
use crate::error::{Fault, Place};
use crate::files::text;
use crate::tactile::is_plausible;

/// One line of a CSV file, its cells trimmed.
pub(crate) struct Line {
    number: u64,
    pub(crate) cells: StringRecord,
}

/// Which columns of a table are properties.
pub(super) type Columns = Vec<(usize, Property)>;

/// Every line that is not blank: the first, without cells where there is none, and those below it.
pub(crate) fn csv_lines(bytes: &[u8]) -> Result<(Line, Vec<Line>), Fault> {
    let text = text("CSV", bytes)?;
    let mut reader = ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .trim(Trim::All)
        .from_reader(text.as_bytes());
    let mut lines = Vec::new();
    for record in reader.records() {
        let cells = record.map_err(|error| Fault::malformed("CSV", error))?;
        let position = cells.position();
        let number = position.map_or(1, |position| line_number(text, position));
        if cells.iter().any(|cell| !cell.is_empty()) {
            lines.push(Line { number, cells });
        }
    }
    let below = lines.split_off(lines.len().min(1));
    let nothing = Line {
        number: 1,
        cells: StringRecord::new(),
    };
    Ok((lines.pop().unwrap_or(nothing), below))
}

/// The line of a record; its own position is where the blank lines before it begin.
fn line_number(text: &str, position: &csv::Position) -> u64 {
    let from = text.as_bytes().iter().skip(position.byte() as usize);
    let blank = from.take_while(|byte| matches!(byte, b'\r' | b'\n'));
    position.line() + blank.filter(|&&byte| byte == b'\n').count() as u64
}

impl Line {
    pub(crate) fn place(&self) -> Place {
        Place::Line(self.number)
    }

    pub(crate) fn cell(&self, column: usize) -> &str {
        self.cells.get(column).unwrap_or_default()
    }

    /// Its cells, for messages.
    pub(crate) fn shown(&self) -> String {
        self.cells.iter().collect::<Vec<_>>().join(",")
    }

    /// What was expected of this header.
    pub(crate) fn unexpected_header(&self, found: &str, expected: &str) -> Fault {
        let found = if found.is_empty() { "nothing" } else { found };
        Fault::unexpected("the header", found, expected).at(self.place())
    }

    /// The column of that name in this header.
    pub(super) fn column(&self, name: &str) -> Result<usize, Fault> {
        let column = self.cells.iter().position(|cell| cell == name);
        column.ok_or_else(|| self.no_column(name))
    }

    pub(super) fn no_column(&self, name: &str) -> Fault {
        let shown = self.shown();
        let found = if shown.is_empty() {
            shown
        } else {
            format!("`{shown}`")
        };
        self.unexpected_header(&found, &format!("a column `{name}`"))
    }

    /// The properties that this header names. Leaves out the columns `others` and the names in
    /// `ignored`.
    pub(super) fn properties(
        &self,
        others: &[usize],
        ignored: &[String],
    ) -> Result<Columns, Fault> {
        let mut columns = Columns::new();
        for (column, name) in self.cells.iter().enumerate() {
            if others.contains(&column) || ignored.iter().any(|ignored| ignored == name) {
                continue;
            }
            let property = property_of_column(name).map_err(|fault| fault.at(self.place()))?;
            if columns.iter().any(|(_, listed)| *listed == property) {
                return Err(self.unexpected_header(&format!("`{name}` twice"), "it once"));
            }
            columns.push((column, property));
        }
        Ok(columns)
    }

    /// Refuses a line that has more or fewer cells than the first one.
    pub(crate) fn check_cells(&self, expected: usize) -> Result<(), Fault> {
        let found = self.cells.len();
        if found == expected {
            return Ok(());
        }
        Err(Fault::unexpected("the cells of the line", found, expected).at(self.place()))
    }

    /// What was measured of each property: no value where a cell is empty or NaN.
    pub(super) fn measured(&self, columns: &Columns) -> Result<Vec<Option<f64>>, Fault> {
        let value = |(column, property): &(usize, Property)| {
            let cell = self.cell(*column);
            if cell.is_empty() || cell.eq_ignore_ascii_case("nan") {
                return Ok(None);
            }
            let value = cell.parse().ok().filter(|&value| is_plausible(value));
            let expected = "a number within 1e9 of 0, or nothing";
            value
                .map(Some)
                .ok_or_else(|| self.not_a_number(*column, property, expected))
        };
        columns.iter().map(value).collect()
    }

    pub(super) fn not_a_number(&self, column: usize, name: &str, expected: &str) -> Fault {
        Fault::not_a_number(name, self.cell(column), expected).at(self.place())
    }
}
