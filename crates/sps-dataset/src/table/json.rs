use super::json_node::{Entries, Node};
use super::json_values::Columns;
use super::keyed::KeyedTable;
use super::rows::{RawRow, RawTable};
use super::{Json, JsonLayout};
use crate::DatasetErrorKind;
use crate::error::{Fault, Place};
use crate::files::text;

pub(super) fn read(bytes: &[u8], format: &Json) -> Result<RawTable, Fault> {
    let document: Node = serde_json::from_str(text("JSON", bytes)?).map_err(|error| {
        let line = Place::Line(error.line() as u64);
        DatasetErrorKind::malformed("JSON", error).at(line)
    })?;
    let expected = match (format.layout, &document) {
        (JsonLayout::Keyed, Node::Object(entries)) => return keyed(entries, format),
        (JsonLayout::Records, Node::List(list)) => return records(list, format),
        (JsonLayout::Keyed, _) => "an object with a key per surface",
        (JsonLayout::Records, _) => "a list of objects",
    };
    Err(DatasetErrorKind::unexpected("the document", document, expected).into())
}

fn keyed(entries: &Entries, format: &Json) -> Result<RawTable, Fault> {
    let mut columns = Columns::new(format.property_order.as_ref());
    for (name, node) in entries {
        if let Node::Object(values) = node {
            let names = values.iter().map(|(name, _)| name.as_str());
            columns.note(names).map_err(|kind| kind.at_key(name))?;
        }
    }
    let mut table = KeyedTable::new(&format.statistics);
    for (name, node) in entries {
        let touches = columns.touches(node).map_err(|kind| kind.at_key(name))?;
        table.push(Place::Key(name.clone()), name, touches)?;
    }
    table.finish(columns.properties().to_vec())
}

/// What a record has beside its values.
const RECORD_KEYS: [&str; 3] = ["surface", "location", "repeat"];

fn records(list: &[Node], format: &Json) -> Result<RawTable, Fault> {
    if format.statistics.restore {
        let expected = "the layout `keyed`, for records have no statistics to restore values by";
        let kind = DatasetErrorKind::unexpected("`statistics.restore`", "true", expected);
        return Err(kind.into());
    }
    let mut columns = Columns::new(format.property_order.as_ref());
    let mut records = Vec::with_capacity(list.len());
    for (at, node) in list.iter().enumerate() {
        let place = Place::Key(format!("[{at}]"));
        let Node::Object(entries) = node else {
            let kind = DatasetErrorKind::unexpected("a record", node, "an object");
            return Err(kind.at(place));
        };
        let names = entries.iter().map(|(name, _)| name.as_str());
        let values = names.filter(|name| !RECORD_KEYS.contains(name));
        columns
            .note(values)
            .map_err(|kind| kind.at(place.clone()))?;
        records.push((place, entries));
    }
    let row = |(place, entries): (Place, &Entries)| {
        record(place.clone(), entries, &columns).map_err(|kind| kind.at(place))
    };
    Ok(RawTable {
        rows: records.into_iter().map(row).collect::<Result<_, _>>()?,
        columns: columns.properties().to_vec(),
        restore: None,
    })
}

fn record(
    place: Place,
    entries: &Entries,
    columns: &Columns<'_>,
) -> Result<RawRow, DatasetErrorKind> {
    let find = |wanted: &str| {
        let entry = entries.iter().find(|(name, _)| name == wanted);
        entry.map(|(_, node)| node)
    };
    let surface = match find("surface") {
        Some(Node::Text(surface)) => surface.clone(),
        other => {
            let found = other.map_or("nothing".to_owned(), ToString::to_string);
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
            Err(DatasetErrorKind::not_a_number(name, other, expected))
        }
    };
    Ok(RawRow {
        place,
        surface,
        location: index("location")?,
        repeat: index("repeat")?,
        values: columns.of_object(entries)?,
    })
}
