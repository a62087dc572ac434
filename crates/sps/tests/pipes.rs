//! A pipe that nobody reads any more, as `head` leaves one behind, ends a command quietly.
#![cfg(unix)]

mod support;

use std::io::pipe;
use std::os::unix::process::ExitStatusExt;
use std::process::Command;

use support::{Scratch, root};

const SIGPIPE: i32 = 13;

/// Runs the command with its output into a closed pipe.
fn closed(arguments: &[&str]) {
    let (reader, writer) = pipe().unwrap();
    drop(reader);
    let mut command = Command::new(env!("CARGO_BIN_EXE_sps"));
    command.current_dir(root()).args(arguments).stdout(writer);
    let output = command.env_remove("RUST_LOG").output().unwrap();
    let log = String::from_utf8_lossy(&output.stderr);
    assert_eq!(
        output.status.signal(),
        Some(SIGPIPE),
        "{arguments:?}: {log}"
    );
    for word in ["panicked", "error", "roken pipe"] {
        assert!(!log.contains(word), "{arguments:?}: {log}");
    }
}

#[test]
fn closed_pipes_end_commands_quietly() {
    let scratch = Scratch::new();
    let path = |name: &str| scratch.path(name).display().to_string();
    let [config, data, model, figures] = ["tiny.toml", "data", "model", "figures"].map(path);
    let photograph = path("data/frames/oak-01/002.jpg");
    closed(&["--help"]);
    closed(&["experiment", &config, "--list"]);
    closed(&["inspect", &data, "--out", &figures]);
    closed(&["inspect", &data, "--json", "--out", &figures]);
    closed(&["fit", "--config", &config, "--out", &model]);
    let mut fit = support::sps();
    fit.args([
        "fit",
        "--config",
        &config,
        "--out",
        &model,
        "--set",
        "train.method=ridge",
    ]);
    fit.assert().success();
    for form in [&[][..], &["--json"], &["--csv"]] {
        let ask = ["predict", &model, &photograph];
        closed(&[&ask[..], form].concat());
    }
    closed(&["map", &model, "fRS", &photograph, "--out", &figures]);
}
