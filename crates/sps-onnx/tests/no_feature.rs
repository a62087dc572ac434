//! Without the feature every file is refused, and the message says what would read it.
#![cfg(not(feature = "onnx"))]

use sps_onnx::{OnnxEncoder, Settings};

#[test]
fn a_build_that_reads_no_files_says_so() {
    let error = OnnxEncoder::new("dino.onnx", [], Settings::default()).unwrap_err();
    let expected =
        "dino.onnx: found an ONNX file, expected a build with the feature `onnx`, which reads them";
    assert_eq!(error.to_string(), expected);
}
