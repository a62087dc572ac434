//! Tables: one model of them, and a printer for each place where they are read.

mod cell;
mod comma_separated;
mod html;
mod latex;
mod text;

use sps_metrics::holm;

pub use cell::Cell;
pub(crate) use cell::with_interval;

/// A table, ready to print.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// Names its files.
    pub name: &'static str,
    /// Stands above it.
    pub title: String,
    /// What the reader must know to read it.
    pub caption: String,
    /// Their headings.
    pub columns: Vec<String>,
    /// From the top.
    pub rows: Vec<Row>,
}

/// A line of a [`Table`], one cell per column.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// One per column.
    pub cells: Vec<Cell>,
    /// Not measured here: printed by the paper, or a known limit.
    pub reference: bool,
    /// How it stands out among the others, in a word; empty where it does not.
    pub mark: &'static str,
}

impl Row {
    /// Of what was measured here.
    pub fn measured(cells: Vec<Cell>) -> Self {
        Self {
            cells,
            reference: false,
            mark: "",
        }
    }

    pub(crate) fn reference(cells: Vec<Cell>) -> Self {
        Self {
            reference: true,
            ..Self::measured(cells)
        }
    }

    /// What each cell says, as `italic` writes it in a row of reference.
    fn texts(
        &self,
        text: impl Fn(&Cell) -> String,
        italic: impl Fn(&str) -> String,
    ) -> Vec<String> {
        let text = |cell: &Cell| match text(cell) {
            text if self.reference && !text.is_empty() => italic(&text),
            text => text,
        };
        self.cells.iter().map(text).collect()
    }
}

impl Table {
    /// A table without a caption.
    pub fn new<C: Into<String>>(
        name: &'static str,
        title: impl Into<String>,
        columns: impl IntoIterator<Item = C>,
        rows: impl IntoIterator<Item = Row>,
    ) -> Self {
        Self {
            name,
            title: title.into(),
            caption: String::new(),
            columns: columns.into_iter().map(Into::into).collect(),
            rows: rows.into_iter().collect(),
        }
    }

    /// The same with this caption.
    #[must_use]
    pub fn about(mut self, caption: impl Into<String>) -> Self {
        self.caption = caption.into();
        self
    }

    pub(crate) fn unless_empty(self) -> Option<Self> {
        (!self.rows.is_empty()).then_some(self)
    }

    /// Calls those of its differences clear of 0 that are at this level, after Holm's correction
    /// for how many it has.
    #[must_use]
    pub fn tested(mut self, level: f64) -> Self {
        let rows = self.rows.iter_mut();
        let mut tested: Vec<&mut Cell> = rows.flat_map(|row| &mut row.cells).collect();
        tested.retain(|cell| cell.p.is_some());
        let p_values: Vec<f64> = tested.iter().filter_map(|cell| cell.p).collect();
        for (cell, p) in tested.into_iter().zip(holm(&p_values)) {
            cell.clear = p <= 1.0 - level;
        }
        self
    }

    fn column(&self, at: usize) -> impl Iterator<Item = &Cell> {
        self.rows.iter().filter_map(move |row| row.cells.get(at))
    }

    /// Whether a column is set to the left: the first, and those of words alone.
    fn is_left(&self, at: usize) -> bool {
        at == 0 || self.column(at).all(|cell| cell.is_text)
    }
}

/// Cells that break the usual forms, for the tests of the printers.
#[cfg(test)]
fn hard_cases() -> Table {
    let method = |label: &str, cells: [Cell; 2]| [vec![Cell::from(label)], cells.to_vec()].concat();
    let interval = Cell::interval(Some(-0.25), Some([-0.5, 0.75]), 2);
    let rows = [
        Row::measured(method(
            "Ridge_1 & 5 %, \"wide\"",
            [interval, Cell::number(None, 2)],
        )),
        Row::measured(method(
            "[a] | b",
            [Cell::interval(None, None, 2), Cell::number(Some(0.5), 1)],
        )),
        Row::reference(method(
            "Ceiling",
            [Cell::number(Some(1.0 / 3.0), 2), Cell::from("")],
        )),
    ];
    Table::new(
        "hard-cases",
        "50 % of R² & more",
        ["Method", "R²", "paper"],
        rows,
    )
    .about("See `a_b`.")
}
