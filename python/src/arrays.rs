//! Arguments that numpy can make arrays of.

use numpy::{AllowTypeChange, PyArray1, PyArrayLike1, PyArrayMethods};
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
        let (_, numbers): (Bound<'py, PyAny>, Bound<'py, PyAny>) = numpy
            .call_method1("unique", (labels, false, true))?
            .extract()?;
        let numbers = numbers.cast_into::<PyArray1<isize>>()?;
        let numbers = numbers.try_readonly()?;
        Ok(Self(
            numbers.as_array().iter().map(|&n| n as usize).collect(),
        ))
    }
}
