//! Errors of the crates as exceptions, each with its whole message.

use std::io;
use std::path::Path;

use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use sps_dataset::{FrameError, FrameErrorKind};
use sps_metrics::{ConformalError, IntervalError, Undefined};
use sps_models::weights::{WeightsError, WeightsErrorKind};

pyo3::create_exception!(
    sps,
    UndefinedScore,
    PyValueError,
    "A score has no value, for the reason that the message gives."
);

/// A `ValueError` that says what the error says.
pub(crate) fn value_error(error: impl ToString) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// A file that cannot be read is an `OSError` (`FileNotFoundError` and so on), a broken one a
/// `ValueError`.
pub(crate) fn frame_error(error: &FrameError) -> PyErr {
    match error.kind() {
        FrameErrorKind::Io(source) => os_error(source, error),
        _ => value_error(error),
    }
}

/// A weights file that cannot be read is an `OSError`, a failure of the tensor library a
/// `RuntimeError`, all else a `ValueError`.
pub(crate) fn model_error(error: &sps_models::Error) -> PyErr {
    match error {
        sps_models::Error::Weights(weights) => weights_error(weights),
        sps_models::Error::Tensor(_) => PyRuntimeError::new_err(error.to_string()),
        _ => value_error(error),
    }
}

/// A file that cannot be read or written is an `OSError`, what the models say as [`model_error`] has it,
/// all else a `ValueError`.
pub(crate) fn estimator_error(error: &sps_estimator::Error) -> PyErr {
    match error {
        sps_estimator::Error::Model(model) => model_error(model),
        sps_estimator::Error::Photograph(photograph) => frame_error(photograph),
        sps_estimator::Error::File { error: source, .. } => os_error(source, error),
        _ => value_error(error),
    }
}

/// What a run says: a file that cannot be read or written is an `OSError`, all else a `ValueError`.
pub(crate) fn any_error(error: anyhow::Error) -> PyErr {
    let whole = format!("{error:#}");
    let source = error
        .chain()
        .find_map(|cause| cause.downcast_ref::<io::Error>());
    match source {
        Some(source) => os_error(source, whole),
        None => value_error(whole),
    }
}

/// As [`model_error`] for weights alone.
pub(crate) fn weights_error(error: &WeightsError) -> PyErr {
    match error.kind() {
        WeightsErrorKind::Io(source) => os_error(source, error),
        _ => value_error(error),
    }
}

pub(crate) fn undefined(error: &Undefined) -> PyErr {
    UndefinedScore::new_err(error.to_string())
}

pub(crate) fn interval_error(error: &IntervalError) -> PyErr {
    match error {
        IntervalError::Undefined(_) | IntervalError::OneUnit => {
            UndefinedScore::new_err(error.to_string())
        }
        _ => value_error(error),
    }
}

pub(crate) fn conformal_error(error: &ConformalError) -> PyErr {
    match error {
        ConformalError::Undefined(_) => UndefinedScore::new_err(error.to_string()),
        _ => value_error(error),
    }
}

/// A file that cannot be written is an `OSError`.
pub(crate) fn file_error(error: &io::Error, path: &Path) -> PyErr {
    os_error(
        error,
        format_args!("{}: cannot be written: {error}", path.display()),
    )
}

/// The exception that Python has for such a failure to read or write, with the message of `whole`.
fn os_error(source: &io::Error, whole: impl ToString) -> PyErr {
    io::Error::new(source.kind(), whole.to_string()).into()
}
