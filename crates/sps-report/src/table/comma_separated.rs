//! Tables as CSV, with numbers as they were measured.

use anyhow::Result;

use super::{Cell, Table};

impl Table {
    /// A line for each row. An interval has columns of its own, a value that could not be computed
    /// an empty cell.
    pub(crate) fn csv(&self) -> Result<Vec<u8>> {
        let mut writer = csv::Writer::from_writer(Vec::new());
        let columns: Vec<Column> = (0..self.columns.len())
            .map(|at| Column::of(self, at))
            .collect();
        writer.write_record(columns.iter().flat_map(Column::titles))?;
        for row in &self.rows {
            let cells = columns.iter().zip(&row.cells);
            writer.write_record(cells.flat_map(|(column, cell)| column.fields(cell)))?;
        }
        Ok(writer.into_inner()?)
    }

    /// A title that no other column has: where several do, with that of the column before it.
    fn own_title(&self, at: usize) -> String {
        let title = &self.columns[at];
        let before = at.checked_sub(1).and_then(|at| self.columns.get(at));
        let alike = self.columns.iter().filter(|other| *other == title).count();
        match before {
            Some(before) if alike > 1 => format!("{before}, {title}"),
            _ => title.clone(),
        }
    }
}

/// The columns that one of the table becomes.
struct Column {
    title: String,
    has_value: bool,
    has_ends: bool,
}

impl Column {
    fn of(table: &Table, at: usize) -> Self {
        let has_ends = table.column(at).any(|cell| cell.ends().is_some());
        Self {
            title: table.own_title(at),
            has_value: !has_ends || table.column(at).any(|cell| cell.value().is_some()),
            has_ends,
        }
    }

    fn titles(&self) -> Vec<String> {
        let ends = ["low", "high"].map(|end| format!("{}, {end}", self.title));
        self.all(self.title.clone(), ends)
    }

    fn fields(&self, cell: &Cell) -> Vec<String> {
        self.all(
            cell.value().unwrap_or_default(),
            cell.ends().unwrap_or_default(),
        )
    }

    fn all(&self, value: String, ends: [String; 2]) -> Vec<String> {
        let value = self.has_value.then_some(value);
        let ends = self.has_ends.then_some(ends);
        value
            .into_iter()
            .chain(ends.into_iter().flatten())
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Row, hard_cases};
    use super::*;

    #[test]
    fn numbers_are_whole_and_what_is_missing_is_empty() {
        let text = String::from_utf8(hard_cases().csv().unwrap()).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(
            lines,
            [
                "Method,R²,\"R², low\",\"R², high\",paper",
                "\"Ridge_1 & 5 %, \"\"wide\"\"\",-0.25,-0.5,0.75,",
                "[a] | b,,,,0.5",
                "Ceiling,0.3333333333333333,,,",
            ]
        );
    }

    #[test]
    fn titles_differ_and_a_range_has_no_value() {
        let table = Table {
            columns: ["Method", "R²", "paper", "over reruns", "paper"]
                .map(str::to_owned)
                .to_vec(),
            rows: vec![Row::measured(vec![
                "a".into(),
                Cell::number(Some(0.5), 1),
                Cell::number(Some(0.25), 1),
                Cell::range(Some([1.0, 2.0]), 1),
                Cell::number(None, 1),
            ])],
            ..hard_cases()
        };
        let text = String::from_utf8(table.csv().unwrap()).unwrap();
        assert_eq!(
            text,
            "Method,R²,\"R², paper\",\"over reruns, low\",\"over reruns, high\",\"over reruns, \
             paper\"\na,0.5,0.25,1,2,\n"
        );
    }
}
