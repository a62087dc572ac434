//! Draws that a killed program goes on with where it was: each is fixed by its index, and what is kept is kept whole.
//!
//! `cargo run --example resume FOLDER`, any number of times, and killed at any moment.

use std::path::Path;
use std::time::Duration;
use std::{env, fs, io};

use sps_base::streams::{below, stream};
use sps_base::{files, names};

fn main() -> io::Result<()> {
    let folder = env::args().nth(1);
    let folder = folder.map_or_else(|| env::temp_dir().join("sps-base-resume"), Into::into);
    let done = kept(&folder)?;
    for throw in done..done + 3 {
        let face = 1 + below(&mut stream(7, *b"example 1: throws of die", throw), 6);
        let line = format!("throw {throw}: {face}\n");
        print!("{line}");
        files::write_file(&folder.join(format!("{throw}.txt")), line.as_bytes())?;
    }
    let nearest = names::nearest("fases", ["throws", "faces", "folder"]);
    println!(
        "`fases` is probably `{}`",
        nearest.unwrap_or("nothing known")
    );
    Ok(())
}

/// How many throws are kept; what was being written when the program was killed is removed.
fn kept(folder: &Path) -> io::Result<u64> {
    fs::create_dir_all(folder)?;
    files::remove_unfinished(folder, Duration::ZERO)?;
    Ok(fs::read_dir(folder)?.count() as u64)
}
