//! Tables that people hand in as text: cells between commas, in lines that errors can name.

use std::fs;
use std::io;
use std::path::Path;

/// A row of cells, trimmed, and the line that it begins in.
pub type Row = (u64, csv::StringRecord);

/// A file's text without the mark that some editors begin it with.
///
/// # Errors
/// A file that cannot be read, or is no UTF-8.
pub fn text(path: &Path) -> io::Result<String> {
    let text = fs::read_to_string(path)?;
    Ok(text.trim_start_matches('\u{feff}').to_owned())
}

/// The rows of a text. Spreadsheets write empty rows as commas: these are left out.
///
/// # Errors
/// A quote that is not closed.
pub fn rows(text: &str) -> csv::Result<Vec<Row>> {
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .trim(csv::Trim::All)
        .from_reader(text.as_bytes());
    let mut rows = Vec::new();
    for row in reader.records() {
        let row = row?;
        if row.iter().any(|cell| !cell.is_empty()) {
            let line = row.position().map_or(1, |position| line(text, position));
            rows.push((line, row));
        }
    }
    Ok(rows)
}

/// The line of a row, whose own position is where the blank lines before it begin.
fn line(text: &str, position: &csv::Position) -> u64 {
    let from = text.as_bytes().iter().skip(position.byte() as usize);
    let blank = from.take_while(|byte| matches!(byte, b'\r' | b'\n'));
    position.line() + blank.filter(|&&byte| byte == b'\n').count() as u64
}

/// The number in a cell. More than 1e9 from 0, as in the table of a dataset, is a mistake: sums and
/// squares of what is within cannot overflow.
pub fn number(cell: &str) -> Option<f64> {
    cell.parse().ok().filter(|value: &f64| value.abs() <= 1e9)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_know_their_lines() {
        let text = "a,b\r\n\r\n\n 1 , 2\n,\n\"x\ny\",3\n4\n";
        let rows = rows(text).unwrap();
        let lines: Vec<u64> = rows.iter().map(|(line, _)| *line).collect();
        assert_eq!(lines, [1, 4, 6, 8]);
        assert_eq!(rows[1].1, vec!["1", "2"]);
    }

    #[test]
    fn a_number_is_plain_and_comes_back_to_the_bit() {
        let third = 1.0 / 3.0;
        assert_eq!(number(&third.to_string()), Some(third));
        for cell in ["", "x", "NaN", "inf", "-infinity", "1e10", "1,5"] {
            assert_eq!(number(cell), None, "{cell}");
        }
    }
}
