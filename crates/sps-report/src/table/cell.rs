//! What stands in a cell: words, or numbers as they were measured and the form that they are shown in.

use std::fmt;

use sps_experiment::text::number;

/// A cell of a table. It is shown rounded; CSV has its numbers as they were measured.
#[derive(Clone, Debug, PartialEq)]
pub enum Cell {
    /// Words, as they stand.
    Text(String),
    /// Numbers as they were measured, and how they are shown.
    Numbers(Numbers),
}

/// A value, or what it lies between, or both.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Numbers {
    value: Option<f64>,
    ends: Option<[f64; 2]>,
    form: Form,
    decimals: usize,
    /// Of a difference, how often chance alone makes one as large.
    p: Option<f64>,
    /// Whether it is clear of 0 among all differences of its table.
    clear: bool,
}

/// How numbers are put together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Form {
    /// `0.50`, or `0.50 [0.25, 0.75]` where it has an interval.
    Interval,
    /// `+0.50 [0.25, 0.75]`.
    Difference,
    /// `0.50 (0.25 to 0.75)`.
    Spread,
    /// `0.25 to 0.75`: no value is asked for.
    Range,
}

/// The signs of a difference that is clear of 0.
pub(super) const ABOVE: &str = "▲";
const BELOW: &str = "▼";

impl Cell {
    /// A number with so many decimals.
    pub fn number(value: Option<f64>, decimals: usize) -> Self {
        Self::interval(value, None, decimals)
    }

    pub(crate) fn count(count: usize) -> Self {
        Self::number(Some(count as f64), 0)
    }

    pub(crate) fn interval(value: Option<f64>, ends: Option<[f64; 2]>, decimals: usize) -> Self {
        Self::of(value, ends, Form::Interval, decimals)
    }

    /// How much one number is more than another, with its interval.
    pub fn difference(value: Option<f64>, ends: Option<[f64; 2]>, decimals: usize) -> Self {
        Self::of(value, ends, Form::Difference, decimals)
    }

    /// The same with its p-value, for [`Table::tested`](super::Table::tested).
    pub(crate) fn gain(value: f64, ends: [f64; 2], p: f64, decimals: usize) -> Self {
        Self::Numbers(Numbers {
            p: Some(p),
            ..Numbers::of(Some(value), Some(ends), Form::Difference, decimals)
        })
    }

    /// A mean with the lowest and the highest that it is made of.
    pub(crate) fn spread(value: Option<f64>, ends: Option<[f64; 2]>, decimals: usize) -> Self {
        Self::of(value, ends, Form::Spread, decimals)
    }

    /// The lowest and the highest alone.
    pub(crate) fn range(ends: Option<[f64; 2]>, decimals: usize) -> Self {
        Self::of(None, ends, Form::Range, decimals)
    }

    fn of(value: Option<f64>, ends: Option<[f64; 2]>, form: Form, decimals: usize) -> Self {
        Self::Numbers(Numbers::of(value, ends, form, decimals))
    }

    fn numbers(&self) -> Option<&Numbers> {
        match self {
            Self::Text(_) => None,
            Self::Numbers(numbers) => Some(numbers),
        }
    }

    pub(super) fn p(&self) -> Option<f64> {
        self.numbers()?.p
    }

    /// Says that it is clear of 0 among all differences of its table.
    pub(super) fn call(&mut self) {
        if let Self::Numbers(numbers) = self {
            numbers.clear = true;
        }
    }

    pub(super) fn is_text(&self) -> bool {
        matches!(self, Self::Text(_))
    }

    /// What it says beside an interval; `None` where it is an interval alone.
    pub(super) fn value(&self) -> Option<String> {
        match self {
            Self::Text(text) => Some(text.clone()),
            Self::Numbers(numbers) if numbers.form == Form::Range => None,
            Self::Numbers(numbers) => Some(plain(numbers.value)),
        }
    }

    /// What is read first, and what the value lies between.
    pub(super) fn parts(&self) -> (String, Option<String>) {
        match self {
            Self::Text(text) => (text.clone(), None),
            Self::Numbers(numbers) => numbers.parts(),
        }
    }

    /// The number that stands for it among others: of a range the lower end.
    pub(super) fn rank(&self) -> Option<f64> {
        let Numbers { value, ends, .. } = self.numbers()?;
        value.or(ends.map(|[low, _]| low))
    }

    /// Of a difference that is clear of 0, on which side of it that lies.
    pub(super) fn sign(&self) -> Option<&'static str> {
        let numbers = self.numbers().filter(|numbers| numbers.clear)?;
        Some(if numbers.value? > 0.0 { ABOVE } else { BELOW })
    }

    /// The lower and the upper end, where it has them.
    pub(super) fn ends(&self) -> Option<[String; 2]> {
        Some(self.numbers()?.ends?.map(|end| plain(Some(end))))
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}

impl From<&str> for Cell {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}

impl fmt::Display for Cell {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Text(text) => formatter.write_str(text),
            Self::Numbers(numbers) => {
                let (value, ends) = numbers.parts();
                formatter.write_str(&value)?;
                ends.map_or(Ok(()), |ends| write!(formatter, " {ends}"))?;
                self.sign()
                    .map_or(Ok(()), |sign| write!(formatter, " {sign}"))
            }
        }
    }
}

impl Numbers {
    fn of(value: Option<f64>, ends: Option<[f64; 2]>, form: Form, decimals: usize) -> Self {
        Self {
            value,
            ends,
            form,
            decimals,
            p: None,
            clear: false,
        }
    }

    /// What is read first, and what the value lies between.
    fn parts(self) -> (String, Option<String>) {
        let Self {
            value,
            ends,
            form,
            decimals,
            ..
        } = self;
        let text = number(value, decimals);
        let ends = ends.map(|ends| ends.map(|end| number(Some(end), decimals)));
        let bracketed = |[low, high]: [String; 2]| format!("[{low}, {high}]");
        let range = |[low, high]: [String; 2]| format!("{low} to {high}");
        match form {
            Form::Interval => (text, ends.map(bracketed)),
            Form::Difference => {
                let sign = value.is_some() && !text.starts_with('-');
                let signed = format!("{}{text}", if sign { "+" } else { "" });
                (signed, ends.map(bracketed))
            }
            Form::Spread => (text, ends.map(|ends| format!("({})", range(ends)))),
            // A missing value stands for a missing range.
            Form::Range => (ends.map_or(text, range), None),
        }
    }
}

/// To the last digit; nothing where there is no number.
fn plain(value: Option<f64>) -> String {
    value.map(|value| value.to_string()).unwrap_or_default()
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
            (Cell::count(3), "3"),
        ] {
            assert_eq!(cell.to_string(), shown);
        }
    }

    #[test]
    fn a_difference_shows_its_side_once_it_is_called_clear() {
        for (value, sign) in [(0.1, "▲"), (-0.1, "▼")] {
            let mut cell = Cell::gain(value, [value - 0.05, value + 0.05], 0.01, 2);
            assert_eq!((cell.sign(), cell.p()), (None, Some(0.01)));
            cell.call();
            assert!(cell.to_string().ends_with(&format!("] {sign}")), "{cell}");
        }
    }
}
