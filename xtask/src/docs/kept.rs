//! What the documents keep of a finished run: `docs/measured/RUN.json`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use serde_json::{Number, Value};
use sps_experiment::checksums;
use sps_experiment::files::{read_text, write_atomically};
use sps_experiment::results::{MethodResult, Results};

use super::matching;

const FOLDER: &str = "docs/measured";

/// All that is kept, by the names of the runs' folders.
pub(super) struct Runs(BTreeMap<String, Results>);

impl Runs {
    pub(super) fn read(root: &Path) -> Result<Self> {
        let read = |path: PathBuf| {
            let results = serde_json::from_str(&read_text(&path)?).with_context(|| {
                let path = path.display();
                format!("{path} is damaged; `cargo xtask docs RUN_DIR` writes it again")
            });
            let name = path.file_stem().unwrap_or_default().to_string_lossy();
            Ok((name.into_owned(), results?))
        };
        let paths = matching(root, &format!("{FOLDER}/*.json"))?;
        Ok(Self(paths.into_iter().map(read).collect::<Result<_>>()?))
    }

    pub(super) fn get(&self, run: &str) -> Result<&Results> {
        self.0.get(run).with_context(|| {
            format!("{FOLDER}/{run}.json is not there; `cargo xtask docs RUN_DIR` writes it")
        })
    }
}

/// Keeps the numbers of a finished run below `root`, without what no table needs; returns the run's
/// name and the file.
pub(super) fn numbers(root: &Path, run: &Path) -> Result<(String, PathBuf)> {
    checksums::ensure_finished(run, &["results.json"])?;
    let mut results = Results::read(run)?;
    results.methods.iter_mut().for_each(lighten);
    let folder = run.canonicalize();
    let folder = folder.with_context(|| format!("cannot read {}", run.display()))?;
    let name = folder.file_name().and_then(|name| name.to_str());
    let run = run.display();
    let name = name.with_context(|| format!("{run} has no name"))?;
    ensure!(
        !name.contains(char::is_whitespace),
        "{run}: a marker cannot name a run with a space in it"
    );
    let path = root.join(FOLDER).join(format!("{name}.json"));
    write_atomically(&path, text(&results)?.as_bytes())?;
    Ok((name.to_owned(), path))
}

/// Drops what is large and in no table.
fn lighten(method: &mut MethodResult) {
    method.scores.lighten();
    method.training_means.clear();
    method.training_losses.clear();
    method.selected_views.clear();
    for selection in method.selections.values_mut().flatten() {
        selection.curve.clear();
    }
}

/// JSON with a line for each method, so that a difference shows which has changed.
fn text(results: &Results) -> Result<String> {
    let mut whole = serde_json::to_value(results)?;
    round(&mut whole);
    let keys = whole.as_object().into_iter().flatten();
    let lines = keys.map(|(key, value)| match value {
        Value::Array(methods) if key == "methods" => {
            let methods: Vec<String> = methods.iter().map(Value::to_string).collect();
            format!("\"{key}\": [\n{}\n]", methods.join(",\n"))
        }
        _ => format!("\"{key}\": {value}"),
    });
    let lines: Vec<String> = lines.collect();
    Ok(format!("{{\n{}\n}}\n", lines.join(",\n")))
}

/// Rounds to eight digits: more than any table prints.
fn round(value: &mut Value) {
    match value {
        Value::Number(number) if number.is_f64() => {
            let digits = number.as_f64().map(|x| format!("{x:.7e}"));
            let rounded = digits.and_then(|digits| digits.parse().ok());
            if let Some(rounded) = rounded.and_then(Number::from_f64) {
                *number = rounded;
            }
        }
        Value::Array(values) => values.iter_mut().for_each(round),
        Value::Object(values) => values.values_mut().for_each(round),
        _ => {}
    }
}
