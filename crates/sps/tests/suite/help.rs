//! What the program says of itself.

use crate::support::{Ends, Scratch, expect};

#[test]
fn examples_say_what_to_type() {
    let commands = "fit predict map suggest serve experiment compare simulate import inspect embed \
        report list completions man";
    let scratch = Scratch::empty();
    for command in commands.split(' ') {
        let text = scratch.sps(&format!("{command} --help")).said();
        expect(&text, &format!("Usage: sps {command} ; \n  sps {command} "));
        assert!(!text.contains("cargo xtask"), "{text}");
    }
}
