//! The table of values.

use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use sps_dataset::Property;

/// What the first column names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Key {
    /// Folders of photographs.
    Class,
    /// Photographs.
    Photograph,
}

/// A table of values, one row for a class or a photograph.
pub(super) struct Table {
    pub(super) key: Key,
    pub(super) properties: Vec<Property>,
    pub(super) rows: Vec<Row>,
}

#[derive(Clone)]
pub(super) struct Row {
    pub(super) line: u64,
    /// The class, or the photograph's path in the folder.
    pub(super) key: String,
    pub(super) material: Option<String>,
    pub(super) group: Option<String>,
    /// Of each property, as it is written; empty where it was not measured.
    pub(super) values: Vec<String>,
}

/// What a column is.
enum Column {
    Key,
    Material,
    Group,
    Property,
}

impl Table {
    pub(super) fn read(path: &Path) -> Result<Self> {
        let file = || path.display().to_string();
        let reader = csv::ReaderBuilder::new()
            .trim(csv::Trim::All)
            .from_path(path);
        let mut reader = reader.with_context(file)?;
        let header = reader.headers().with_context(file)?.clone();
        let (key, properties, columns) = columns(&header).with_context(file)?;
        let mut rows = Vec::new();
        for record in reader.records() {
            let record = record.with_context(file)?;
            let line = record.position().map_or(0, csv::Position::line);
            let row = row(&record, &columns, line);
            rows.push(row.with_context(|| format!("{}, line {line}", path.display()))?);
        }
        ensure!(
            !rows.is_empty(),
            "{} has a header and no row",
            path.display()
        );
        Ok(Self {
            key,
            properties,
            rows,
        })
    }
}

fn columns(header: &csv::StringRecord) -> Result<(Key, Vec<Property>, Vec<Column>)> {
    let key = match header.get(0) {
        Some("class") => Key::Class,
        Some("photograph") => Key::Photograph,
        found => bail!(
            "found `{}` at the head of the first column, expected `class` or `photograph`",
            found.unwrap_or_default()
        ),
    };
    let (mut properties, mut columns) = (Vec::new(), vec![Column::Key]);
    for name in header.iter().skip(1) {
        columns.push(match name {
            "material" if key == Key::Photograph => Column::Material,
            "group" if key == Key::Photograph => Column::Group,
            code => {
                let property: Property = code.parse()?;
                ensure!(
                    !properties.contains(&property),
                    "there are two columns `{code}`"
                );
                properties.push(property);
                Column::Property
            }
        });
    }
    ensure!(
        !properties.is_empty(),
        "no column is a property, expected one or more beside the first"
    );
    Ok((key, properties, columns))
}

fn row(record: &csv::StringRecord, columns: &[Column], line: u64) -> Result<Row> {
    let mut row = Row {
        line,
        key: String::new(),
        material: None,
        group: None,
        values: Vec::new(),
    };
    for (cell, column) in record.iter().zip(columns) {
        let named = Some(cell.to_owned()).filter(|name| !name.is_empty());
        match column {
            Column::Key => cell.clone_into(&mut row.key),
            Column::Material => row.material = named,
            Column::Group => row.group = named,
            Column::Property => {
                let number = cell.parse().is_ok_and(f64::is_finite);
                ensure!(
                    cell.is_empty() || number,
                    "found `{cell}`, expected a number, or nothing where it was not measured"
                );
                row.values.push(cell.to_owned());
            }
        }
    }
    ensure!(!row.key.is_empty(), "the first column is empty");
    Ok(row)
}

/// Rows as CSV.
pub(super) fn written(rows: impl Iterator<Item = Vec<String>>) -> Result<String> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for row in rows {
        writer.write_record(&row)?;
    }
    Ok(String::from_utf8(writer.into_inner()?)?)
}
