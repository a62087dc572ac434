//! Whatever bytes it is given, the reader answers within its limits; `fixtures/fuzz` says which.
#![cfg(feature = "onnx")]

#[path = "../../../fixtures/fuzz/mod.rs"]
mod fuzz;

use std::path::Path;

use fuzz::{Damage, damaged, fuzz, said};
use sps_onnx::{OnnxEncoder, Settings};

#[test]
fn files() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/onnx/tiny.onnx");
    let file = std::fs::read(path).unwrap();
    let image = vec![0.5; 3 * 16 * 16];
    fuzz("ONNX files", &Damage::some(), |damages| {
        let bytes = damaged(file.clone(), &damages);
        let encoder = said(OnnxEncoder::new("a.onnx", bytes, Settings::default()));
        if let Some(encoder) = encoder.filter(|encoder| encoder.size() <= 16)
            && let Some(values) = said(encoder.embed(&[&image], [16, 16]))
        {
            assert_eq!(values.len(), encoder.width());
        }
    });
}
