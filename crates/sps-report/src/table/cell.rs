//! What stands in a cell: words, or numbers as they were measured and as they are shown.

use std::fmt;

use sps_experiment::text::number;

/// A cell of a table. It is shown rounded; CSV has its numbers as they were measured.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cell {
    /// What is read first.
    pub(super) text: String,
    /// What the value lies between, as it is read.
    pub(super) beside: Option<String>,
    /// Whether it is words, and never had numbers.
    pub(super) is_text: bool,
    value: Option<f64>,
    ends: Option<[f64; 2]>,
    /// Of a difference, how often chance alone makes one as large.
    pub(super) p: Option<f64>,
    /// Whether it is clear of 0 among all differences of its table.
    pub(super) clear: bool,
}

/// On which side of 0 a difference lies that is clear of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Side {
    Above,
    Below,
}

impl Side {
    /// For the eye.
    pub(super) const fn sign(self) -> &'static str {
        match self {
            Self::Above => "▲",
            Self::Below => "▼",
        }
    }
}

impl Cell {
    /// A number with so many decimals.
    pub fn number(value: Option<f64>, decimals: usize) -> Self {
        Self::interval(value, None, decimals)
    }

    /// `0.50`, or `0.50 [0.25, 0.75]` where it has an interval.
    pub(crate) fn interval(value: Option<f64>, ends: Option<[f64; 2]>, decimals: usize) -> Self {
        let beside = ends.map(|ends| format!("[{}]", joined(ends, ", ", decimals)));
        Self::of(number(value, decimals), beside, value, ends)
    }

    /// How much one number is more than another: `+0.50`, or `+0.50 [0.25, 0.75]`.
    pub fn difference(value: Option<f64>, ends: Option<[f64; 2]>, decimals: usize) -> Self {
        let mut cell = Self::interval(value, ends, decimals);
        if value.is_some() && !cell.text.starts_with('-') {
            cell.text.insert(0, '+');
        }
        cell
    }

    /// The same with its p-value, for [`Table::tested`](super::Table::tested).
    pub(crate) fn gain(value: f64, ends: [f64; 2], p: f64, decimals: usize) -> Self {
        Self {
            p: Some(p),
            ..Self::difference(Some(value), Some(ends), decimals)
        }
    }

    /// A mean with the lowest and the highest that it is made of: `0.50 (0.25 to 0.75)`.
    pub(crate) fn spread(value: Option<f64>, ends: Option<[f64; 2]>, decimals: usize) -> Self {
        let beside = ends.map(|ends| format!("({})", joined(ends, " to ", decimals)));
        Self::of(number(value, decimals), beside, value, ends)
    }

    /// The lowest and the highest alone: `0.25 to 0.75`.
    pub(crate) fn range(ends: Option<[f64; 2]>, decimals: usize) -> Self {
        let text = ends.map(|ends| joined(ends, " to ", decimals));
        let text = text.unwrap_or_else(|| number(None, decimals));
        Self::of(text, None, None, ends)
    }

    fn of(
        text: String,
        beside: Option<String>,
        value: Option<f64>,
        ends: Option<[f64; 2]>,
    ) -> Self {
        Self {
            text,
            beside,
            value,
            ends,
            ..Self::default()
        }
    }

    /// Words, or the value to the last digit.
    pub(super) fn value(&self) -> Option<String> {
        if self.is_text {
            return Some(self.text.clone());
        }
        self.value.map(|value| value.to_string())
    }

    /// The lower and the upper end to the last digit.
    pub(super) fn ends(&self) -> Option<[String; 2]> {
        Some(self.ends?.map(|end| end.to_string()))
    }

    /// The number that stands for it among others: of a range the lower end.
    pub(super) fn rank(&self) -> Option<f64> {
        self.value.or(self.ends.map(|[low, _]| low))
    }

    /// None where it is not clear of 0.
    pub(super) fn side(&self) -> Option<Side> {
        if !self.clear {
            return None;
        }
        let is_above = self.value? > 0.0;
        Some(if is_above { Side::Above } else { Side::Below })
    }
}

impl<T: Into<String>> From<T> for Cell {
    fn from(text: T) -> Self {
        Self {
            text: text.into(),
            is_text: true,
            ..Self::default()
        }
    }
}

impl fmt::Display for Cell {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(&self.text)?;
        let beside = self.beside.as_deref().into_iter();
        let mut beside = beside.chain(self.side().map(Side::sign));
        beside.try_for_each(|beside| write!(formatter, " {beside}"))
    }
}

fn joined(ends: [f64; 2], by: &str, decimals: usize) -> String {
    ends.map(|end| number(Some(end), decimals)).join(by)
}

/// A number with its interval.
pub(crate) fn with_interval(
    value: Option<f64>,
    interval: Option<[f64; 2]>,
    decimals: usize,
) -> String {
    Cell::interval(value, interval, decimals).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_has_its_interval() {
        assert_eq!(
            with_interval(Some(0.5), Some([0.25, 0.75]), 2),
            "0.50 [0.25, 0.75]"
        );
    }

    #[test]
    fn each_form_is_shown_in_its_way() {
        let ends = Some([-0.25, 0.75]);
        for (cell, shown) in [
            (Cell::difference(Some(0.5), ends, 2), "+0.50 [-0.25, 0.75]"),
            (Cell::difference(Some(-0.1), None, 2), "-0.10"),
            (Cell::difference(None, None, 2), "–"),
            (Cell::spread(Some(0.5), ends, 2), "0.50 (-0.25 to 0.75)"),
            (Cell::spread(Some(0.5), None, 2), "0.50"),
            (Cell::range(ends, 2), "-0.25 to 0.75"),
            (Cell::range(None, 2), "–"),
            (Cell::number(Some(3.0), 0), "3"),
        ] {
            assert_eq!(cell.to_string(), shown);
        }
    }

    #[test]
    fn a_difference_shows_its_side_once_it_is_called_clear() {
        for (value, sign) in [(0.1, "▲"), (-0.1, "▼")] {
            let mut cell = Cell::gain(value, [value - 0.05, value + 0.05], 0.01, 2);
            assert_eq!((cell.side(), cell.p), (None, Some(0.01)));
            cell.clear = true;
            assert!(cell.to_string().ends_with(&format!("] {sign}")), "{cell}");
        }
    }
}
