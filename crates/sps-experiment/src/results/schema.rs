//! That `docs/results.schema.json` and `docs/results.md` are those of the types.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

use super::Results;

fn docs(name: &str) -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    root.join("docs").join(name)
}

fn schema() -> Value {
    serde_json::to_value(schemars::schema_for!(Results)).unwrap()
}

#[test]
fn the_schema_in_docs_is_that_of_the_types() {
    let path = docs("results.schema.json");
    let schema = schema();
    if std::env::var_os("UPDATE_SCHEMA").is_some() {
        let text = serde_json::to_string_pretty(&schema).unwrap();
        fs::write(&path, format!("{text}\n")).unwrap();
        return;
    }
    let stored = fs::read_to_string(&path).unwrap_or_default();
    let stored: Value = serde_json::from_str(&stored).unwrap_or_default();
    assert!(
        stored == schema,
        "docs/results.schema.json is stale; this writes it anew:\n    \
         UPDATE_SCHEMA=1 cargo test --release -p sps-experiment results::schema"
    );
}

#[test]
fn the_page_in_docs_names_every_key() {
    let page = fs::read_to_string(docs("results.md")).unwrap();
    let schema = schema();
    let objects = schema["$defs"].as_object().unwrap().values();
    let objects = objects.chain([&schema]);
    let properties = objects.filter_map(|object| object["properties"].as_object());
    let mut keys: BTreeSet<&String> = properties.flat_map(serde_json::Map::keys).collect();
    assert!(keys.len() > 60, "{} keys", keys.len());
    keys.retain(|key| !page.contains(&format!("`{key}`")));
    assert!(keys.is_empty(), "docs/results.md lacks {keys:?}");
}
