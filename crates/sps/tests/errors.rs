//! What can go wrong ends with status 1 and one clear message.

mod support;

use std::fs;
use std::path::Path;

use safetensors::tensor::{Dtype, TensorView};
use support::{Mounted, Scratch, expect, message, sps};

#[test]
fn a_missing_dataset() {
    let scratch = Scratch::new();
    scratch.edit("tiny.toml", "/data\"", "/nowhere\"");
    let text = message(scratch.experiment().assert());
    expect(&text, &["nowhere", "no such folder"]);
}

#[test]
fn a_missing_config() {
    let text = message(sps().args(["experiment", "configs/nothing.toml"]).assert());
    expect(&text, &["configs/nothing.toml"]);
}

#[test]
fn a_truncated_png() {
    let scratch = Scratch::new();
    let path = scratch.path("data/frames/denim-01/002.png");
    let bytes = fs::read(&path).unwrap();
    fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    expect(
        &message(scratch.experiment().assert()),
        &["denim-01/002.png"],
    );
    let inspected = message(
        sps()
            .arg("inspect")
            .arg(scratch.path("data"))
            .arg("--out")
            .arg(scratch.path("figures"))
            .assert(),
    );
    expect(&inspected, &["1 frames", "cannot be read"]);
}

#[test]
fn an_exr_cut_anywhere() {
    let scratch = Scratch::new();
    let path = scratch.path("data/frames/tile-01/002.exr");
    let bytes = fs::read(&path).unwrap();
    for part in 0..10 {
        fs::write(&path, &bytes[..bytes.len() * part / 10]).unwrap();
        expect(
            &message(scratch.experiment().assert()),
            &["tile-01/002.exr"],
        );
    }
}

#[test]
fn a_table_with_a_surface_twice() {
    let scratch = Scratch::new();
    scratch.edit("data/surfaces.csv", "denim-02,", "denim-01,");
    let text = message(scratch.experiment().assert());
    expect(&text, &["surfaces.csv", "line 3", "denim-01"]);
}

#[test]
fn an_unknown_property() {
    let scratch = Scratch::new();
    scratch.edit("data/tactile.csv", "fRS", "fRX");
    let text = message(scratch.experiment().assert());
    expect(&text, &["tactile.csv", "fRX"]);
    let scratch = Scratch::new();
    scratch.edit("tiny.toml", "\"cDF\"", "\"cDX\"");
    let text = message(scratch.experiment().assert());
    expect(
        &text,
        &["`properties`", "`cDX`", "did you mean `cDF`?", "of tiny"],
    );
}

#[test]
fn a_text_where_a_number_belongs() {
    let scratch = Scratch::new();
    let path = scratch.path("data/tactile.csv");
    let table = fs::read_to_string(&path).unwrap();
    let (header, rows) = table.split_once('\n').unwrap();
    let (first, rest) = rows.split_once('\n').unwrap();
    let cells: Vec<&str> = first.split(',').collect();
    let spoilt = [&cells[..3], &["rough"], &cells[4..]].concat().join(",");
    fs::write(&path, format!("{header}\n{spoilt}\n{rest}")).unwrap();
    let text = message(scratch.experiment().assert());
    expect(&text, &["tactile.csv", "line 2", "rough", "number"]);
}

#[test]
fn a_misspelt_key() {
    let scratch = Scratch::new();
    scratch.edit("tiny.toml", "level", "levels");
    let text = message(scratch.experiment().assert());
    expect(&text, &["tiny.toml, line 17", "did you mean `level`?"]);
    let text = message(
        Scratch::new()
            .experiment()
            .args(["--set", "head.epoch=3"])
            .assert(),
    );
    expect(&text, &["--set head.epoch", "did you mean `epochs`?"]);
}

/// Writes the encoder's weights with one tensor taken away or misshapen.
fn spoilt_weights(path: &Path, spoil: impl Fn(&str, &mut Vec<usize>) -> bool) {
    let encoder = sps_models::encoders::Encoder::seeded(
        sps_models::encoders::EncoderKind::EfficientNetLiteBody,
        0,
    );
    let encoder = encoder.unwrap();
    let mut tensors = Vec::new();
    for (name, tensor) in encoder.weights().iter() {
        let mut shape = tensor.dims().to_vec();
        if spoil(name, &mut shape) {
            let length: usize = shape.iter().product();
            tensors.push((name.to_owned(), shape, vec![0; 4 * length]));
        }
    }
    let views = tensors.iter().map(|(name, shape, bytes)| {
        (
            name,
            TensorView::new(Dtype::F32, shape.clone(), bytes).unwrap(),
        )
    });
    fs::write(path, safetensors::serialize(views, None).unwrap()).unwrap();
}

#[test]
fn weights_that_do_not_fit() {
    let scratch = Scratch::new();
    let weights = scratch.path("weights.safetensors");
    scratch.edit("tiny.toml", "untrained", &weights.display().to_string());
    spoilt_weights(&weights, |name, _| name != "conv_stem.weight");
    let text = message(scratch.experiment().assert());
    expect(
        &text,
        &["weights.safetensors", "conv_stem.weight", "missing"],
    );
    spoilt_weights(&weights, |name, shape| {
        if name == "conv_stem.weight" {
            shape[1] += 1;
        }
        true
    });
    let text = message(scratch.experiment().assert());
    expect(
        &text,
        &["weights.safetensors", "conv_stem.weight", "[", "expected"],
    );
}

#[test]
fn a_full_disk_loses_nothing_that_was_written() {
    let scratch = Scratch::new();
    let run = scratch.path("run");
    let Some(mounted) = Mounted::new(&run, "size=32k") else {
        return;
    };
    let text = message(scratch.experiment().assert());
    expect(&text, &["run/", "No space left"]);
    let kept = fs::read_to_string(run.join("trials.jsonl")).unwrap();
    assert_eq!(kept.lines().count(), 8, "{kept}");
    mounted.remount("size=10m");
    scratch.experiment().assert().success();
    assert_eq!(fs::read_to_string(run.join("trials.jsonl")).unwrap(), kept);
    assert_eq!(scratch.results()["methods"].as_array().unwrap().len(), 2);
}

#[test]
fn a_full_disk_leaves_whole_lines() {
    let mut filled = 0;
    for kib in [12, 24, 36] {
        let scratch = Scratch::new();
        let run = scratch.path("run");
        let Some(_mounted) = Mounted::new(&run, &format!("size={kib}k")) else {
            return;
        };
        let mut many = scratch.experiment();
        let text = message(many.args(["--set", "reruns=20"]).assert());
        filled += usize::from(text.contains("cannot add to"));
        let kept = fs::read_to_string(run.join("trials.jsonl")).unwrap_or_default();
        assert!(kept.is_empty() || kept.ends_with('\n'), "{kib} KiB: {kept}");
        for line in kept.lines() {
            assert!(
                serde_json::from_str::<serde_json::Value>(line).is_ok(),
                "{line}"
            );
        }
    }
    assert!(filled > 0, "no disk was full while trials were added");
}

#[test]
fn a_read_only_output_folder() {
    let scratch = Scratch::new();
    let run = scratch.path("run");
    let Some(_mounted) = Mounted::new(&run, "ro") else {
        return;
    };
    let text = message(scratch.experiment().assert());
    expect(&text, &["run", "Read-only file system"]);
}
