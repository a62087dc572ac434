use std::path::Path;

use csv::{ReaderBuilder, StringRecord, Trim};

use crate::files::text;
use crate::tactile::is_plausible;
use crate::{DatasetError, DatasetErrorKind, Property};

/// One line of a CSV file, its cells trimmed.
pub(crate) struct Line {
    pub(crate) number: u64,
    pub(crate) cells: StringRecord,
}

/// Every line that is not blank.
pub(crate) fn csv_lines(path: &Path, bytes: &[u8]) -> Result<Vec<Line>, DatasetError> {
    let text = text(path, "CSV", bytes)?;
    let mut reader = ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .trim(Trim::All)
        .from_reader(text.as_bytes());
    let mut lines = Vec::new();
    for record in reader.records() {
        let cells = record.map_err(|error| {
            let line = error.position().map_or(1, csv::Position::line);
            let kind = DatasetErrorKind::Malformed {
                format: "CSV",
                reason: error.to_string(),
            };
            DatasetError::line(path, line, kind)
        })?;
        let number = cells
            .position()
            .map_or(1, |position| line_number(text, position));
        if cells.iter().any(|cell| !cell.is_empty()) {
            lines.push(Line { number, cells });
        }
    }
    Ok(lines)
}

/// The line of a record; its own position is where the blank lines before it begin.
fn line_number(text: &str, position: &csv::Position) -> u64 {
    let from = text.as_bytes().iter().skip(position.byte() as usize);
    let blank = from.take_while(|byte| matches!(byte, b'\r' | b'\n'));
    position.line() + blank.filter(|&&byte| byte == b'\n').count() as u64
}

/// Refuses a line that has more or fewer cells than the first one.
pub(crate) fn check_cells(path: &Path, line: &Line, expected: usize) -> Result<(), DatasetError> {
    if line.cells.len() == expected {
        return Ok(());
    }
    let found = line.cells.len().to_string();
    let kind = DatasetErrorKind::unexpected("the cells of the line", found, expected.to_string());
    Err(DatasetError::line(path, line.number, kind))
}

impl Line {
    pub(crate) fn cell(&self, column: usize) -> &str {
        self.cells.get(column).unwrap_or_default()
    }

    /// A cell with a measured value, or empty or NaN where nothing was measured.
    pub(crate) fn measured(
        &self,
        path: &Path,
        column: usize,
        property: &Property,
    ) -> Result<Option<f64>, DatasetError> {
        let cell = self.cell(column);
        if cell.is_empty() || cell.eq_ignore_ascii_case("nan") {
            return Ok(None);
        }
        let value = cell
            .parse::<f64>()
            .ok()
            .filter(|&value| is_plausible(value));
        let expected = "a number within 1e9 of 0, or nothing";
        value
            .map(Some)
            .ok_or_else(|| self.not_a_number(path, column, property.code(), expected))
    }

    pub(crate) fn not_a_number(
        &self,
        path: &Path,
        column: usize,
        name: &str,
        expected: &'static str,
    ) -> DatasetError {
        let kind = DatasetErrorKind::not_a_number(name, self.cell(column), expected);
        DatasetError::line(path, self.number, kind)
    }
}
