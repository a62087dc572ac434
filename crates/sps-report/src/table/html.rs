//! Tables as the template of the page takes them, which writes the tags.

use serde::Serialize;

use super::cell::Side;
use super::{Cell, Row, Table};

/// A [`Table`] without title and caption.
#[derive(Serialize)]
pub(crate) struct Html {
    columns: Vec<Column>,
    rows: Vec<Line>,
}

#[derive(Serialize)]
struct Column {
    title: String,
    /// Set to the left.
    left: bool,
}

#[derive(Serialize)]
struct Line {
    reference: bool,
    mark: &'static str,
    cells: Vec<Shown>,
}

#[derive(Serialize)]
struct Shown {
    value: String,
    ends: Option<String>,
    /// What the column is sorted by; words are sorted by themselves.
    rank: Option<f64>,
    /// The sign of a difference that is clear of 0, for the eye and as a class of the style sheet.
    sign: Option<&'static str>,
    class: Option<&'static str>,
}

impl Table {
    pub(crate) fn html(&self) -> Html {
        let columns = self.columns.iter().enumerate().map(|(at, title)| Column {
            title: title.clone(),
            left: self.is_left(at),
        });
        Html {
            columns: columns.collect(),
            rows: self.rows.iter().map(Line::of).collect(),
        }
    }
}

impl Line {
    fn of(row: &Row) -> Self {
        Self {
            reference: row.reference,
            mark: row.mark,
            cells: row.cells.iter().map(Shown::of).collect(),
        }
    }
}

impl Shown {
    fn of(cell: &Cell) -> Self {
        let (value, ends) = cell.parts();
        let class = |side| match side {
            Side::Above => "above",
            Side::Below => "below",
        };
        Self {
            value,
            ends,
            rank: cell.rank(),
            sign: cell.side().map(Side::sign),
            class: cell.side().map(class),
        }
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
        let table = table.tested(0.95);
        let html = serde_json::to_value(table.html()).unwrap();
        let columns = html["columns"].as_array().unwrap().iter();
        let left: Vec<bool> = columns.map(|c| c["left"] == true).collect();
        assert_eq!(left, [true, false, false]);
        let cells = &html["rows"][0]["cells"];
        assert_eq!(cells[0]["rank"], serde_json::Value::Null);
        let shown = ["value", "ends", "sign", "class"].map(|key| cells[1][key].as_str().unwrap());
        assert_eq!(shown, ["-0.25", "[-0.50, -0.25]", "▼", "below"]);
        assert_eq!(
            (&cells[1]["rank"], &cells[2]["rank"]),
            (&(-0.25).into(), &1.0.into())
        );
    }
}
