//! A model from photographs, the method chosen by surfaces held out.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::anyhow;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use sps::fitting;
use sps_experiment::config::Setting;
use sps_experiment::own::Chosen;

use crate::dataset::Dataset;
use crate::embeddings;
use crate::encoder::Encoder;
use crate::errors::Raises;
use crate::estimator::{Estimator, scratch};
use crate::runs::Run;
use crate::settings::settings;
use crate::work::watched;

/// A fitted model, and how well models of its kind did on surfaces held out; str() of it says so as
/// `sps fit` does.
#[pyclass(module = "sps", frozen)]
pub(crate) struct Fitted {
    /// The Estimator, fitted to all surfaces.
    #[pyo3(get)]
    model: Py<Estimator>,
    /// The method that was kept, of those in run.
    #[pyo3(get)]
    method: String,
    /// Its mean R² over the properties on surfaces held out. It was chosen by it, which flatters it a little.
    #[pyo3(get)]
    r2: Option<f64>,
    /// The Run that the methods were compared in.
    #[pyo3(get)]
    run: Py<Run>,
    /// The surfaces whose estimates were furthest from what was measured, and by how many standard
    /// deviations, the worst first.
    #[pyo3(get)]
    worst: Vec<(String, f64)>,
    said: String,
}

#[pymethods]
impl Fitted {
    /// Of each property, by its code, what such models did on surfaces held out, a dictionary: r2, mae,
    /// coverage of the intervals, unit-coverage where surfaces come in groups, mean-width, readings.
    #[getter]
    fn scores<'py>(&self, py: Python<'py>) -> Raises<Bound<'py, PyAny>> {
        Ok(self.model.get().about(py)?.get_item("measured")?)
    }

    fn __str__(&self) -> &str {
        &self.said
    }

    fn __repr__(&self) -> String {
        let r2 = self.r2.map(|r2| format!("{r2:.3}"));
        let (method, r2) = (&self.method, r2.as_deref().unwrap_or("None"));
        format!("Fitted(method={method:?}, r2={r2})")
    }
}

/// Fits a model to photographs and what was measured, as `sps fit` does: of ridge, kernel ridge and the
/// nearest surface the one is kept whose R² is the highest on surfaces held out, a tenth at a time (whole
/// groups, where there are some).
///
/// `photographs` is a Dataset; or it and `values`, `properties`, `groups`, `materials` and `angles` are
/// what Dataset takes. The shorter side of every photograph is brought to `resize` pixels, which
/// None leaves as it is; intervals hold the truth of the share `level` of new surfaces; `encoder` is an
/// Encoder, the built-in one where none is given. `settings` are keys of a config (docs/config.md), as
/// {"reruns": 1, "methods": [{"id": "net", "label": "Network", "kind": "head", "views": "all"}]}.
///
/// `embeddings` are used in place of an encoder and `resize`: an array (surfaces, width) or (surfaces, views,
/// width), or a file as `sps embed` writes it or docs/config.md describes it. Rows that name no file are in
/// the order of the photographs, for a folder with a table in that of their paths. Estimator.predict_embedded
/// asks such a model.
///
/// The model is written into the folder `out`, with the page `report.html`, as `sps fit` does; a model
/// that is there is replaced.
///
/// `progress` is called with what is done, how many and of how many; what it raises ends the work, as
/// KeyboardInterrupt does.
///
/// Raises what Dataset raises, and ValueError for settings and data that cannot be.
#[pyfunction]
#[pyo3(signature = (
    photographs, values = None, *, properties = None, groups = None, materials = None, angles = None,
    encoder = None, embeddings = None, resize = 256, level = 0.9, settings = None, out = None,
    progress = None
))]
#[expect(clippy::too_many_arguments, reason = "most are keywords")]
pub(crate) fn fit(
    py: Python<'_>,
    photographs: &Bound<'_, PyAny>,
    values: Option<&Bound<'_, PyAny>>,
    properties: Option<Vec<String>>,
    groups: Option<&Bound<'_, PyAny>>,
    materials: Option<Vec<String>>,
    angles: Option<Vec<f64>>,
    encoder: Option<&Bound<'_, Encoder>>,
    embeddings: Option<&Bound<'_, PyAny>>,
    resize: Option<usize>,
    level: f64,
    settings: Option<&Bound<'_, PyDict>>,
    out: Option<PathBuf>,
    progress: Option<&Bound<'_, PyAny>>,
) -> Raises<Fitted> {
    let (data, import) = Dataset::made(photographs, values, properties, groups, materials, angles)?;
    let scratch = scratch()?;
    let cache = scratch.path().join("cache").display().to_string();
    let mut all = vec![
        Setting::new("cache.folder", cache),
        Setting::new("train.level", level),
    ];
    match (embeddings, encoder) {
        (Some(_), Some(_)) => Err(anyhow!("encoder: expected none beside embeddings"))?,
        (Some(embeddings), None) => {
            let folder = photographs.extract::<PathBuf>().ok();
            let (folder, scratch) = (folder.as_deref(), scratch.path());
            let file = embeddings::file(embeddings, import.as_ref(), folder, scratch)?;
            let file = file.display().to_string();
            all.push(Setting::new("encoder.embeddings", file));
        }
        (None, encoder) => {
            let resize = resize.unwrap_or(0) as i64;
            all.push(Setting::new("encoder.resize", resize));
            all.extend(encoder.iter().flat_map(|encoder| encoder.get().settings()));
        }
    }
    all.extend(self::settings(settings)?);
    let run = scratch.path().join("run");
    let mut lines = Vec::new();
    let (chosen, trained) = watched(py, progress, || {
        let chosen = Chosen::of(data.folder(), data.name(), all, &run)?;
        lines.push(sps_report::summary(&chosen.results).terminal());
        let trained = chosen.train(&mut |line| lines.push(line.to_owned()))?;
        if let Some(out) = &out {
            fitting::save(&chosen, &trained, out)?;
        }
        Ok((chosen, trained))
    })?;
    let best = chosen.results.method(&chosen.method);
    Ok(Fitted {
        r2: best.and_then(|best| best.means.r2_mean),
        model: Py::new(py, Estimator::of(trained.model))?,
        method: chosen.method,
        run: Py::new(py, Run::of(run, chosen.results, Some(Arc::new(scratch))))?,
        worst: trained.worst,
        said: lines.join("\n"),
    })
}
