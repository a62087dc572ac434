//! Hashes the sources that decide what a trial comes to, so that finished trials and trained
//! encoders of other code are told apart (`SOURCE_HASH`).

mod sources;

use std::error::Error;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let repository = Path::new("../..");
    let (root, watched) = if repository.join("crates/sps-experiment").is_dir() {
        (repository, &sources::WATCHED[..])
    } else {
        (Path::new("."), &sources::PACKAGED[..])
    };
    println!(
        "cargo::rustc-env=SOURCE_HASH={}",
        sources::hash(root, watched)?
    );
    for watched in watched {
        println!("cargo::rerun-if-changed={}", root.join(watched).display());
    }
    Ok(())
}
