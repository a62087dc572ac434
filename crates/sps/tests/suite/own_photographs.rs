//! From a folder of photographs and a table of two measured columns to a model and a map.

use std::fmt::Write;
use std::fs;

use crate::support::{Ends, Scratch, expect, root, rows};
use image::{Rgb, RgbImage};
use serde_json::Value;
use sps_estimator::Estimator;

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
fn laid_out() -> Scratch {
    let scratch = Scratch::empty();
    fs::create_dir(scratch.path("photographs")).unwrap();
    let mut table = "photograph,group,friction,hardness\n".to_owned();
    for number in 0..100 {
        let sheet = number / 2;
        let friction = 0.1 + 0.8 * share(2 * sheet);
        let hardness = 1.0 + 8.0 * share(2 * sheet + 1);
        let name = format!("{number:03}.png");
        let photograph = photograph(SIDE, number, friction, hardness);
        let path = scratch.path("photographs").join(&name);
        photograph.save(path).unwrap();
        // One is not measured.
        let hardness = format!("{hardness:.3}").repeat(usize::from(number != 7));
        writeln!(table, "{name},sheet-{sheet},{friction:.3},{hardness}").unwrap();
    }
    scratch.write("values.csv", table);
    scratch
}

/// The commands of the README's section on one's own photographs, without `cargo xtask`.
fn commands_of_the_readme() -> Vec<String> {
    let readme = fs::read_to_string(root().join("README.md")).unwrap();
    let (_, section) = readme.split_once("## On your own photographs").unwrap();
    let (_, lines) = section.split_once("```sh\n").unwrap();
    let (lines, _) = lines.split_once("```").unwrap();
    let command = |line: &str| line.strip_prefix("cargo xtask ").unwrap().to_owned();
    lines.lines().map(command).collect()
}

#[test]
fn photographs_of_ones_own_become_a_model_by_the_lines_of_the_readme() {
    let scratch = laid_out();
    let one = photograph(4 * SIDE, 1000, 0.5, 8.0);
    one.save(scratch.path("photograph.jpg")).unwrap();

    let commands = commands_of_the_readme();
    let printed = commands.iter().map(|line| scratch.inside(line).said());
    let printed: Vec<String> = printed.collect();
    let of = |command: &str| {
        let mut all = commands.iter().zip(&printed);
        all.find(|(line, _)| line.starts_with(command)).unwrap().1
    };
    // Sheets are held out whole, so there is a column for them.
    let fitted = "100 surfaces in 50 groups; friction, hardness; by group, %; \
        furthest from what was measured";
    expect(of("fit"), fitted);
    expect(of("predict"), "friction; hardness; 90 % interval");
    expect(of("map"), "photograph-hardness.png; places");
    assert!(scratch.path("maps/photograph-hardness.npy").is_file());

    let model = Estimator::load(&scratch.path("models/mine")).unwrap();
    // Brightness and grain are plain to see, also on sheets that were held out.
    for property in ["friction", "hardness"] {
        let measured = model.about().measured[property];
        assert!(measured.r2.unwrap() > 0.5, "{property}: {measured:?}");
        for coverage in [measured.coverage, measured.unit_coverage] {
            assert!(coverage.unwrap() > 0.7, "{property}: {measured:?}");
        }
    }
    let page = scratch.read("models/mine/report.html");
    expect(&page, "Ridge regression; Nearest neighbour");
    // What the data was laid out in is gone.
    let left = fs::read_dir(scratch.path("models")).unwrap();
    assert_eq!(left.count(), 1);

    let again = format!("{} --force --json", commands[0]);
    let [found, log] = scratch.inside(&again).ended(0);
    let found: Value = serde_json::from_str(&found).unwrap();
    let measured = serde_json::to_value(&model.about().measured).unwrap();
    assert_eq!(found["about"]["measured"], measured);
    assert_eq!(found["worst"].as_array().unwrap().len(), 3);
    expect(&log, fitted);
}

#[test]
fn what_cannot_be_fitted_is_refused_before_anything_is_written() {
    let scratch = laid_out();
    let refused = |values: &str, more: &str, code: i32, named: &str| {
        scratch.write("other.csv", values);
        let line = format!("fit photographs --out models/other {more}");
        let [_, log] = scratch.inside(&line).ended(code);
        expect(&log, named);
        assert!(!scratch.path("models").exists());
    };
    let table = "--values other.csv";
    let one = "photograph,group,friction\n000.png,steel,0.5\n001.png,steel,0.6\n";
    refused(one, table, 1, "other.csv: found one group; two");
    let missing = "photograph,friction\n000.png,0.5\nnone.png,0.6\n";
    refused(missing, table, 1, "other.csv, line 3; none.png");
    refused(one, "", 2, "--values");
    refused(one, "--config other.toml", 2, "cannot be used with");
    let level = "--values other.csv --level 2";
    refused(one, level, 2, "--level; between 0 and 1");
    // How a table is laid out says nothing of a config.
    let mut both = scratch.sps("fit --config x.toml --views a --out m");
    let [_, log] = both.ended(2);
    expect(&log, "--views");
}

/// Models of one encoder's embeddings are the same, whether the encoder made them or a file has them.
#[test]
fn embeddings_from_a_file_give_the_model_that_photographs_give() {
    let scratch = laid_out();
    let done = |line: &str| scratch.inside(line).said();
    let refused = |line: &str, parts: &str| scratch.inside(line).refused(parts);
    // In another order than the table's.
    let images = (0..100).rev().map(|at| format!("photographs/{at:03}.png"));
    let images = images.collect::<Vec<_>>().join(" ");
    let two = "photographs/000.png photographs/001.png";
    let embed = "embed --encoder efficientnet-lite-body --resize 64 --out";
    done(&format!("{embed} all.safetensors {images}"));
    done(&format!("{embed} few.safetensors {two}"));
    let fit = "fit photographs --values values.csv";
    // Where no command has left a cache.
    done(&format!("{fit} --embeddings all.safetensors --out blind"));
    done(&format!("{fit} --pixels 64 --out seeing"));
    let few = format!("{fit} --embeddings few.safetensors --out x");
    refused(&few, "few.safetensors; a row of 002.png: found none");

    let model = |name: &str| Estimator::load(&scratch.path(name)).unwrap();
    let (seeing, blind) = (model("seeing"), model("blind"));
    assert_eq!(blind.about().measured, seeing.about().measured);
    let values = |line: &str| -> Vec<f64> {
        let rows: Vec<Vec<String>> = rows(&done(line));
        rows.iter().map(|row| row[2].parse().unwrap()).collect()
    };
    let seen = values(&format!("predict seeing --csv {two}"));
    let told = values("predict blind --csv --embeddings few.safetensors");
    assert_eq!(told.len(), 4);
    for (told, seen) in told.iter().zip(seen) {
        assert!((told - seen).abs() < 1e-9, "{told}, {seen}");
    }
    let how = "expected their embeddings; predict MODEL --embeddings FILE";
    refused("predict blind photographs/000.png", how);
    refused("serve blind", how);
    let narrow = "embed --encoder efficientnet-lite-body --depths last --out last.safetensors";
    done(&format!("{narrow} photographs/000.png"));
    let found = "last.safetensors: found the blocks embeddings (320), expected; stage-1 (16)";
    refused("predict blind --embeddings last.safetensors", found);
    // An ONNX file, in a build that reads none.
    scratch.write("dino.onnx", "");
    let onnx = format!("{fit} --encoder dino.onnx --out x");
    if cfg!(not(feature = "onnx")) {
        refused(&onnx, "dino.onnx; a build with the feature `onnx`");
    }
}
