//! The program in README.md is one that runs.

use std::fs;
use std::process::Command;

use crate::support::{expect, root, sps};

#[test]
fn the_program_of_the_readme_runs() {
    let readme = fs::read_to_string(root().join("README.md")).unwrap();
    let (_, program) = readme.split_once("```rust\n").unwrap();
    let (program, _) = program.split_once("```").unwrap();

    let example = root().join("crates/sps-estimator/examples/predict.rs");
    assert_eq!(program, fs::read_to_string(example).unwrap());

    let folder = tempfile::tempdir().unwrap();
    let photograph = "fixtures/tiny-dataset/frames/oak-01/002.jpg";
    let to = folder.path().join(photograph);
    fs::create_dir_all(to.parent().unwrap()).unwrap();
    fs::copy(root().join(photograph), to).unwrap();
    let cache = format!("cache.folder={:?}", folder.path().join("cache"));
    let mut train = sps();
    train.args(["fit", "--config", "configs/smoke.toml", "--set", &cache]);
    train.arg("--out").arg(folder.path().join("models/smoke"));
    train.assert().success();

    // Built with the tests of the workspace, not with those of this package alone.
    let tests = std::env::current_exe().unwrap();
    let built = tests.ancestors().nth(2).unwrap().join("examples/predict");
    if !built.exists() {
        println!("SKIPPED: {} is not built", built.display());
        return;
    }
    let output = Command::new(built)
        .current_dir(folder.path())
        .output()
        .unwrap();
    assert!(output.status.success());
    expect(
        &String::from_utf8(output.stdout).unwrap(),
        &["sliding resistance"],
    );
}
