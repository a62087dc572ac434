//! Finished runs set beside one another.

use std::fs;
use std::path::{Path, PathBuf};

use crate::support::{Ends, Scratch, copy, expect, sps, texts};
use assert_cmd::Command;
use serde_json::Value;

/// The tiny experiment with other settings, in a folder of that name.
fn ran(scratch: &Scratch, name: &str, settings: &[&str]) -> PathBuf {
    let mut command = scratch.experiment_into(name);
    for setting in settings {
        command.args(["--set", setting]);
    }
    command.assert().success();
    scratch.path(name)
}

fn compare(runs: &[&PathBuf]) -> Command {
    let mut command = sps();
    command.arg("compare").args(runs);
    command
}

fn scores(comparison: &Value) -> &Vec<Value> {
    comparison["scores"].as_array().unwrap()
}

fn results(run: &Path) -> Value {
    let text = fs::read_to_string(run.join("results.json")).unwrap();
    serde_json::from_str(&text).unwrap()
}

/// More surfaces than the tiny dataset has: enough to draw from.
const SURFACES: [&str; 5] = [
    "data.from=simulator",
    "data.simulated.surfaces=30",
    "data.simulated.test-surfaces=0",
    "data.simulated.size=32",
    "data.simulated.views=1",
];

#[test]
fn a_run_and_itself_do_not_differ() {
    let scratch = Scratch::new();
    let run = ran(&scratch, "run", &[&SURFACES[..], &["reruns=2"]].concat());
    let all = compare(&[&run, &run]).arg("--json").json();
    let one = &all["comparisons"][0];
    for aspect in one["aspects"].as_array().unwrap() {
        assert_eq!(aspect["differing"], serde_json::json!([]), "{aspect}");
    }
    // Two methods, of two properties five scores each, and three means.
    assert_eq!(scores(one).len(), 2 * (2 * 5 + 3));
    for score in scores(one) {
        assert_eq!(score["paired"], true, "{score}");
        match score["difference"].as_f64() {
            Some(difference) => assert_eq!(difference, 0.0, "{score}"),
            None => assert_eq!(score["reason"], "a score is missing"),
        }
        if score["score"] != "spearman" {
            assert_eq!(score["interval"], serde_json::json!([0.0, 0.0]), "{score}");
        }
    }
    let text = compare(&[&run, &run]).said();
    expect(
        &text,
        &[
            "The same in both: config, sources, data, machine",
            "Both are scored on the same surfaces",
            "All 26 scores are the same.",
            "Speed beside error",
        ],
    );
    assert!(
        text.lines().all(|line| line.chars().count() <= 100),
        "{text}"
    );
    let mut within = compare(&[&run, &run]);
    within.args(["--tolerance", "0"]).assert().success();
}

/// Paired because the splits are those of one seed.
#[test]
fn other_settings_on_the_same_surfaces_are_paired() {
    let scratch = Scratch::new();
    // One rerun says nothing of chance: whatever moves counts.
    let run = ran(&scratch, "run", &["reruns=1"]);
    let other = ran(&scratch, "longer", &["reruns=1", "head.epochs=9"]);
    let all = compare(&[&run, &other]).arg("--json").json();
    let one = &all["comparisons"][0];
    let epochs = serde_json::json!({ "key": "head.epochs", "first": "3", "second": "9" });
    assert_eq!(one["aspects"][0]["differing"][0], epochs);
    let (then, now) = (results(&run), results(&other));
    for score in scores(one) {
        assert_eq!(score["paired"], true);
        if score["score"] == "r2" && score["property"] == "fRS" {
            let of = |results: &Value| {
                let mut methods = results["methods"].as_array().unwrap().iter();
                let found = methods.find(|method| method["id"] == score["method"]);
                found.unwrap()["r2"]["fRS"].as_f64().unwrap()
            };
            assert_eq!(score["first"], of(&then));
            assert_eq!(score["difference"], of(&now) - of(&then));
        }
    }

    let text = compare(&[&run, &other])
        .args(["--tolerance", "0"])
        .message();
    expect(
        &text,
        &["tolerance of 0 in R²", "cross-modal: R² fRS", "longer"],
    );
    assert!(!text.contains("ridge: R²"), "{text}");
    let mut wide = compare(&[&run, &other]);
    wide.args(["--tolerance", "1e9"]).assert().success();
}

#[test]
fn other_surfaces_are_not_paired() {
    let scratch = Scratch::new();
    let run = ran(&scratch, "run", &[]);
    let other = ran(&scratch, "other", &["seed=1"]);
    let said = compare(&[&run, &other]).said();
    expect(&said, &["seed", "different surfaces", "unpaired"]);

    // The same names, other readings.
    let table = scratch.read("data/tactile.csv");
    let raised = |cell: &str| match cell.parse::<f64>() {
        Ok(reading) if cell.contains('.') => (reading + 1.0).to_string(),
        _ => cell.to_owned(),
    };
    let lines = table.lines().map(|line| {
        let cells: Vec<String> = line.split(',').map(raised).collect();
        cells.join(",") + "\n"
    });
    fs::write(scratch.path("data/tactile.csv"), lines.collect::<String>()).unwrap();
    let edited = ran(&scratch, "edited", &[]);
    let all = compare(&[&run, &run, &edited]).arg("--json").json();
    let [same, edited] = all["comparisons"].as_array().unwrap().as_slice() else {
        panic!("{all}");
    };
    assert!(scores(same).iter().all(|score| score["paired"] == true));
    assert!(scores(edited).iter().all(|score| score["paired"] == false));
    assert_eq!(edited["aspects"][2]["differing"][0]["key"], "data_hash");
}

#[test]
fn what_one_run_lacks_is_named() {
    let scratch = Scratch::new();
    let less = ["properties=[\"fRS\"]", "floors=[\"mean\"]"];
    let run = ran(&scratch, "run", &less);
    let other = ran(&scratch, "other", &["properties=[\"cDF\", \"fRS\"]"]);
    let said = compare(&[&run, &other]).said();
    expect(&said, &["Only run 1 has: mean", "properties", "floors"]);
    // Means over other properties say nothing.
    assert!(!said.contains("Means over properties"), "{said}");
    compare(&[&run, &other])
        .args(["--tolerance", "1e9"])
        .refused(&["mean: R²", "not measured"]);
}

#[test]
fn what_cannot_be_compared_is_refused_by_name() {
    let scratch = Scratch::new();
    let run = ran(&scratch, "run", &[]);
    let refused = |other: &str, parts: &[&str]| {
        compare(&[&run, &scratch.path(other)]).refused(parts);
    };
    refused("nowhere", &["nowhere", "is not the folder of a run"]);
    copy(&run, &scratch.path("begun"));
    fs::remove_file(scratch.path("begun/checksums")).unwrap();
    refused("begun", &["begun", "no run has finished here"]);
    copy(&run, &scratch.path("damaged"));
    scratch.edit("damaged/config.toml", "epochs = 3", "epochs = 4");
    refused("damaged", &["damaged/config.toml", "checksum"]);

    let renamed = scratch.path("renamed");
    scratch.edit("tiny.toml", "id = \"ridge\"", "id = \"linear\"");
    scratch.edit("tiny.toml", "id = \"cross-modal\"", "id = \"network\"");
    ran(&scratch, "renamed", &[]);
    assert!(renamed.exists());
    refused("renamed", &["no method in common", "ridge", "network"]);

    let refused = compare(&[&run, &run])
        .arg("--tolerance=-1")
        .assert()
        .code(2);
    expect(&texts(&refused)[1], &["--tolerance", "-1"]);
    compare(&[&run]).assert().failure();
}
