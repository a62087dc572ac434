//! A comparison as it is printed.

use std::fmt;

use sps_experiment::text::aligned;

/// Everything measured, beside its baseline where there is one.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Comparison(pub(super) Vec<Part>);

/// Numbers of one kind.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Part {
    pub title: String,
    pub rows: Vec<Row>,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Row {
    pub name: String,
    pub then: String,
    pub now: String,
    pub change: Change,
}

/// How a number changed, and whether it may.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Change {
    pub by: String,
    pub budget: String,
    pub verdict: Verdict,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Verdict {
    #[default]
    None,
    Within,
    Past,
    /// Past the budget, but by no more than reruns differ.
    Chance,
    Slower,
    Faster,
    New,
    NotMeasured,
}

impl Verdict {
    pub(super) fn within(within: bool) -> Self {
        if within { Self::Within } else { Self::Past }
    }

    const fn text(self) -> &'static str {
        match self {
            Self::None => "",
            Self::Within => "within",
            Self::Past => "PAST",
            Self::Chance => "past, may be chance",
            Self::Slower => "slower",
            Self::Faster => "faster",
            Self::New => "new",
            Self::NotMeasured => "not measured",
        }
    }
}

impl Change {
    /// A number that may grow by the share `more`, and shrink as it likes.
    pub(super) fn growth(then: f64, now: f64, more: f64) -> Self {
        let change = now / then - 1.0;
        Self {
            by: percent(change),
            budget: percent(more),
            verdict: Verdict::within(change <= more),
        }
    }
}

impl From<Verdict> for Change {
    fn from(verdict: Verdict) -> Self {
        Self {
            verdict,
            ..Self::default()
        }
    }
}

pub(super) fn percent(share: f64) -> String {
    format!("{:+.1} %", 100.0 * share)
}

impl Comparison {
    /// What is past its budget, in words: also what has one and is no longer measured.
    pub(crate) fn past(&self) -> Vec<String> {
        let rows = self.0.iter().flat_map(|part| &part.rows);
        let past = rows.filter_map(|row| {
            let [name, then, now, by, budget, _] = row.cells();
            match row.change.verdict {
                Verdict::Past => Some(format!("{name} ({then} to {now}: {by}, budget {budget})")),
                Verdict::NotMeasured => Some(format!("{name} ({then}, not measured)")),
                _ => None,
            }
        });
        past.collect()
    }
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for Part { title, rows } in &self.0 {
            writeln!(f, "\n{title}")?;
            let mut lines = vec![["", "then", "now", "change", "budget", ""]];
            lines.extend(rows.iter().map(Row::cells));
            let lines = lines.iter().map(|line| line.map(str::to_owned).to_vec());
            let lines: Vec<_> = lines.collect();
            f.write_str(&aligned(&lines, |at| at == 0 || at == 5))?;
        }
        Ok(())
    }
}

impl Row {
    fn cells(&self) -> [&str; 6] {
        let (change, verdict) = (&self.change, self.change.verdict.text());
        let (by, budget) = (&change.by, &change.budget);
        [&self.name, &self.then, &self.now, by, budget, verdict]
    }
}
