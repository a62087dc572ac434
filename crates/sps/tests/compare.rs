//! Finished runs set beside one another.

mod support;

use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use serde_json::Value;
use support::{Scratch, expect, message, sps};

/// The tiny experiment with other settings, in a folder of that name.
fn ran(scratch: &Scratch, name: &str, settings: &[&str]) -> PathBuf {
    let mut command = sps();
    command.arg("experiment").arg(scratch.path("tiny.toml"));
    for setting in settings {
        command.args(["--set", setting]);
    }
    let folder = scratch.path(name);
    command.arg("--out").arg(&folder).assert().success();
    folder
}

fn compare(runs: &[&PathBuf]) -> Command {
    let mut command = sps();
    command.arg("compare").args(runs);
    command
}

fn json(runs: &[&PathBuf]) -> Value {
    let output = compare(runs).arg("--json").assert().success();
    serde_json::from_slice(&output.get_output().stdout).unwrap()
}

fn text(runs: &[&PathBuf]) -> String {
    let output = compare(runs).assert().success();
    String::from_utf8(output.get_output().stdout.clone()).unwrap()
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
    let all = json(&[&run, &run]);
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
    let text = text(&[&run, &run]);
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
    let within = compare(&[&run, &run]).args(["--tolerance", "0"]).assert();
    within.success();
}

/// Paired because the splits are those of one seed.
#[test]
fn other_settings_on_the_same_surfaces_are_paired() {
    let scratch = Scratch::new();
    // One rerun says nothing of chance: whatever moves counts.
    let run = ran(&scratch, "run", &["reruns=1"]);
    let other = ran(&scratch, "longer", &["reruns=1", "head.epochs=9"]);
    let all = json(&[&run, &other]);
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

    let text = message(compare(&[&run, &other]).args(["--tolerance", "0"]).assert());
    expect(
        &text,
        &["tolerance of 0 in R²", "cross-modal: R² fRS", "longer"],
    );
    assert!(!text.contains("ridge: R²"), "{text}");
    let wide = compare(&[&run, &other])
        .args(["--tolerance", "1e9"])
        .assert();
    wide.success();
}

#[test]
fn other_surfaces_are_not_paired() {
    let scratch = Scratch::new();
    let run = ran(&scratch, "run", &[]);
    let other = ran(&scratch, "other", &["seed=1"]);
    let said = text(&[&run, &other]);
    expect(&said, &["seed", "different surfaces", "unpaired"]);

    // The same names, other readings.
    let table = fs::read_to_string(scratch.path("data/tactile.csv")).unwrap();
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
    let all = json(&[&run, &run, &edited]);
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
    let run = ran(
        &scratch,
        "run",
        &["properties=[\"fRS\"]", "floors=[\"mean\"]"],
    );
    let other = ran(&scratch, "other", &["properties=[\"cDF\", \"fRS\"]"]);
    let said = text(&[&run, &other]);
    expect(&said, &["Only run 1 has: mean", "properties", "floors"]);
    // Means over other properties say nothing.
    assert!(!said.contains("Means over properties"), "{said}");
    let past = message(
        compare(&[&run, &other])
            .args(["--tolerance", "1e9"])
            .assert(),
    );
    expect(&past, &["mean: R²", "not measured"]);
}

#[test]
fn what_cannot_be_compared_is_refused_by_name() {
    let scratch = Scratch::new();
    let run = ran(&scratch, "run", &[]);
    let refused = |other: &str, parts: &[&str]| {
        expect(
            &message(compare(&[&run, &scratch.path(other)]).assert()),
            parts,
        );
    };
    refused("nowhere", &["nowhere", "is not the folder of a run"]);
    support::copy(&run, &scratch.path("begun"));
    fs::remove_file(scratch.path("begun/checksums")).unwrap();
    refused("begun", &["begun", "no run has finished here"]);
    support::copy(&run, &scratch.path("damaged"));
    scratch.edit("damaged/config.toml", "epochs = 3", "epochs = 4");
    refused("damaged", &["damaged/config.toml", "checksum"]);

    let renamed = scratch.path("renamed");
    scratch.edit("tiny.toml", "id = \"ridge\"", "id = \"linear\"");
    scratch.edit("tiny.toml", "id = \"cross-modal\"", "id = \"network\"");
    ran(&scratch, "renamed", &[]);
    assert!(renamed.exists());
    refused("renamed", &["no method in common", "ridge", "network"]);

    let text = compare(&[&run, &run]).arg("--tolerance=-1").assert();
    let text = String::from_utf8(text.failure().get_output().stderr.clone()).unwrap();
    expect(&text, &["--tolerance", "-1"]);
    compare(&[&run]).assert().failure();
}
