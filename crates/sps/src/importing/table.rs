//! The table of values.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use sps_dataset::Property;
use sps_experiment::cells;

use super::photographs::in_order;

/// What a row is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Key {
    /// A folder of photographs, each a surface.
    Class,
    /// A photograph: a surface, or a view of the surface that the row names.
    Photograph,
    /// A folder of photographs, the views of one surface.
    Surface,
    /// The photograph that has the row's place in the order of names.
    Order,
}

/// What a column is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Column {
    Class,
    Photograph,
    Surface,
    View,
    Material,
    Group,
    Property,
}

/// The columns that are no property.
const NAMED: [(&str, Column); 6] = [
    ("class", Column::Class),
    ("photograph", Column::Photograph),
    ("surface", Column::Surface),
    ("view", Column::View),
    ("material", Column::Material),
    ("group", Column::Group),
];

/// Columns that the tactile table of a dataset has beside its properties.
const OF_DATASETS: [&str; 2] = ["location", "repeat"];

/// A table of values.
pub(super) struct Table {
    path: PathBuf,
    pub(super) key: Key,
    pub(super) columns: Vec<Column>,
    pub(super) properties: Vec<Property>,
    pub(super) rows: Vec<Row>,
}

pub(super) struct Row {
    pub(super) line: u64,
    /// The cells of columns that are no property; none where a cell is empty.
    named: BTreeMap<Column, String>,
    /// Of each property, as it is written; empty where it was not measured.
    pub(super) values: Vec<String>,
}

impl Table {
    /// Reads a table whose first line names its columns, or one without such a line whose columns
    /// are listed in the file `names`.
    pub(super) fn read(path: &Path, names: Option<&Path>) -> Result<Self> {
        let file = || path.display().to_string();
        let records = records(path, names.is_some()).with_context(file)?;
        let mut records = records.into_iter();
        let (key, properties, columns) = if let Some(names) = names {
            let listed = listed(names).and_then(|listed| columns(&listed, true));
            listed.with_context(|| names.display().to_string())?
        } else {
            let header = records.next().map(|(_, header)| header);
            columns(&header.unwrap_or_default(), false).with_context(file)?
        };
        let mut rows = Vec::new();
        for (line, record) in records {
            let row = row(&record, &columns, line);
            rows.push(row.with_context(|| format!("{}, line {line}", path.display()))?);
        }
        ensure!(!rows.is_empty(), "{} has no row of values", path.display());
        Ok(Self {
            path: path.to_owned(),
            key,
            columns,
            properties,
            rows,
        })
    }

    /// Where a row stands, for messages.
    pub(super) fn at(&self, line: u64) -> String {
        format!("{}, line {line}", self.path.display())
    }

    /// The views that rows name, in their order: by number where all are numbers, and else by name.
    pub(super) fn views(&self) -> Result<Vec<String>> {
        let view = |row: &Row| row.cell(Column::View).unwrap_or_default().to_owned();
        let views: BTreeSet<String> = self.rows.iter().map(view).collect();
        let numbered = |view: &String| Some((view.parse::<f64>().ok()?, view.clone()));
        let Some(mut numbered) = views.iter().map(numbered).collect::<Option<Vec<_>>>() else {
            return in_order(views).with_context(|| format!("{}, views", self.path.display()));
        };
        numbered.sort_by(|one, other| one.0.total_cmp(&other.0));
        Ok(numbered.into_iter().map(|(_, view)| view).collect())
    }

    /// One row of those of a surface, whose cells agree where they are not empty.
    pub(super) fn merged<'a>(&self, rows: &[&'a Row]) -> Result<Row> {
        let line = rows.first().map_or(0, |row| row.line);
        let at = || self.at(line);
        let mut named = BTreeMap::new();
        for &(name, column) in &NAMED[4..] {
            let cell = agreed(name, rows, |row| row.cell(column));
            named.extend(cell.with_context(at)?.map(|cell| (column, cell)));
        }
        let values = self.properties.iter().enumerate().map(|(i, property)| {
            let cell = |row: &'a Row| Some(row.values[i].as_str()).filter(|cell| !cell.is_empty());
            let cell = agreed(property.code(), rows, cell);
            Ok(cell.with_context(at)?.unwrap_or_default())
        });
        let values = values.collect::<Result<_>>()?;
        Ok(Row {
            line,
            named,
            values,
        })
    }
}

/// The one cell of a column that rows have; empty cells do not count.
fn agreed<'a>(
    name: &str,
    rows: &[&'a Row],
    cell: impl Fn(&'a Row) -> Option<&'a str>,
) -> Result<Option<String>> {
    let mut cells = rows.iter().filter_map(|row| Some((row.line, cell(row)?)));
    let Some((line, first)) = cells.next() else {
        return Ok(None);
    };
    if let Some((other_line, other)) = cells.find(|(_, other)| *other != first) {
        let (first, other) = (first.escape_debug(), other.escape_debug());
        bail!(
            "found `{first}` in line {line} and `{other}` in line {other_line} for `{name}`, expected one value for \
             a surface, in one of its rows or in several"
        );
    }
    Ok(Some(first.to_owned()))
}

impl Row {
    pub(super) fn cell(&self, column: Column) -> Option<&str> {
        self.named.get(&column).map(String::as_str)
    }
}

/// The lines of a table with their numbers: cells between commas or, in one `without_names`, between
/// blanks where it has no comma.
fn records(path: &Path, without_names: bool) -> Result<Vec<cells::Row>> {
    let text = cells::text(path)?;
    if without_names && !text.contains(',') {
        let lines = (1..).zip(text.lines());
        let lines = lines.map(|(number, line)| (number, line.split_whitespace().collect()));
        let lines = lines.filter(|(_, line): &cells::Row| !line.is_empty());
        return Ok(lines.collect());
    }
    Ok(cells::rows(&text)?)
}

/// The names of columns, one a line; a name of several words becomes a code with hyphens.
fn listed(names: &Path) -> Result<csv::StringRecord> {
    let text = cells::text(names)?;
    let words = |line: &str| line.split_whitespace().collect::<Vec<_>>().join("-");
    let names = text.lines().map(words);
    Ok(names.filter(|name| !name.is_empty()).collect())
}

fn columns(
    header: &csv::StringRecord,
    without_names: bool,
) -> Result<(Key, Vec<Property>, Vec<Column>)> {
    let mut seen = BTreeSet::new();
    for name in header {
        ensure!(seen.insert(name), "there are two columns `{name}`");
    }
    let column = |name: &str| {
        let named = NAMED.iter().find(|(known, _)| *known == name);
        named.map_or(Column::Property, |&(_, column)| column)
    };
    let columns: Vec<Column> = header.iter().map(column).collect();
    let key = key(&columns, without_names, header.get(0).unwrap_or_default())?;
    let is_property = |name: &&str| column(name) == Column::Property;
    let others = header.iter().filter(is_property);
    let properties: Vec<Property> = others.map(property).collect::<Result<_>>()?;
    ensure!(
        !properties.is_empty(),
        "no column is a property, expected one or more, each by its code, such as `fRS`"
    );
    Ok((key, properties, columns))
}

/// What the rows are of, by the columns that name photographs.
fn key(columns: &[Column], without_names: bool, first: &str) -> Result<Key> {
    let mut naming = columns.to_vec();
    naming.retain(|&column| column < Column::Material);
    naming.sort_unstable();
    Ok(match naming[..] {
        [Column::Class] => Key::Class,
        [Column::Surface] => Key::Surface,
        [Column::Photograph]
        | [Column::Photograph, Column::Surface]
        | [Column::Photograph, Column::Surface, Column::View] => Key::Photograph,
        [] if without_names => Key::Order,
        [] => bail!(
            "no column says which photographs a row is of: found `{first}` first, expected `surface`, \
             `class` or `photograph`"
        ),
        _ => {
            let found = NAMED.iter().filter(|(_, column)| naming.contains(column));
            let found: Vec<_> = found.map(|(name, _)| *name).collect();
            bail!(
                "found the columns `{}`, expected one of `class`, `surface` and `photograph`, or \
                 `photograph` with `surface`, or these two with `view`",
                found.join("`, `")
            )
        }
    })
}

/// A column that is none of the named ones.
fn property(name: &str) -> Result<Property> {
    let mut reserved = NAMED.iter().map(|(name, _)| *name).chain(OF_DATASETS);
    if let Some(reserved) = reserved.find(|reserved| reserved.eq_ignore_ascii_case(name)) {
        bail!(
            "the column `{name}` cannot be a property: `{reserved}` has a meaning of its own; rename it"
        );
    }
    Ok(name.parse()?)
}

fn row(record: &csv::StringRecord, columns: &[Column], line: u64) -> Result<Row> {
    let (found, expected) = (record.len(), columns.len());
    ensure!(
        found == expected,
        "found {found} cells, expected {expected}, one for each column"
    );
    let (mut named, mut values) = (BTreeMap::new(), Vec::new());
    for (cell, &column) in record.iter().zip(columns) {
        if column == Column::Property {
            ensure!(
                cell.is_empty() || cells::number(cell).is_some(),
                "found `{}`, expected a number within 1e9 of 0, or nothing where it was not measured",
                cell.escape_debug()
            );
            values.push(cell.to_owned());
        } else if !cell.is_empty() {
            named.insert(column, cell.to_owned());
        }
    }
    for (name, column) in &NAMED[..4] {
        let empty = columns.contains(column) && !named.contains_key(column);
        ensure!(!empty, "the column `{name}` is empty");
    }
    Ok(Row {
        line,
        named,
        values,
    })
}

/// Rows as CSV.
pub(super) fn written<'a>(
    header: Vec<&'a str>,
    rows: impl Iterator<Item = Vec<&'a str>>,
) -> Result<String> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for row in [header].into_iter().chain(rows) {
        writer.write_record(row)?;
    }
    Ok(String::from_utf8(writer.into_inner()?)?)
}
