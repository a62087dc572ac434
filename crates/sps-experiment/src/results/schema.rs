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

/// The names of all properties of the objects that a schema defines.
fn keys(schema: &Value) -> BTreeSet<String> {
    let objects = schema["$defs"].as_object().unwrap().values();
    let objects = objects.chain([schema]);
    let properties = objects.filter_map(|object| object["properties"].as_object());
    properties.flat_map(|all| all.keys().cloned()).collect()
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
    let all = keys(&schema());
    assert!(all.len() > 60, "{} keys", all.len());
    let unnamed: Vec<&String> = all
        .iter()
        .filter(|key| !page.contains(&format!("`{key}`")))
        .collect();
    assert!(unnamed.is_empty(), "docs/results.md lacks {unnamed:?}");
}
