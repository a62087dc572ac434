//! That `docs/results.schema.json` and `docs/results.md` are those of the types.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::Results;

fn docs(name: &str) -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
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
         UPDATE_SCHEMA=1 cargo test --release -p xtask --bin xtask results::schema"
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

/// A file with the keys that every kept file has.
pub(crate) fn file() -> Value {
    let nothing = json!({});
    let method = json!({
        "id": "ridge", "label": "Ridge", "kind": "ridge", "encoder": "", "precision": "f32",
        "reruns": 3, "training_surfaces": 360, "held_out_surfaces": 0, "held_out_units": 0,
        "r2": { "fRS": 0.5 }, "r2_std": { "fRS": null }, "mae": nothing,
        "median_percent_error": nothing, "rmse": nothing, "spearman": nothing,
        "r2_interval": { "fRS": [0.4, 0.6] }, "zero_truths": { "fRS": 0 },
        "r2_mean": 0.5, "r2_mean_interval": [0.4, 0.6], "mae_mean": null,
        "median_percent_error_mean": null, "median_percent_error_top8": null,
        "median_percent_error_best8": null, "best8": [],
        "over_reruns": {}, "r2_mean_gain": null, "r2_mean_gains": {}, "paper": null,
        "frames_decoded_per_surface": 1.0, "frames_encoded_per_surface": 1.0,
        "predict_seconds_per_surface": 0.01, "train_seconds": 0.5, "encoder_train_seconds": 0.0,
        "training_means": {}, "selected_views": { "fRS": [[49]] }, "selections": {}, "notes": [],
    });
    json!({
        "schema": 4, "source_hash": "", "config_hash": "", "data_hash": "", "seed": 0,
        "cpu": "", "threads": 1, "precision": ["f32"],
        "experiment": "single-image", "description": "",
        "dataset": {
            "name": "the simulator", "simulated": true, "published_sps": false,
            "surfaces": 400, "training_surfaces": 360, "units": 400, "views": 100,
            "view_angles_deg": [], "encoder": "efficientnet-lite-body",
            "ceiling_one_view": {}, "ceiling_all_views": {},
        },
        "properties": ["fRS"], "interval_level": 0.95, "against": [], "methods": [method],
        "notes": [],
    })
}
