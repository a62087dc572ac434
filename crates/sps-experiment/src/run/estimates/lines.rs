//! The lines of a file of estimates.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use anyhow::Result;
use csv::StringRecord;
use sps_base::names::UnknownName;
use sps_dataset::Property;

use super::problems::Problems;
use super::{Asked, Estimate, Estimates, Place};
use crate::cells;

/// The columns; those after the third may be missing.
const COLUMNS: [&str; 6] = ["surface", "property", "value", "low", "high", "rerun"];

/// Reads the lines; none where the first one does not name the columns.
pub(super) fn read(
    text: &str,
    asked: &Asked<'_>,
    problems: &mut Problems<'_>,
) -> Result<Option<Estimates>> {
    let mut rows = cells::rows(text)?.into_iter();
    let (line, header) = rows.next().unwrap_or((1, StringRecord::new()));
    let Some(columns) = Columns::of(line, &header, problems) else {
        return Ok(None);
    };
    let surfaces = asked.surfaces.iter().enumerate();
    let mut reader = Reader {
        surfaces: surfaces.map(|(at, s)| (s.id.as_str(), at)).collect(),
        asked,
        columns,
        problems,
        of: HashMap::new(),
    };
    for (line, cells) in rows {
        reader.row(line, &cells);
    }
    Ok(Some(Estimates {
        content: blake3::hash(text.as_bytes()).to_hex().to_string(),
        by_rerun: reader.columns.rerun.is_some(),
        of: reader.of,
    }))
}

struct Columns {
    count: usize,
    surface: usize,
    property: usize,
    value: usize,
    /// `low` and `high`.
    interval: Option<[usize; 2]>,
    rerun: Option<usize>,
}

impl Columns {
    fn of(line: u64, header: &StringRecord, problems: &mut Problems<'_>) -> Option<Self> {
        let place = |name: &str| header.iter().position(|column| column == name);
        let mut refused = Vec::new();
        for (at, name) in header.iter().enumerate() {
            if !COLUMNS.contains(&name) {
                refused.push(UnknownName::new("column", name, COLUMNS).to_string());
            } else if place(name) != Some(at) {
                refused.push(format!("there are two columns `{name}`"));
            }
        }
        let [surface, property, value, low, high, rerun] = COLUMNS.map(place);
        for (name, needed) in COLUMNS.into_iter().zip([surface, property, value]) {
            if needed.is_none() {
                refused.push(format!("there is no column `{name}`"));
            }
        }
        if low.is_some() != high.is_some() {
            let [one, other] = if high.is_none() {
                ["low", "high"]
            } else {
                ["high", "low"]
            };
            refused.push(format!("a column `{one}` without a column `{other}`"));
        }
        if !refused.is_empty() {
            let refused = refused.into_iter();
            refused.for_each(|problem| problems.at(line, || problem));
            return None;
        }
        Some(Self {
            count: header.len(),
            surface: surface?,
            property: property?,
            value: value?,
            interval: low.zip(high).map(|(low, high)| [low, high]),
            rerun,
        })
    }
}

struct Reader<'a, 'p> {
    asked: &'a Asked<'a>,
    /// Indices by name.
    surfaces: HashMap<&'a str, usize>,
    columns: Columns,
    problems: &'a mut Problems<'p>,
    of: HashMap<Place, Estimate>,
}

impl Reader<'_, '_> {
    /// Keeps what a line estimates. One whose number is wrong is kept without it: only the number is
    /// the problem, and not that there were no estimate.
    fn row(&mut self, line: u64, cells: &StringRecord) {
        let (found, expected) = (cells.len(), self.columns.count);
        if found != expected {
            let problem =
                || format!("found {found} cells, expected {expected}, one for each column");
            return self.problems.at(line, problem);
        }
        let surface = self.surface(line, &cells[self.columns.surface]);
        let property = self.property(line, &cells[self.columns.property]);
        let rerun = match self.columns.rerun {
            Some(column) => self.rerun(line, &cells[column]),
            None => Some(0),
        };
        let value = self.number(line, "value", &cells[self.columns.value]);
        let interval = self.interval(line, cells);
        let (Some(surface), Some(property), Some(rerun)) = (surface, property, rerun) else {
            return;
        };
        match self.of.entry((property, rerun, surface)) {
            Entry::Vacant(place) => drop(place.insert(Estimate {
                line,
                value: value.unwrap_or(f64::NAN),
                interval,
            })),
            Entry::Occupied(first) => {
                let first = first.get().line;
                let problem = || format!("estimates again what line {first} does");
                self.problems.at(line, problem);
            }
        }
    }

    fn surface(&mut self, line: u64, name: &str) -> Option<usize> {
        let known = self.asked.surfaces.iter().map(|surface| &surface.id[..]);
        let found = self.surfaces.get(name).copied();
        self.problems.unless(found, line, || {
            let unknown = UnknownName {
                // Datasets have too many to list.
                expected: Vec::new(),
                ..UnknownName::new("surface", name, known)
            };
            unknown.to_string()
        })
    }

    fn property(&mut self, line: u64, code: &str) -> Option<Property> {
        let mut measured = self.asked.measured.iter();
        let known = measured.clone().map(Property::code);
        let found = measured.find(|property| property.code() == code).cloned();
        self.problems.unless(found, line, || {
            UnknownName::new("property", code, known).to_string()
        })
    }

    fn rerun(&mut self, line: u64, cell: &str) -> Option<usize> {
        let splits = self.asked.splits;
        let reruns = splits.all.len() / splits.of_rerun;
        let found = cell.parse().ok().filter(|&rerun| rerun < reruns);
        self.problems.unless(found, line, || {
            format!(
                "found `{}` for `rerun`, expected one of the experiment's {reruns}, counted from 0",
                cell.escape_debug()
            )
        })
    }

    fn interval(&mut self, line: u64, cells: &StringRecord) -> Option<[f64; 2]> {
        let [low, high] = self.columns.interval?;
        let low = self.number(line, "low", &cells[low]);
        let high = self.number(line, "high", &cells[high]);
        let (low, high) = (low?, high?);
        if low > high {
            let problem = || format!("found {low} for `low`, expected at most `high`, {high}");
            self.problems.at(line, problem);
        }
        Some([low, high])
    }

    fn number(&mut self, line: u64, column: &str, cell: &str) -> Option<f64> {
        self.problems.unless(cells::number(cell), line, || {
            format!(
                "found `{}` for `{column}`, expected a number within 1e9 of 0",
                cell.escape_debug()
            )
        })
    }
}
