//! Hashes the sources that decide what a trial comes to, so that finished trials and trained
//! encoders of other code are told apart (`SOURCE_HASH`).

mod sources;

use std::error::Error;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let hash = sources::hash(Path::new(".."))?;
    println!("cargo::rustc-env=SOURCE_HASH={hash}");
    for watched in sources::WATCHED {
        println!("cargo::rerun-if-changed=../{watched}");
    }
    Ok(())
}
