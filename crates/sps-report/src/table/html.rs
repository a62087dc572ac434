//! Tables as the template of the page takes them, which writes the tags.

use serde_json::{Value, json};

use super::cell::Side;
use super::{Cell, Row, Table};

impl Table {
    /// Without title and caption. Columns are sorted by the `rank` of their cells; words by themselves.
    pub(crate) fn html(&self) -> Value {
        let columns = self.columns.iter().enumerate();
        let columns =
            columns.map(|(at, title)| json!({ "title": title, "left": self.is_left(at) }));
        let cell = |cell: &Cell| {
            let sign = cell.side().map(Side::sign);
            let class = cell.side().map(|side| match side {
                Side::Above => "above",
                Side::Below => "below",
            });
            json!({
                "value": cell.text, "ends": cell.beside, "rank": cell.rank(), "sign": sign, "class": class,
            })
        };
        let row = |row: &Row| {
            let cells: Vec<Value> = row.cells.iter().map(cell).collect();
            json!({ "reference": row.reference, "mark": row.mark, "cells": cells })
        };
        json!({
            "columns": columns.collect::<Vec<_>>(),
            "rows": self.rows.iter().map(row).collect::<Vec<_>>(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::hard_cases;
    use super::*;

    #[test]
    fn a_cell_has_its_interval_apart_and_a_number_to_sort_by() {
        let table = Table {
            rows: vec![Row::measured(vec![
                "a".into(),
                Cell::gain(-0.25, [-0.5, -0.25], 0.01, 2),
                Cell::range(Some([1.0, 2.0]), 0),
            ])],
            ..hard_cases()
        };
        let html = table.tested(0.95).html();
        let columns = html["columns"].as_array().unwrap().iter();
        let left: Vec<bool> = columns.map(|c| c["left"] == true).collect();
        assert_eq!(left, [true, false, false]);
        let cells = &html["rows"][0]["cells"];
        assert_eq!(cells[0]["rank"], Value::Null);
        let shown = ["value", "ends", "sign", "class"].map(|key| cells[1][key].as_str().unwrap());
        assert_eq!(shown, ["-0.25", "[-0.50, -0.25]", "▼", "below"]);
        assert_eq!(
            (&cells[1]["rank"], &cells[2]["rank"]),
            (&(-0.25).into(), &1.0.into())
        );
    }
}
