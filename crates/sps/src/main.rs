//! The program `sps`.

use std::env;
use std::process::ExitCode;

use peak_alloc::PeakAlloc;
use sps::Command;

/// Counts what work allocates, which results say.
#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

fn main() -> ExitCode {
    sps::main(sps::NAME, env::args_os(), Command::run)
}
