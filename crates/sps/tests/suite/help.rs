//! What the program says of itself.

use crate::support::{Ends, sps};

#[test]
fn examples_say_what_to_type() {
    for command in
        "fit predict map suggest serve experiment compare simulate import inspect embed report list completions man"
            .split(' ')
    {
        let text = sps().args([command, "--help"]).said();
        for part in [
            format!("Usage: sps {command} "),
            format!("\n  sps {command} "),
        ] {
            assert!(text.contains(&part), "{text}");
        }
        assert!(!text.contains("cargo xtask"), "{text}");
    }
}
