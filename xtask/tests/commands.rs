//! `cargo xtask` has the commands of `sps`, under its own name.

use std::process::Command;

fn help(arguments: &[&str]) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_xtask"));
    let output = command.args(arguments).arg("--help").output().unwrap();
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn commands_of_sps_stand_beside_its_own() {
    let text = help(&[]);
    for command in ["experiment", "predict", "pretrain", "docs", "bench"] {
        assert!(text.contains(&format!("\n  {command} ")), "{text}");
    }
}

#[test]
fn examples_say_what_to_type() {
    let commands = "experiment compare simulate import inspect embed fit";
    for command in commands.split(' ') {
        let text = help(&[command]);
        for before in ["\n  ", "Usage: "] {
            let example = format!("{before}cargo xtask {command} ");
            assert!(text.contains(&example), "{text}");
        }
        assert!(!text.contains("\n  sps "), "{text}");
    }
}
