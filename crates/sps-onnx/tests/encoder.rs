//! What networks give, and which files are refused.
#![cfg(feature = "onnx")]

use std::path::{Path, PathBuf};

use sps_onnx::{ErrorKind, OnnxEncoder, Settings};

/// `fixtures/onnx/make.py` writes the network and prints what PyTorch makes of the image: the output `pooled`,
/// then the means of `tokens` and of `map`.
const PYTORCH: [f32; 11] = [
    0.601_380_8,
    -1.879_556_9,
    -1.218_666_1,
    -0.324_826_15,
    0.741_286_8,
    0.254_924_27,
    0.883_534_85,
    0.174_072_56,
    0.535_653_9,
    0.237_788_77,
    0.395_522_65,
];

fn fixture() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/onnx/tiny.onnx")
}

/// The image of `make.py`: 20 rows of 16 pixels.
fn image() -> Vec<f32> {
    let value = |i: usize| ((i * i * 31 + i * 17) % 255) as f32 / 254.0;
    (0..20 * 16 * 3).map(value).collect()
}

fn with(settings: Settings) -> Result<OnnxEncoder, String> {
    OnnxEncoder::read(&fixture(), settings).map_err(|error| error.to_string())
}

#[test]
fn outputs_are_those_of_pytorch_averaged() {
    let encoder = with(Settings::default()).unwrap();
    let named = [("pooled", 3), ("tokens", 4), ("map", 4)];
    let named = named.map(|(name, width)| (name.to_owned(), width));
    assert_eq!(encoder.blocks(), named);
    let found = (encoder.file(), encoder.size(), encoder.width());
    assert_eq!(found, ("tiny.onnx", 16, 11));
    let black = vec![0.0; 20 * 16 * 3];
    let embedded = encoder.embed(&[&black, &image()], [20, 16]).unwrap();
    for (found, expected) in embedded[11..].iter().zip(PYTORCH) {
        assert!((found - expected).abs() < 1e-6, "{found}, {expected}");
    }
    let alone = encoder.embed(&[&image()], [20, 16]).unwrap();
    assert_eq!(alone, embedded[11..]);

    let outputs = vec!["map".to_owned(), "pooled".to_owned()];
    let some = with(Settings {
        outputs,
        ..Settings::default()
    });
    let some = some.unwrap().embed(&[&image()], [20, 16]).unwrap();
    assert_eq!(some, [&embedded[18..], &embedded[11..14]].concat());
}

#[test]
fn settings_and_images_that_do_not_fit_are_refused() {
    let said = |change: fn(&mut Settings), parts: &[&str]| {
        let mut settings = Settings::default();
        change(&mut settings);
        let message = with(settings).unwrap_err();
        assert!(parts.iter().all(|part| message.contains(part)), "{message}");
    };
    let names = [
        "tiny.onnx: outputs: found `",
        "each once of pooled, tokens, map",
    ];
    said(|s| s.outputs = vec!["tokns".to_owned()], &names);
    said(|s| s.outputs = vec!["map".to_owned(); 2], &names);
    let own = "size: found 17, expected the file's, 16";
    said(|s| s.size = Some(17), &[own]);
    said(|s| s.std = [0.0; 3], &["mean and std", "above 0"]);
    let encoder = with(Settings::default()).unwrap();
    for size in [[15, 64], [20, 17]] {
        let error = encoder.embed(&[&image()], size).unwrap_err().to_string();
        assert!(error.contains("sides of at least 16"), "{error}");
    }
}

fn refused(bytes: &[u8], part: &str) {
    let error = OnnxEncoder::new("a.onnx", bytes, Settings::default()).unwrap_err();
    assert!(error.to_string().contains(part), "{error}");
    assert!(!matches!(error.kind(), ErrorKind::Panicked(_)), "{error}");
}

#[test]
fn an_unknown_operator_is_named() {
    let bytes = std::fs::read(fixture()).unwrap();
    // The operator's type, field 4 of its node.
    let kind = field(4, b"Softmax");
    let mut windows = bytes.windows(kind.len());
    let at = windows.position(|part| part == kind).unwrap();
    let rest = &bytes[at + kind.len()..];
    let changed = [&bytes[..at], &field(4, b"Softmix"), rest].concat();
    refused(&changed, "Softmix operator not supported");
}

/// A field of a message of Protocol Buffers, its content of any length.
fn field(number: u8, content: &[u8]) -> Vec<u8> {
    let mut bytes = vec![number << 3 | 2];
    let mut length = content.len();
    while length >= 0x80 {
        bytes.push(length as u8 | 0x80);
        length >>= 7;
    }
    bytes.push(length as u8);
    [&bytes, content].concat()
}

#[test]
fn files_that_take_more_than_they_hold_are_refused() {
    refused(b"", "no operator");
    refused(b"GIF89a", "not an ONNX file");
    // Raw data of 2^60 bytes, of which there is none.
    let length = [0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x10];
    let tensor = [&[9 << 3 | 2][..], &length].concat();
    refused(&field(7, &field(5, &tensor)), "cut off");
    refused(
        &field(7, &[0x0a, 0].repeat(5 << 20)),
        "more than 4194304 parts",
    );
    // Graphs within graphs, and sequences of sequences.
    let graph = |inside: Vec<u8>| field(1, &field(5, &field(6, &inside)));
    let nested = (0..1_000).fold(Vec::new(), |inside, _| graph(inside));
    refused(&field(7, &nested), "a graph within a graph");
    let sequences = (0..1_000).fold(Vec::new(), |inside, _| field(4, &field(1, &inside)));
    refused(&field(7, &field(11, &field(2, &sequences))), "a sequence");
    // A stride of 2^40, and a constant of 2^40 among an operator's inputs.
    let large = [0x80, 0x80, 0x80, 0x80, 0x80, 0x80 - 0x60];
    let node = [field(4, b"Conv"), field(5, &field(8, &large))].concat();
    refused(
        &field(7, &field(1, &node)),
        "Conv: found the number 1099511627776",
    );
    let constant = [
        &[2 << 3, 7][..],
        &field(8, b"a"),
        &field(9, &(1_u64 << 40).to_le_bytes()),
    ];
    let node = [field(4, b"Expand"), field(1, b"a")].concat();
    let graph = [field(5, &constant.concat()), field(1, &node)].concat();
    refused(&field(7, &graph), "Expand: found the number 1099511627776");
    // Weights in another file.
    refused(&field(7, &field(5, &[14 << 3, 1])), "external_data=False");
}
