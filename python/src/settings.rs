//! Settings as a config has them, from dictionaries.

use std::path::Path;

use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde::Serialize;
use serde_json::Value;
use sps_estimator::Regression;
use sps_experiment::config::{Experiment, Setting};
use sps_regress::RegressorSettings;
use toml::Table;

use crate::errors::{any_error, value_error};

/// What Python's own module makes JSON of.
pub(crate) fn json(of: &Bound<'_, PyAny>) -> PyResult<Value> {
    let json = of.py().import("json")?;
    let text: String = json.call_method1("dumps", (of,))?.extract()?;
    serde_json::from_str(&text).map_err(value_error)
}

/// The other way round.
pub(crate) fn python<'py>(py: Python<'py>, of: &impl Serialize) -> PyResult<Bound<'py, PyAny>> {
    let text = serde_json::to_string(of).map_err(value_error)?;
    py.import("json")?.call_method1("loads", (text,))
}

/// A dictionary as the text of a config.
pub(crate) fn text(of: &Bound<'_, PyAny>) -> PyResult<String> {
    toml::to_string(&json(of)?).map_err(value_error)
}

/// Keys of a config, dotted, with their values.
pub(crate) fn settings(of: Option<&Bound<'_, PyDict>>) -> PyResult<Vec<Setting>> {
    let Some(of) = of else { return Ok(Vec::new()) };
    let setting = |(key, value): (Bound<'_, PyAny>, Bound<'_, PyAny>)| {
        let key: String = key.extract()?;
        let value = toml::Value::try_from(json(&value)?);
        let value = value.map_err(|error| value_error(format_args!("{key}: {error}")))?;
        Ok(Setting::new(&key, value))
    };
    of.iter().map(setting).collect()
}

/// What a regression may have of the method of a config; beside the methods, the settings of regressors.
const OF_METHOD: [&str; 4] = ["kind", "head", "members", "folds"];

/// The regression of this kind, or with these settings; ridge where none is asked for.
pub(crate) fn regression(of: Option<&Bound<'_, PyAny>>) -> PyResult<Regression> {
    let named = |kind: String| Table::from_iter([("kind".to_owned(), kind.into())]);
    let mut method = match of {
        None => named("ridge".to_owned()),
        Some(of) => match of.extract() {
            Ok(kind) => named(kind),
            Err(_) => text(of)?.parse().map_err(value_error)?,
        },
    };
    let beside = Table::try_from(RegressorSettings::default()).map_err(value_error)?;
    let mut config = Table::new();
    for key in beside.keys() {
        config.extend(method.remove_entry(key));
    }
    if let Some(key) = method.keys().find(|key| !OF_METHOD.contains(&key.as_str())) {
        let expected = OF_METHOD
            .into_iter()
            .chain(beside.keys().map(String::as_str));
        let expected = expected.collect::<Vec<_>>().join(", ");
        return Err(value_error(format_args!(
            "regression: found `{key}`, expected {expected}"
        )));
    }
    for named in ["id", "label"] {
        method.insert(named.to_owned(), "regression".into());
    }
    config.insert("methods".to_owned(), vec![method].into());
    let experiment = Experiment::parse(Path::new("regression"), &config.to_string(), &[]);
    let experiment = experiment.map_err(any_error)?;
    let regression = experiment.regression().cloned();
    regression.ok_or_else(|| value_error("regression: expected one that looks at photographs"))
}
