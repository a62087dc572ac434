//! The native half of the Python package `sps`: what the crates do, for numpy arrays.
//!
//! Each module here translates one crate: arrays in, arrays out, errors as exceptions. Nothing is
//! computed here. Whatever takes long runs without the interpreter's lock.

#![expect(
    clippy::needless_pass_by_value,
    reason = "arguments come from Python by value"
)]

/// A value of a class as Python shows it.
macro_rules! shown {
    ($class:ident, $value:ident, $($field:ident)+) => {{
        let fields = [$(format!(concat!(stringify!($field), "={:?}"), $value.$field)),+];
        format!("{}({})", stringify!($class), fields.join(", "))
    }};
}

mod arrays;
mod conformal;
mod dataset;
mod embeddings;
mod encoder;
mod errors;
mod estimator;
mod images;
mod intervals;
mod own;
mod program;
mod runs;
mod scores;
mod settings;
mod views;
mod work;

use pyo3::prelude::*;
use sps_base::memory::CountingAllocator;

/// Counts what an estimate allocates, which results say.
#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

/// What `sps/__init__.py` exports; `sps/_sps.pyi` has its types.
#[pymodule]
mod _sps {
    #[pymodule_export]
    use crate::{
        conformal::{Coverage, GroupConformal, SplitConformal, coverage},
        dataset::{Dataset, simulate},
        encoder::{Encoder, list_encoders},
        errors::UndefinedScore,
        estimator::{Answer, Answers, Estimate, Estimator, Looked, Session},
        intervals::{ScoreInterval, difference, holm, interval},
        own::{Fitted, fit},
        program::program,
        runs::{Comparison, Run, compare, experiment},
        scores::{Score, mae, median_percent_error, r2, rmse, spearman},
        views::{Selection, select_views},
    };
    #[pymodule_export]
    #[expect(non_upper_case_globals, reason = "Python's name for it")]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}
