use super::json_node::{Entries, Node};
use super::json_values::Columns;
use super::keyed::KeyedTable;
use super::rows::{RawRow, RawTable};
use super::{Json, JsonLayout};
use crate::error::{Fault, Place};
use crate::files::text;
use crate::property::RESERVED;

pub(super) fn read(bytes: &[u8], format: &Json) -> Result<RawTable, Fault> {
    let document: Node = serde_json::from_str(text("JSON", bytes)?).map_err(|error| {
        let line = Place::Line(error.line() as u64);
        Fault::malformed("JSON", error).at(line)
    })?;
    let expected = match (format.layout, &document) {
        (JsonLayout::Keyed, Node::Object(entries)) => return keyed(entries, format),
        (JsonLayout::Records, Node::List(list)) => return records(list, format),
        (JsonLayout::Keyed, _) => "an object with a key per surface",
        (JsonLayout::Records, _) => "a list of objects",
    };
    Err(Fault::unexpected("the document", document, expected))
}

fn keyed(entries: &Entries, format: &Json) -> Result<RawTable, Fault> {
    let mut columns = Columns::new(format.property_order.as_ref());
    for (name, node) in entries {
        if let Node::Object(values) = node {
            let names = values.iter().map(|(name, _)| name.as_str());
            columns.note(names).map_err(|fault| fault.at_key(name))?;
        }
    }
    let mut table = KeyedTable::new(&format.statistics);
    for (name, node) in entries {
        let touches = columns.touches(node).map_err(|fault| fault.at_key(name))?;
        table.push(Place::Key(name.clone()), name, touches)?;
    }
    table.finish(columns.properties().to_vec())
}

fn records(list: &[Node], format: &Json) -> Result<RawTable, Fault> {
    if format.statistics.restore {
        let expected = "the layout `keyed`, for records have no statistics to restore values by";
        return Err(Fault::unexpected("`statistics.restore`", "true", expected));
    }
    let mut columns = Columns::new(format.property_order.as_ref());
    let mut records = Vec::with_capacity(list.len());
    for (at, node) in list.iter().enumerate() {
        let place = Place::Key(format!("[{at}]"));
        let Node::Object(entries) = node else {
            return Err(Fault::unexpected("a record", node, "an object").at(place));
        };
        let names = entries.iter().map(|(name, _)| name.as_str());
        let noted = columns.note(names.filter(|name| !RESERVED.contains(name)));
        noted.map_err(|fault| fault.at(place.clone()))?;
        records.push((place, entries));
    }
    let row = |(place, entries): (Place, &Entries)| {
        record(place.clone(), entries, &columns).map_err(|fault| fault.at(place))
    };
    Ok(RawTable {
        rows: records.into_iter().map(row).collect::<Result<_, _>>()?,
        columns: columns.properties().to_vec(),
        restore: None,
    })
}

fn record(place: Place, entries: &Entries, columns: &Columns<'_>) -> Result<RawRow, Fault> {
    let find = |wanted: &str| {
        let (_, node) = entries.iter().find(|(name, _)| name == wanted)?;
        Some(node)
    };
    let surface = match find("surface") {
        Some(Node::Text(surface)) => surface.clone(),
        other => {
            let found = other.map_or("nothing".to_owned(), ToString::to_string);
            let expected = "the id of a surface";
            return Err(Fault::unexpected("`surface`", found, expected));
        }
    };
    let index = |name: &str| match find(name) {
        None => Ok(0),
        Some(Node::Number(n)) if n.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(n) => {
            Ok(*n as u32)
        }
        Some(other) => {
            let expected = "a whole number from 0 to 4294967295";
            Err(Fault::not_a_number(name, other, expected))
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
