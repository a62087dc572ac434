//! The program `sps`.

use std::env;
use std::process::ExitCode;

use sps::Command;
use sps_base::memory::CountingAllocator;

/// Counts what an estimate allocates, which results say.
#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

fn main() -> ExitCode {
    sps::main(sps::NAME, env::args_os(), Command::run)
}
