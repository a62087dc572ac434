//! A comparison as plain text.

use std::collections::BTreeSet;
use std::fmt;

use sps_experiment::config::Differing;
use sps_experiment::results::Kind;

use super::moved::Moved;
use super::{Aspect, Comparison};
use crate::table::{Cell, Row, Table};

/// Longer values are cut: `--json` has them whole.
const LONGEST: usize = 24;

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "run 1  {}", self.first.display())?;
        writeln!(f, "run 2  {}", self.second.display())?;
        writeln!(f)?;
        let differing = self.differing();
        if !differing.rows.is_empty() {
            f.write_str(&differing.terminal())?;
        }
        let same = self.aspects.iter().filter(|one| one.differing.is_empty());
        let same: Vec<&str> = same.map(|aspect| aspect.name).collect();
        if !same.is_empty() {
            writeln!(f, "The same in both: {}", same.join(", "))?;
        }
        for (run, only) in [(1, &self.only_first), (2, &self.only_second)] {
            if !only.is_empty() {
                writeln!(f, "Only run {run} has: {}", only.join(", "))?;
            }
        }
        writeln!(f, "\n{}", self.about_the_intervals())?;
        if let Some(calls) = self.calls() {
            writeln!(f, "{calls}")?;
        }
        let same = self.scores.iter().filter(|score| !score.is_other()).count();
        match self.scores.len() {
            all if all == same => writeln!(f, "All {all} scores are the same.")?,
            all if same > 0 => writeln!(f, "{same} of {all} scores are the same and not listed.")?,
            _ => {}
        }
        for table in self.scores() {
            write!(f, "\n{}", table.terminal())?;
        }
        write!(f, "\n{}", self.speed().terminal())
    }
}

impl Comparison {
    fn differing(&self) -> Table {
        let rows = self.aspects.iter().flat_map(|Aspect { name, differing }| {
            differing.iter().map(|Differing { key, first, second }| {
                let value = |value: &Option<String>| cut(value.as_deref().unwrap_or("–"));
                Row::measured(vec![
                    (*name).into(),
                    key.as_str().into(),
                    value(first).into(),
                    value(second).into(),
                ])
            })
        });
        let columns = ["", "key", "run 1", "run 2"];
        Table::new("differing", "What differs", columns, rows)
    }

    fn about_the_intervals(&self) -> String {
        let paired = self.scores.iter().filter(|score| score.paired).count();
        let intervals = format!(
            "{:.0} % intervals over {} and reruns",
            100.0 * self.interval_level,
            self.units
        );
        if paired == self.scores.len() {
            format!("Both are scored on the same surfaces: {intervals}, paired.")
        } else if paired == 0 {
            format!("They are scored on different surfaces: {intervals}, unpaired.")
        } else {
            format!("{intervals}, paired but for rows marked unpaired: other surfaces.")
        }
    }

    /// How many rows are clear of 0, and how many would be by chance.
    fn calls(&self) -> Option<String> {
        let tested = self.scores.iter().filter(|one| one.corrected_p.is_some());
        let tested: Vec<&Moved> = tested.collect();
        if tested.is_empty() {
            return None;
        }
        let tables: BTreeSet<Option<Kind>> = tested.iter().map(|one| one.table()).collect();
        let outside = tested.iter().filter(|one| {
            let [low, high] = one.interval.unwrap_or_default();
            low > 0.0 || high < 0.0
        });
        let tails = 1.0 - self.interval_level;
        Some(format!(
            "{} of the {} rows that differ are clear of 0, after Holm's correction for the rows of their\n\
             table: where nothing differs, chance marks any row in at most {:.0} % of tables (here {}).\n\
             Without the correction {} of their intervals exclude 0, by chance alone about {:.0} would.",
            tested.iter().filter(|one| one.clear).count(),
            tested.len(),
            100.0 * tails,
            tables.len(),
            outside.count(),
            tails * tested.len() as f64,
        ))
    }

    /// One of means, and one for each score, of those that are not the same.
    fn scores(&self) -> Vec<Table> {
        let scores = || self.scores.iter().filter(|score| score.is_other());
        let of = |kind: Kind| {
            let rows = scores().filter(move |one| one.score == kind && one.property.is_some());
            Table::new(
                "score",
                format!("{} of each property", kind.name()),
                ["method", "property", "run 1", "run 2", "difference", ""],
                rows.map(|one| one.row(one.property.as_deref().unwrap_or_default())),
            )
        };
        let means = scores().filter(|one| one.property.is_none());
        let means = Table::new(
            "means",
            "Means over properties",
            ["method", "score", "run 1", "run 2", "difference", ""],
            means.map(|one| one.row(one.score.name())),
        );
        let tables = [means].into_iter().chain(Kind::ALL.map(of));
        tables.filter(|table| !table.rows.is_empty()).collect()
    }

    fn speed(&self) -> Table {
        let rows = self.speed.iter().map(|one| {
            let errors = one.error.map(|error| Cell::number(error, 3));
            let frames = one.frames_encoded_per_surface;
            let frames = frames.map(|frames| Cell::number(Some(frames), 1));
            let seconds = one.predict_seconds_per_surface;
            let ms = seconds.map(|seconds| Cell::number(seconds.map(|s| 1e3 * s), 2));
            let mut cells = vec![one.method.as_str().into()];
            cells.extend([errors, frames, ms].into_iter().flatten());
            cells.push(Cell::number(one.times, 2));
            Row::measured(cells)
        });
        let measured = ["error", "frames", "ms"].into_iter();
        let of_runs = measured.flat_map(|what| [1, 2].map(|run| format!("{what} {run}")));
        let mut columns = vec!["method".to_owned()];
        columns.extend(of_runs);
        columns.push("ms 2 / ms 1".to_owned());
        Table::new(
            "speed",
            "Speed beside error, which is 1 - R²; times as they were on each run's machine",
            columns,
            rows,
        )
    }
}

impl Moved {
    fn row(&self, what: &str) -> Row {
        let decimals = self.score.decimals();
        let marks = [(self.clear, "clear of 0"), (!self.paired, "unpaired")];
        let marks = marks.iter().filter(|(is, _)| *is).map(|(_, mark)| *mark);
        Row::measured(vec![
            self.method.as_str().into(),
            what.into(),
            Cell::number(self.first, decimals),
            Cell::number(self.second, decimals),
            Cell::difference(self.difference, self.interval, decimals),
            marks.collect::<Vec<_>>().join(", ").into(),
        ])
    }
}

/// With dots where it is cut.
fn cut(text: &str) -> String {
    if text.chars().count() <= LONGEST {
        return text.to_owned();
    }
    let kept: String = text.chars().take(LONGEST - 1).collect();
    format!("{kept}…")
}
