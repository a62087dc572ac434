//! Tables of a report, ready to print.

use serde::Serialize;

/// A table of text cells.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Table {
    pub title: String,
    /// What the reader must know to read it.
    pub caption: String,
    pub columns: Vec<String>,
    pub rows: Vec<Row>,
}

/// A line of a [`Table`], one cell per column.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Row {
    pub cells: Vec<String>,
    /// Not measured here: printed by the paper, or a known limit.
    pub reference: bool,
}

impl Row {
    pub(crate) fn measured(cells: Vec<String>) -> Self {
        Self {
            cells,
            reference: false,
        }
    }

    pub(crate) fn reference(cells: Vec<String>) -> Self {
        Self {
            cells,
            reference: true,
        }
    }
}

/// What stands where a value could not be computed.
const MISSING: &str = "–";

/// A number with so many decimals.
pub(crate) fn number(value: Option<f64>, decimals: usize) -> String {
    match value {
        Some(value) => {
            let text = format!("{value:.decimals$}");
            match text.strip_prefix('-') {
                Some(zero) if zero.chars().all(|c| matches!(c, '0' | '.')) => zero.to_owned(),
                _ => text,
            }
        }
        None => MISSING.to_owned(),
    }
}

/// So many of what `noun` names in the singular.
pub(crate) fn counted(count: usize, noun: &str) -> String {
    let plural = if count == 1 { "" } else { "s" };
    format!("{count} {noun}{plural}")
}

/// A number with its interval.
pub(crate) fn with_interval(
    value: Option<f64>,
    interval: Option<[f64; 2]>,
    decimals: usize,
) -> String {
    let value = number(value, decimals);
    match interval {
        Some([low, high]) => format!(
            "{value} [{}, {}]",
            number(Some(low), decimals),
            number(Some(high), decimals)
        ),
        None => value,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_rounded_and_zero_has_no_sign() {
        assert_eq!(number(Some(0.456), 2), "0.46");
        assert_eq!(number(Some(-0.004), 2), "0.00");
        assert_eq!(number(Some(-0.006), 2), "-0.01");
        assert_eq!(number(None, 2), "–");
        assert_eq!(
            with_interval(Some(0.5), Some([0.25, 0.75]), 2),
            "0.50 [0.25, 0.75]"
        );
    }
}
