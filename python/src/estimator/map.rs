//! A map as arrays.

use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use sps_estimator::{Map, Predicted};

/// `values`, `low` and `high` of shape (properties, rows, columns), `familiar` (rows, columns) and
/// `centres` (rows, columns, 2); NaN where there is none.
pub(crate) fn arrays(py: Python<'_>, map: Map) -> PyResult<Bound<'_, PyDict>> {
    let (rows, columns) = (map.rows, map.columns);
    let places = rows * columns;
    let properties = map.predictions.properties;
    let values = properties.iter().flat_map(|one| one.values.iter().copied());
    let ends = |end: fn(&sps_metrics::PredictionInterval) -> f64| -> Vec<f64> {
        let of_property = |one: &Predicted| match &one.intervals {
            Ok(intervals) => intervals.iter().map(end).collect(),
            Err(_) => vec![f64::NAN; places],
        };
        properties.iter().flat_map(of_property).collect()
    };
    let familiar = map.predictions.familiar;
    let familiar = familiar.unwrap_or_else(|| vec![f64::NAN; places]);
    let centres: Vec<f64> = map.centres.into_iter().flatten().collect();
    let shape = [properties.len(), rows, columns];
    let arrays = PyDict::new(py);
    for (name, values) in [
        ("values", values.collect::<Vec<f64>>()),
        ("low", ends(|interval| interval.low)),
        ("high", ends(|interval| interval.high)),
    ] {
        arrays.set_item(name, PyArray1::from_vec(py, values).reshape(shape)?)?;
    }
    let familiar = PyArray1::from_vec(py, familiar);
    arrays.set_item("familiar", familiar.reshape([rows, columns])?)?;
    let centres = PyArray1::from_vec(py, centres);
    arrays.set_item("centres", centres.reshape([rows, columns, 2])?)?;
    Ok(arrays)
}
