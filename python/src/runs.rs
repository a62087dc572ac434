//! Experiments, what they measured, and what differs between them.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Result, anyhow};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use serde::Serialize;
use serde_json::{Map, Value};
use sps_experiment::config::{Experiment, Setting};
use sps_experiment::predictions;
use sps_experiment::results::Results;
use sps_report::compare as beside;
use tempfile::TempDir;

use crate::errors::Raises;
use crate::settings::{python, settings, text};
use crate::work::watched;

/// What an experiment measured: `Run(path)` reads the folder of a finished run, or a `results.json`.
///
/// A table is a list of rows, each a dictionary, of which pandas makes a DataFrame. What has no value is None.
///
/// Raises OSError where the file cannot be read, ValueError where it is damaged.
#[pyclass(module = "sps", frozen)]
pub(crate) struct Run {
    path: PathBuf,
    results: Results,
    /// Where it lies, if it goes with the object.
    _scratch: Option<Arc<TempDir>>,
}

#[pymethods]
impl Run {
    #[new]
    fn new(path: PathBuf) -> Raises<Self> {
        let results = Results::read(&path)?;
        Ok(Self::of(path, results, None))
    }

    /// The folder of the run, or its `results.json`.
    #[getter]
    fn path(&self) -> &Path {
        &self.path
    }

    /// All of `results.json`, whose keys docs/results.md explains.
    #[getter]
    fn results<'py>(&self, py: Python<'py>) -> Raises<Bound<'py, PyAny>> {
        python(py, &self.results)
    }

    /// The scores, a table: `rows` is "properties" for a row for each method and property, with all that
    /// there is of both (r2, r2_interval, mae and so on), or "methods" for a row for each method.
    #[pyo3(signature = (rows = "properties"))]
    fn scores<'py>(&self, py: Python<'py>, rows: &str) -> Raises<Bound<'py, PyAny>> {
        let methods = self.results.methods.iter().map(object);
        let methods: Vec<Row> = methods.collect::<Result<_>>()?;
        match rows {
            "methods" => python(py, &methods),
            "properties" => {
                let properties = &self.results.properties;
                let of = |method| properties.iter().map(move |code| of_property(method, code));
                python(py, &methods.iter().flat_map(of).collect::<Vec<Row>>())
            }
            found => Err(anyhow!(
                "rows: found {found:?}, expected \"properties\" or \"methods\""
            ))?,
        }
    }

    /// Every estimate of a surface held out, a table: method, property, rerun, surface, truth, estimate, and
    /// where there are some group, views, low and high.
    ///
    /// Raises OSError where there is no `predictions.csv`, ValueError where it is damaged.
    fn predictions<'py>(&self, py: Python<'py>) -> Raises<Bound<'py, PyAny>> {
        python(py, &predictions::read(&self.path)?)
    }

    fn __fspath__(&self) -> &OsStr {
        self.path.as_os_str()
    }

    fn __str__(&self) -> String {
        sps_report::summary(&self.results).terminal()
    }

    fn __repr__(&self) -> String {
        let (name, path) = (&self.results.experiment, self.path.display());
        let methods = self.results.methods.len();
        format!("Run(\"{path}\", experiment={name:?}, methods={methods})")
    }
}

impl Run {
    pub(crate) fn of(path: PathBuf, results: Results, scratch: Option<Arc<TempDir>>) -> Self {
        Self {
            path,
            results,
            _scratch: scratch,
        }
    }
}

/// Runs an experiment into the folder `out`, or finishes what was begun there, and writes its report, as
/// `sps experiment` does; returns its Run.
///
/// `config` is the path of a TOML file, or a dictionary with its keys (docs/config.md); `settings` are
/// dotted keys that are laid over it, as {"reruns": 1, "methods.ridge.views": 3}; `dataset`, a Dataset or
/// the path of one, is what it runs on in place of the config's data. `fresh` does every trial again.
///
/// `progress` is called with what is done, how many and of how many; what it raises ends the work, as
/// KeyboardInterrupt does, and finished trials are kept.
///
/// Raises OSError where a file cannot be read or written, ValueError for a config or data that cannot be.
#[pyfunction]
#[pyo3(signature = (config, out, *, settings = None, dataset = None, fresh = false, progress = None))]
pub(crate) fn experiment(
    py: Python<'_>,
    config: &Bound<'_, PyAny>,
    out: PathBuf,
    settings: Option<&Bound<'_, PyDict>>,
    dataset: Option<PathBuf>,
    fresh: bool,
    progress: Option<&Bound<'_, PyAny>>,
) -> Raises<Run> {
    let mut all = Vec::new();
    if let Some(folder) = dataset {
        all.push(Setting::new("data.from", "folder"));
        let path = folder.display().to_string();
        all.push(Setting::new("data.folder.path", path));
    }
    all.extend(self::settings(settings)?);
    let experiment = match config.extract::<PathBuf>() {
        Ok(path) => Experiment::read(&path, &all)?,
        Err(_) => Experiment::parse(Path::new("experiment"), &text(config)?, &all)?,
    };
    let results = watched(py, progress, || {
        let (folder, results) = sps_experiment::run::run(&experiment, &out, fresh)?;
        sps_report::write(&folder)?;
        Ok(results)
    })?;
    Ok(Run::of(out, results, None))
}

/// One run set beside another; str() of it says what differs, as `sps compare` does.
#[pyclass(module = "sps", frozen)]
pub(crate) struct Comparison(beside::Comparison);

#[pymethods]
impl Comparison {
    /// Every score of the methods that both have, a table: first, second, their difference with its
    /// interval, p, and corrected_p for how many differ. Without a property it is the mean over properties.
    #[getter]
    fn scores<'py>(&self, py: Python<'py>) -> Raises<Bound<'py, PyAny>> {
        python(py, &object(&self.0)?.get("scores"))
    }

    /// R² that moved by more than `tolerance`, and by more than chance, or that is no longer there: a line
    /// for each.
    fn past(&self, tolerance: f64) -> Vec<String> {
        self.0.past(tolerance)
    }

    fn __str__(&self) -> String {
        self.0.to_string()
    }
}

/// Sets finished runs beside the first of them: a Comparison for each of `others`. A run is a Run or the
/// path of its folder.
///
/// Raises OSError where a file cannot be read, ValueError for what is no finished run and for runs
/// without a method in common.
#[pyfunction]
#[pyo3(signature = (first, *others))]
pub(crate) fn compare(
    py: Python<'_>,
    first: PathBuf,
    others: &Bound<'_, PyTuple>,
) -> Raises<Vec<Comparison>> {
    let others: Vec<PathBuf> = others.extract()?;
    watched(py, None, || {
        let first = beside::Run::read(&first)?;
        let compared = |other: &PathBuf| {
            let other = beside::Run::read(other)?;
            beside::compare(&first, &other).map(Comparison)
        };
        others.iter().map(compared).collect()
    })
}

type Row = Map<String, Value>;

fn object(of: impl Serialize) -> Result<Row> {
    Ok(serde_json::from_value(serde_json::to_value(of)?)?)
}

/// What a method has of one property.
fn of_property(method: &Row, code: &str) -> Row {
    let mut row = Row::new();
    let id = method.get("id").cloned().unwrap_or_default();
    row.insert("method".to_owned(), id);
    row.insert("property".to_owned(), code.into());
    let scores = method.iter().filter_map(|(key, value)| {
        let value = value.as_object()?.get(code)?;
        Some((key.clone(), value.clone()))
    });
    row.extend(scores);
    row
}
