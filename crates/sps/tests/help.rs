//! What the program says of itself.

mod support;

use support::sps;

#[test]
fn examples_say_what_to_type() {
    for command in
        "fit predict map suggest serve experiment compare simulate import inspect embed report list completions man"
            .split(' ')
    {
        let output = sps().args([command, "--help"]).assert().success();
        let text = String::from_utf8_lossy(&output.get_output().stdout).into_owned();
        for part in [
            format!("Usage: sps {command} "),
            format!("\n  sps {command} "),
        ] {
            assert!(text.contains(&part), "{text}");
        }
        assert!(!text.contains("cargo xtask"), "{text}");
    }
}
