//! Arguments that numpy can make arrays of.

use numpy::{AllowTypeChange, PyArrayLike1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Numbers, one-dimensional: a copy, so that they hold still while the interpreter's lock is free.
pub(crate) struct Numbers(pub(crate) Vec<f64>);

impl<'py> FromPyObject<'_, 'py> for Numbers {
    type Error = PyErr;

    fn extract(values: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let array: PyArrayLike1<'py, f64, AllowTypeChange> = values.extract()?;
        Ok(Self(array.as_array().to_vec()))
    }
}

/// Which unit or group each sample is of, numbered in the order of the labels: numbers of any kind,
/// or strings.
pub(crate) struct Labels(pub(crate) Vec<usize>);

impl<'py> FromPyObject<'_, 'py> for Labels {
    type Error = PyErr;

    fn extract(labels: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let numpy = labels.py().import("numpy")?;
        let labels = numpy.call_method1("asarray", (labels,))?;
        let dimensions: usize = labels.getattr("ndim")?.extract()?;
        if dimensions != 1 {
            let found = format!("labels of {dimensions} dimensions, expected one");
            return Err(PyValueError::new_err(found));
        }
        let unique = numpy.call_method1("unique", (labels, false, true))?;
        let numbers: PyArrayLike1<'py, isize> = unique.get_item(1)?.extract()?;
        let numbers = numbers.as_array();
        Ok(Self(
            numbers.iter().map(|&number| number as usize).collect(),
        ))
    }
}
