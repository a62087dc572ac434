use std::path::Path;

use super::json_node::Node;
use super::json_values::Columns;
use super::keyed::KeyedTable;
use super::rows::{RawRow, RawTable};
use super::{Json, JsonLayout};
use crate::files::text;
use crate::{DatasetError, DatasetErrorKind, Place};

type Entries = [(String, Node)];

pub(super) fn read(path: &Path, bytes: &[u8], format: &Json) -> Result<RawTable, DatasetError> {
    let document: Node = serde_json::from_str(text(path, "JSON", bytes)?).map_err(|error| {
        let kind = DatasetErrorKind::Malformed {
            format: "JSON",
            reason: error.to_string(),
        };
        DatasetError::line(path, error.line() as u64, kind)
    })?;
    let wrong = |expected: &str| {
        let kind = DatasetErrorKind::unexpected("the document", document.describe(), expected);
        DatasetError::file(path, kind)
    };
    match (format.layout, &document) {
        (JsonLayout::Keyed, Node::Object(entries)) => keyed(path, entries, format),
        (JsonLayout::Records, Node::List(list)) => records(path, list, format),
        (JsonLayout::Keyed, _) => Err(wrong("an object with a key per surface")),
        (JsonLayout::Records, _) => Err(wrong("a list of objects")),
    }
}

fn keyed(path: &Path, entries: &Entries, format: &Json) -> Result<RawTable, DatasetError> {
    let mut columns = Columns::new(format.property_order.as_ref());
    for (name, node) in entries {
        if let Node::Object(values) = node {
            let names = values.iter().map(|(name, _)| name.as_str());
            columns
                .note(names)
                .map_err(|kind| DatasetError::key(path, name, kind))?;
        }
    }
    let mut table = KeyedTable::new(path, &format.statistics);
    for (name, node) in entries {
        let touches = columns
            .touches(node)
            .map_err(|kind| DatasetError::key(path, name, kind))?;
        table.push(Place::Key(name.clone()), name, touches)?;
    }
    table.finish(columns.properties().to_vec())
}

/// What a record has beside its values.
const RECORD_KEYS: [&str; 3] = ["surface", "location", "repeat"];

fn records(path: &Path, list: &[Node], format: &Json) -> Result<RawTable, DatasetError> {
    if format.statistics.restore {
        let expected = "the layout `keyed`, for records have no statistics to restore values by";
        let kind = DatasetErrorKind::unexpected("`statistics.restore`", "true", expected);
        return Err(DatasetError::file(path, kind));
    }
    let mut columns = Columns::new(format.property_order.as_ref());
    let objects: Vec<(String, &Entries)> = list
        .iter()
        .enumerate()
        .map(|(i, node)| match node {
            Node::Object(entries) => Ok((format!("[{i}]"), entries.as_slice())),
            other => {
                let kind = DatasetErrorKind::unexpected("a record", other.describe(), "an object");
                Err(DatasetError::key(path, &format!("[{i}]"), kind))
            }
        })
        .collect::<Result<_, _>>()?;
    for (key, entries) in &objects {
        let names = entries.iter().map(|(name, _)| name.as_str());
        let values = names.filter(|name| !RECORD_KEYS.contains(name));
        columns
            .note(values)
            .map_err(|kind| DatasetError::key(path, key, kind))?;
    }
    let row = |(key, entries): &(String, &Entries)| {
        record(key, entries, &columns).map_err(|kind| DatasetError::key(path, key, kind))
    };
    let rows = objects.iter().map(row).collect::<Result<_, _>>()?;
    Ok(RawTable {
        columns: columns.properties().to_vec(),
        rows,
        restore: None,
    })
}

fn record(key: &str, entries: &Entries, columns: &Columns<'_>) -> Result<RawRow, DatasetErrorKind> {
    let find = |wanted: &str| {
        let entry = entries.iter().find(|(name, _)| name == wanted);
        entry.map(|(_, node)| node)
    };
    let surface = match find("surface") {
        Some(Node::Text(surface)) => surface.clone(),
        other => {
            let found = other.map_or("nothing".to_owned(), Node::describe);
            let expected = "the id of a surface";
            return Err(DatasetErrorKind::unexpected("`surface`", found, expected));
        }
    };
    let index = |name: &str| match find(name) {
        None => Ok(0),
        Some(Node::Number(n)) if n.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(n) => {
            Ok(*n as u32)
        }
        Some(other) => {
            let expected = "a whole number from 0 to 4294967295";
            Err(DatasetErrorKind::not_a_number(
                name,
                &other.describe(),
                expected,
            ))
        }
    };
    let values = entries
        .iter()
        .filter(|(name, _)| !RECORD_KEYS.contains(&name.as_str()));
    Ok(RawRow {
        place: Place::Key(key.to_owned()),
        surface,
        location: index("location")?,
        repeat: index("repeat")?,
        values: columns.of_object(values.map(|(name, node)| (name.as_str(), node)))?,
    })
}
