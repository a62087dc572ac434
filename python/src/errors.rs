//! Errors of the crates as exceptions, each with its whole message.

use std::error::Error;
use std::io;

use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use sps_dataset::{
    DatasetError, DatasetErrorKind, FrameError, FrameErrorKind, WriteError, WriteErrorKind,
};
use sps_estimator::Error as EstimatorError;
use sps_metrics::{IntervalError, Undefined};
use sps_models::Error as ModelError;
use sps_models::weights::{WeightsError, WeightsErrorKind};

pyo3::create_exception!(
    sps,
    UndefinedScore,
    PyValueError,
    "A score has no value, for the reason that the message gives."
);

/// What is raised for an error: an exception as it came; `OSError` (`FileNotFoundError` and so on) for a file
/// that cannot be read or written; [`UndefinedScore`]; `RuntimeError` for a failure of the tensor library;
/// `ValueError` for all else.
pub(crate) struct Raised(PyErr);

/// What a function of Python returns or raises.
pub(crate) type Raises<T> = Result<T, Raised>;

impl<E: Into<anyhow::Error>> From<E> for Raised {
    fn from(error: E) -> Self {
        let exception = error.into().downcast::<PyErr>();
        Self(exception.unwrap_or_else(|error| exception_of(&error)))
    }
}

impl From<Raised> for PyErr {
    fn from(raised: Raised) -> Self {
        raised.0
    }
}

fn exception_of(error: &anyhow::Error) -> PyErr {
    let whole = message(error);
    for cause in error.chain().map(innermost) {
        if let Some(source) = cause.downcast_ref::<io::Error>() {
            return io::Error::new(source.kind(), whole).into();
        }
        let one_unit = matches!(cause.downcast_ref(), Some(IntervalError::OneUnit));
        if one_unit || cause.is::<Undefined>() {
            return UndefinedScore::new_err(whole);
        }
        if let Some(ModelError::Tensor(_)) = cause.downcast_ref() {
            return PyRuntimeError::new_err(whole);
        }
    }
    PyValueError::new_err(whole)
}

/// All causes, but for those that the one before says itself.
fn message(error: &anyhow::Error) -> String {
    let mut whole = error.to_string();
    for cause in error.chain().skip(1).map(ToString::to_string) {
        if !whole.ends_with(&cause) {
            whole = format!("{whole}: {cause}");
        }
    }
    whole
}

/// The error, or what it is made of without naming it as its source.
fn innermost<'e>(error: &'e (dyn Error + 'static)) -> &'e (dyn Error + 'static) {
    match error.downcast_ref() {
        Some(EstimatorError::Model(model)) => return innermost(model),
        Some(EstimatorError::Photograph(photograph)) => return innermost(photograph),
        Some(EstimatorError::File { error, .. }) => return error,
        _ => {}
    }
    if let Some(ModelError::Weights(weights)) = error.downcast_ref() {
        return innermost(weights);
    }
    if let Some(WeightsErrorKind::Io(source)) = error.downcast_ref().map(WeightsError::kind) {
        return source;
    }
    if let Some(DatasetErrorKind::Io(source)) = error.downcast_ref().map(DatasetError::kind) {
        return source;
    }
    if let Some(WriteErrorKind::Io(source) | WriteErrorKind::StorageFull(source)) =
        error.downcast_ref().map(WriteError::kind)
    {
        return source;
    }
    match error.downcast_ref().map(FrameError::kind) {
        Some(FrameErrorKind::Io(source)) => source,
        _ => error,
    }
}
