//! Settings as a config has them, from dictionaries.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde::Serialize;
use serde_json::Value;
use sps_estimator::Regression;
use sps_experiment::config::{Experiment, Setting};
use sps_regress::RegressorSettings;
use toml::Table;

use crate::errors::Raises;

/// What Python's own module makes JSON of.
pub(crate) fn json(of: &Bound<'_, PyAny>) -> Result<Value> {
    let json = of.py().import("json")?;
    let text: String = json.call_method1("dumps", (of,))?.extract()?;
    Ok(serde_json::from_str(&text)?)
}

/// The other way round.
pub(crate) fn python<'py>(py: Python<'py>, of: &impl Serialize) -> Raises<Bound<'py, PyAny>> {
    let text = serde_json::to_string(of)?;
    Ok(py.import("json")?.call_method1("loads", (text,))?)
}

/// A dictionary as the text of a config.
pub(crate) fn text(of: &Bound<'_, PyAny>) -> Result<String> {
    Ok(toml::to_string(&json(of)?)?)
}

/// Keys of a config, dotted, with their values.
pub(crate) fn settings(of: Option<&Bound<'_, PyDict>>) -> Result<Vec<Setting>> {
    let Some(of) = of else { return Ok(Vec::new()) };
    let setting = |(key, value): (Bound<'_, PyAny>, Bound<'_, PyAny>)| {
        let key: String = key.extract()?;
        let value = toml::Value::try_from(json(&value)?).with_context(|| key.clone())?;
        Ok(Setting::new(&key, value))
    };
    of.iter().map(setting).collect()
}

/// What a regression may have of the method of a config; beside the methods, the settings of regressors.
const OF_METHOD: [&str; 4] = ["kind", "head", "members", "folds"];

/// The regression of this kind, or with these settings; ridge where none is asked for.
pub(crate) fn regression(of: Option<&Bound<'_, PyAny>>) -> Result<Regression> {
    let named = |kind: String| Table::from_iter([("kind".to_owned(), kind.into())]);
    let mut method = match of {
        None => named("ridge".to_owned()),
        Some(of) => match of.extract() {
            Ok(kind) => named(kind),
            Err(_) => text(of)?.parse()?,
        },
    };
    let beside = Table::try_from(RegressorSettings::default())?;
    let mut config = Table::new();
    for key in beside.keys() {
        config.extend(method.remove_entry(key));
    }
    let beside = beside.keys().map(String::as_str);
    let expected: Vec<&str> = OF_METHOD.into_iter().chain(beside).collect();
    for key in method.keys() {
        ensure!(
            OF_METHOD.contains(&key.as_str()),
            "regression: found `{key}`, expected {}",
            expected.join(", ")
        );
    }
    for named in ["id", "label"] {
        method.insert(named.to_owned(), "regression".into());
    }
    config.insert("methods".to_owned(), vec![method].into());
    let experiment = Experiment::parse(Path::new("regression"), &config.to_string(), &[])?;
    let regression = experiment.regression().cloned();
    regression.context("regression: expected one that looks at photographs")
}
