//! Models that are kept, and what they say of photographs.

mod support;

use std::path::PathBuf;

use image::{Rgb, RgbImage};
use serde_json::Value;
use support::{Scratch, expect, message, xtask};

/// The frames of the tiny dataset.
const SIDE: u32 = 32;

/// A scratch folder with a model in `model`, its config with `more` set.
fn fitted(more: &[&str]) -> Scratch {
    let scratch = Scratch::new();
    scratch.edit(
        "tiny.toml",
        "[cache]",
        "[train]\ncalibration = 0.5\nlevel = 0.5\n[cache]",
    );
    scratch.edit("tiny.toml", "validation = 0.34", "validation = 0.2");
    let mut train = xtask();
    train.arg("train").arg(scratch.path("tiny.toml"));
    for more in more {
        train.args(["--set", more]);
    }
    train
        .arg("--out")
        .arg(scratch.path("model"))
        .assert()
        .success();
    scratch
}

fn predict(scratch: &Scratch, options: &[&str], images: &[PathBuf]) -> assert_cmd::Command {
    let mut command = xtask();
    command.args(["predict", "--json", "--model"]);
    command
        .arg(scratch.path("model"))
        .args(options)
        .args(images);
    command
}

/// The first estimate, and the log.
fn estimate(mut command: assert_cmd::Command) -> (Value, String) {
    let output = command.assert().success().get_output().clone();
    let answer: Value = serde_json::from_slice(&output.stdout).unwrap();
    let log = String::from_utf8_lossy(&output.stderr).into_owned();
    (answer["estimates"][0].clone(), log)
}

#[test]
fn a_model_answers_for_a_photograph() {
    let scratch = fitted(&[]);
    let images = ["oak-01/002.jpg", "tile-01/002.exr"];
    let images = images.map(|name| scratch.path("data/frames").join(name));
    let of = |images: &[PathBuf]| estimate(predict(&scratch, &[], images)).0;
    let one = of(&images[..1]);
    let at = |key: &str| one[key].as_f64().unwrap();
    assert!(at("low") < at("value") && at("value") < at("high"), "{one}");
    let value = |estimate: &Value| estimate["value"].as_f64().unwrap();
    let (other, mean) = (of(&images[1..]), of(&images));
    assert!((value(&mean) - f64::midpoint(value(&one), value(&other))).abs() < 1e-9);
}

/// A photograph of the same surface with more pixels is brought to those of the model's frames.
#[test]
fn a_large_photograph_says_what_it_costs_and_how_to_resize() {
    let scratch = fitted(&[]);
    let photograph = |name: &str, side: u32| {
        let path = scratch.path(name);
        let block = |at: u32| at * SIDE / side / 4 % 2 * 200;
        let pixel = |x, y| Rgb([block(x) as u8, block(y) as u8, 90]);
        RgbImage::from_fn(side, side, pixel).save(&path).unwrap();
        [path]
    };
    let small = photograph("small.png", SIDE);
    let large = photograph("large.png", 30 * SIDE);
    let (expected, log) = estimate(predict(&scratch, &[], &small));
    assert!(!log.contains("pixels"), "{log}");
    let (_, log) = estimate(predict(&scratch, &[], &large));
    let resize = format!("`--resize {SIDE}`");
    expect(
        &log,
        &["large.png is 960 x 960 pixels", &resize, " s and ", " GB"],
    );
    let (resized, log) = estimate(predict(&scratch, &["--resize", "32"], &large));
    assert!(!log.contains("pixels"), "{log}");
    let value = |estimate: &Value| estimate["value"].as_f64().unwrap();
    // 8 bits, and a filter that is wider than a block of pixels.
    let moved = (value(&resized) - value(&expected)).abs();
    assert!(moved < 1.0, "{resized}, not {expected}");
}

/// What it was fitted on was computed in bf16.
#[test]
fn a_model_keeps_the_precision_of_its_encoder() {
    let scratch = fitted(&["encoder.precision=bf16"]);
    let image = [scratch.path("data/frames/oak-01/002.jpg")];
    let (in_bf16, _) = estimate(predict(&scratch, &[], &image));
    scratch.edit("model/model.json", "\"bf16\"", "\"f32\"");
    let (in_f32, _) = estimate(predict(&scratch, &[], &image));
    assert_ne!(in_bf16["value"], in_f32["value"]);
}

#[test]
fn a_model_that_resizes_is_not_resized() {
    let scratch = fitted(&["encoder.resize=16"]);
    let image = scratch.path("data/frames/oak-01/002.jpg");
    let refused = predict(&scratch, &["--resize", "24"], &[image]).assert();
    expect(&message(refused), &["--resize", "16 pixels"]);
}
