//! Tables as CSV, with numbers as they were measured.

use anyhow::Result;

use super::{Cell, Table};

impl Table {
    /// A line for each row. An interval has columns of its own, a value that could not be computed
    /// an empty cell.
    pub(crate) fn csv(&self) -> Result<Vec<u8>> {
        let mut columns: Vec<Vec<String>> = Vec::new();
        for at in 0..self.columns.len() {
            let title = self.own_title(at);
            let mut column = |title: String, field: &dyn Fn(&Cell) -> Option<String>| {
                let fields = self.column(at).map(|cell| field(cell).unwrap_or_default());
                columns.push([title].into_iter().chain(fields).collect());
            };
            let has_ends = self.column(at).any(|cell| cell.ends().is_some());
            if !has_ends || self.column(at).any(|cell| cell.value().is_some()) {
                column(title.clone(), &Cell::value);
            }
            if has_ends {
                for (end, name) in ["low", "high"].into_iter().enumerate() {
                    let field = |cell: &Cell| Some(cell.ends()?[end].clone());
                    column(format!("{title}, {name}"), &field);
                }
            }
        }
        let mut writer = csv::Writer::from_writer(Vec::new());
        for line in 0..=self.rows.len() {
            writer.write_record(columns.iter().map(|column| &column[line]))?;
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
