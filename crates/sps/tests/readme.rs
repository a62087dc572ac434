//! The program in README.md is one that runs.

mod support;

use std::fs;
use std::process::Command;

use support::{root, sps};

#[test]
fn the_program_of_the_readme_runs() {
    let readme = fs::read_to_string(root().join("README.md")).unwrap();
    let program = readme
        .split_once("```rust\n")
        .unwrap()
        .1
        .split_once("```")
        .unwrap()
        .0;
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
    train
        .arg("--out")
        .arg(folder.path().join("models/smoke"))
        .assert()
        .success();

    // Built with the tests of the workspace, not with those of this package alone.
    let tests = std::env::current_exe().unwrap();
    let built = tests
        .parent()
        .unwrap()
        .parent()
        .unwrap()
        .join("examples/predict");
    if !built.exists() {
        println!("SKIPPED: {} is not built", built.display());
        return;
    }
    let output = Command::new(built)
        .current_dir(folder.path())
        .output()
        .unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(
        output.status.success() && text.contains("sliding resistance"),
        "{text}"
    );
}
