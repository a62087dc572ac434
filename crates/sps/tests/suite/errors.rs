//! What can go wrong ends with status 1 and one clear message.

use std::collections::HashMap;
use std::fs;

use crate::support::{Ends, Mounted, Scratch, cases, tree};
use sps_models::encoders::{Encoder, EncoderKind};

/// A line for each: the file, what stands there, what is put there, and what the message of `experiment` has.
const EDITED: &str = r#"
tiny.toml | /data" | /nowhere" | nowhere; no such folder
tiny.toml | level | levels | tiny.toml, line 19; did you mean `level`?
tiny.toml | "cDF" | "cDX" | `properties`; `cDX`; did you mean `cDF`?; of tiny
data/surfaces.csv | denim-02, | denim-01, | surfaces.csv; line 3; denim-01
data/tactile.csv | fRS | fRX | tactile.csv; fRX
data/tactile.csv | 41.45 | rough | tactile.csv; line 2; rough; number
"#;

#[test]
fn what_was_edited_wrongly() {
    for line in EDITED.trim().lines() {
        let scratch = Scratch::new();
        let [name, from, to, parts] = line.split(" | ").collect::<Vec<_>>()[..] else {
            panic!("{line}");
        };
        scratch.edit(name, from, to);
        scratch.is_refused(parts);
    }
}

/// A line for each: what is typed, and what the message has.
const TYPED: &str = "
experiment configs/nothing.toml | configs/nothing.toml
experiment @tiny.toml --set head.epoch=3 | --set head.epoch; did you mean `epochs`?
experiment @tiny.toml --out @run --set methods.ridge.views=9 | method `ridge`; 9 views; at most 5
experiment configs/end-to-end.toml --list --set encoder.training.adam.learning-rate=-1 | learning-rate; above 0
report @empty | is not the folder of a run
suggest @empty | empty has no photograph
";

#[test]
fn what_was_typed_wrongly() {
    let scratch = Scratch::new();
    fs::create_dir(scratch.path("empty")).unwrap();
    for (line, parts) in cases(TYPED) {
        scratch.sps(&line).refused(parts);
    }
    assert_eq!(tree(&scratch.path("empty")).len(), 0);
}

#[test]
fn images_cut_anywhere() {
    let scratch = Scratch::new();
    for name in ["denim-01/002.png", "tile-01/002.exr"] {
        let frame = format!("data/frames/{name}");
        let bytes = scratch.bytes(&frame);
        for part in 0..10 {
            scratch.write(&frame, &bytes[..bytes.len() * part / 10]);
            scratch.is_refused(name);
        }
        let mut inspect = scratch.sps("inspect @data --out @figures");
        inspect.refused("1 frames; cannot be read");
        scratch.write(&frame, bytes);
    }
}

#[test]
fn weights_that_do_not_fit() {
    const NAME: &str = "features.0.weight";
    let scratch = Scratch::new();
    let file = scratch.path("weights.safetensors");
    scratch.edit("tiny.toml", "untrained", &file.display().to_string());
    let encoder = Encoder::seeded(EncoderKind::SqueezeNet1_1, 0).unwrap();
    let all = encoder.weights().iter();
    let mut weights: HashMap<_, _> = all.map(|(name, tensor)| (name, tensor.clone())).collect();
    let conv = weights.remove(NAME).unwrap();
    candle_core::safetensors::save(&weights, &file).unwrap();
    scratch.is_refused("weights.safetensors; features.0.weight; missing");
    weights.insert(NAME, conv.pad_with_zeros(1, 0, 1).unwrap());
    candle_core::safetensors::save(&weights, &file).unwrap();
    scratch.is_refused("weights.safetensors; features.0.weight; [; expected");
}

#[test]
fn a_full_disk_loses_nothing_that_was_written() {
    let scratch = Scratch::new();
    let run = scratch.path("run");
    let Some(mounted) = Mounted::new(&run, "size=32k") else {
        return;
    };
    scratch.is_refused("run/; No space left");
    let kept = scratch.read("run/trials.jsonl");
    assert_eq!(kept.lines().count(), 8, "{kept}");
    mounted.remount("size=10m");
    scratch.experiment().assert().success();
    assert_eq!(scratch.read("run/trials.jsonl"), kept);
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
        let text = scratch.experiment().set(&["reruns=20"]).message();
        filled += usize::from(text.contains("cannot add to"));
        let kept = fs::read_to_string(run.join("trials.jsonl")).unwrap_or_default();
        assert!(kept.is_empty() || kept.ends_with('\n'), "{kib} KiB: {kept}");
        for line in kept.lines() {
            serde_json::from_str::<serde_json::Value>(line).expect(line);
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
    scratch.is_refused("run; Read-only file system");
}
