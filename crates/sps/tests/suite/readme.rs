//! The program in README.md is one that runs.

use std::fs;

use crate::support::{Ends, Scratch, copy, expect, root};
use assert_cmd::Command;

#[test]
fn the_program_of_the_readme_runs() {
    let readme = fs::read_to_string(root().join("README.md")).unwrap();
    let (_, program) = readme.split_once("```rust\n").unwrap();
    let (program, _) = program.split_once("```").unwrap();

    let example = root().join("crates/sps-estimator/examples/predict.rs");
    assert_eq!(program, fs::read_to_string(example).unwrap());

    let scratch = Scratch::empty();
    let frames = "fixtures/tiny-dataset/frames/oak-01";
    copy(&root().join(frames), &scratch.path(frames));
    let line = "fit --config configs/smoke.toml --set cache.folder=@cache --out @models/smoke";
    scratch.sps(line).assert().success();

    // Built with the tests of the workspace, not with those of this package alone.
    let tests = std::env::current_exe().unwrap();
    let built = tests.ancestors().nth(2).unwrap().join("examples/predict");
    if !built.exists() {
        println!("SKIPPED: {} is not built", built.display());
        return;
    }
    let said = Command::new(built).current_dir(scratch.path(".")).said();
    expect(&said, "sliding resistance");
}
