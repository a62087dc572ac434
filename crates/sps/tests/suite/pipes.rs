//! A pipe that nobody reads any more, as `head` leaves one behind, ends a command quietly.

use std::io::pipe;
use std::os::unix::process::ExitStatusExt;
use std::process::Stdio;

use crate::support::{Scratch, fit};

const SIGPIPE: i32 = 13;

/// Runs the command with its output into a closed pipe.
fn closed(scratch: &Scratch, line: &str) {
    let (reader, writer) = pipe().unwrap();
    drop(reader);
    let mut command = scratch.process(line);
    command.stdout(writer).stderr(Stdio::piped());
    let output = command.output().unwrap();
    let log = String::from_utf8_lossy(&output.stderr);
    let signal = output.status.signal();
    assert_eq!(signal, Some(SIGPIPE), "{line}: {log}");
    for word in ["panicked", "error", "roken pipe"] {
        assert!(!log.contains(word), "{line}: {log}");
    }
}

#[test]
fn closed_pipes_end_commands_quietly() {
    let scratch = Scratch::new();
    let closed = |line: &str| closed(&scratch, line);
    closed("--help");
    closed("experiment @tiny.toml --list");
    closed("inspect @data --out @figures");
    closed("inspect @data --json --out @figures");
    closed("fit --config @tiny.toml --out @model");
    fit(&scratch, &["train.method=ridge"]).assert().success();
    let photograph = "@data/frames/oak-01/002.jpg";
    for form in ["", "--json", "--csv"] {
        closed(&format!("predict @model {photograph} {form}"));
    }
    closed(&format!("map @model fRS {photograph} --out @figures"));
}
