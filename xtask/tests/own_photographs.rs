//! From a folder of photographs and a table of two measured columns to a dataset, an experiment, a model
//! and a map.

mod support;

use std::fmt::Write;
use std::fs;
use std::path::Path;

use assert_cmd::Command;
use image::{Rgb, RgbImage};
use serde_json::Value;
use support::{expect, method, xtask};

/// Pixels of a photograph's side.
const SIDE: u32 = 64;

/// A number from 0 to 1 that is another for each `at` (SplitMix64).
fn share(at: u64) -> f64 {
    let mixed = (at + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((mixed ^ (mixed >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

/// A hard surface is bright, one of high friction is grainy.
fn photograph(width: u32, number: u64, friction: f64, hardness: f64) -> RgbImage {
    RgbImage::from_fn(width, SIDE, |x, y| {
        let grain = share((number << 32) + u64::from(y * width + x)) - 0.5;
        let level = (40.0 + 15.0 * hardness + 120.0 * friction * grain).clamp(0.0, 255.0) as u8;
        Rgb([level, level, level / 2 + 60])
    })
}

/// A hundred photographs of fifty sheets, two of each, and what was measured on the sheets.
fn lay_out(folder: &Path) {
    fs::create_dir(folder.join("photographs")).unwrap();
    let mut table = "photograph,group,friction,hardness\n".to_owned();
    for number in 0..100 {
        let sheet = number / 2;
        let friction = 0.1 + 0.8 * share(2 * sheet);
        let hardness = 1.0 + 8.0 * share(2 * sheet + 1);
        let name = format!("{number:03}.png");
        photograph(SIDE, number, friction, hardness)
            .save(folder.join("photographs").join(&name))
            .unwrap();
        // One is not measured.
        let hardness = if number == 7 {
            String::new()
        } else {
            format!("{hardness:.3}")
        };
        writeln!(table, "{name},sheet-{sheet},{friction:.3},{hardness}").unwrap();
    }
    fs::write(folder.join("values.csv"), table).unwrap();
}

/// What a command that succeeds prints.
fn printed(mut command: Command) -> String {
    let done = command.assert().success();
    String::from_utf8(done.get_output().stdout.clone()).unwrap()
}

#[test]
fn photographs_of_ones_own_become_a_model() {
    let scratch = tempfile::tempdir().unwrap();
    let path = |name: &str| scratch.path().join(name);
    lay_out(scratch.path());

    let mut import = xtask();
    import.arg("import").arg(path("photographs"));
    import.arg("--values").arg(path("values.csv"));
    import.arg("--out").arg(path("mine"));
    expect(
        &printed(import),
        &["100 surfaces in 50 groups", "friction, hardness"],
    );

    let mut inspect = xtask();
    inspect.arg("inspect").arg(path("mine")).arg("--json");
    inspect.arg("--out").arg(path("figures"));
    let found: Value = serde_json::from_str(&printed(inspect)).unwrap();
    assert_eq!(
        (&found["surfaces"], &found["groups"]),
        (&100.into(), &50.into())
    );

    let configured = |command: &str, out: &str| {
        let mut configured = xtask();
        configured.args([command, "configs/own-photographs.toml"]);
        for (key, folder) in [("data.folder.path", "mine"), ("cache.folder", "cache")] {
            let setting = format!("{key}={:?}", path(folder).display().to_string());
            configured.args(["--set", &setting]);
        }
        configured.arg("--out").arg(path(out));
        configured
    };
    let mut experiment = configured("experiment", "run");
    experiment.args(["--set", "reruns=2"]);
    experiment.assert().success();
    let results = fs::read_to_string(path("run/results.json")).unwrap();
    let results: Value = serde_json::from_str(&results).unwrap();
    assert_eq!(
        results["properties"],
        serde_json::json!(["friction", "hardness"])
    );
    // Brightness and grain are plain to see, also on sheets that were held out.
    for property in ["friction", "hardness"] {
        let r2 = &method(&results, "kernel-ridge")["r2"][property];
        assert!(r2.as_f64().unwrap() > 0.5, "{property}: {r2}");
    }

    configured("train", "model").assert().success();
    photograph(4 * SIDE, 1000, 0.5, 8.0)
        .save(path("hard.png"))
        .unwrap();
    photograph(SIDE, 1001, 0.5, 2.0)
        .save(path("soft.png"))
        .unwrap();
    let model = || {
        let mut predict = xtask();
        predict.arg("predict").arg("--model").arg(path("model"));
        predict
    };
    let mut predict = model();
    predict
        .arg("--json")
        .args(["hard.png", "soft.png"].map(path));
    let answers = printed(predict);
    let hardness = |line: &str| {
        let answer: Value = serde_json::from_str(line).unwrap();
        let mut estimates = answer["estimates"].as_array().unwrap().iter();
        let found = estimates.find(|estimate| estimate["property"] == "hardness");
        found.unwrap()["value"].as_f64().unwrap()
    };
    let [hard, soft] = [0, 1].map(|line| hardness(answers.lines().nth(line).unwrap()));
    assert!(hard > soft + 2.0, "{answers}");

    let mut map = model();
    map.args(["--map", "hardness", "--out"]).arg(path("maps"));
    map.args(["--resize", "256"]).arg(path("hard.png"));
    expect(&printed(map), &["hard-hardness.png", "places"]);
    assert!(path("maps/hard-hardness.npy").is_file());
}
