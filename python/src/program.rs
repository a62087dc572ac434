//! The program `sps`, in the interpreter's process.

use std::ffi::OsString;
use std::io::{self, Write};
use std::process::ExitCode;

use pyo3::prelude::*;

/// Runs the program with the words of the command line; its status.
#[pyfunction]
pub(crate) fn program(py: Python<'_>) -> PyResult<u8> {
    let words: Vec<OsString> = py.import("sys")?.getattr("argv")?.extract()?;
    // The interpreter is asleep as long as the program runs: it could not answer Ctrl-C.
    let signal = py.import("signal")?;
    let (interrupt, default) = (signal.getattr("SIGINT")?, signal.getattr("SIG_DFL")?);
    signal.call_method1("signal", (interrupt, default))?;
    let status = py.detach(|| sps::main(sps::NAME, words, sps::Command::run));
    io::stdout().flush()?;
    Ok(u8::from(status != ExitCode::SUCCESS))
}
