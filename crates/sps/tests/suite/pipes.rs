//! A pipe that nobody reads any more, as `head` leaves one behind, ends a command quietly.

use std::io::pipe;
use std::os::unix::process::ExitStatusExt;
use std::process::Command;

use crate::support::{Scratch, root};

const SIGPIPE: i32 = 13;

/// Runs the command with its output into a closed pipe.
fn closed(arguments: &[&str]) {
    let (reader, writer) = pipe().unwrap();
    drop(reader);
    let mut command = Command::new(env!("CARGO_BIN_EXE_sps"));
    command.current_dir(root()).args(arguments).stdout(writer);
    let output = command.env_remove("RUST_LOG").output().unwrap();
    let log = String::from_utf8_lossy(&output.stderr);
    let signal = output.status.signal();
    assert_eq!(signal, Some(SIGPIPE), "{arguments:?}: {log}");
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
    let line = "fit --config @tiny.toml --out @model --set train.method=ridge";
    scratch.sps(line).assert().success();
    for form in [&[][..], &["--json"], &["--csv"]] {
        let ask = ["predict", &model, &photograph];
        closed(&[&ask[..], form].concat());
    }
    closed(&["map", &model, "fRS", &photograph, "--out", &figures]);
}
