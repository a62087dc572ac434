//! Finished runs set beside one another.

use std::fs;

use crate::support::{Ends, Scratch, copy, expect, method};
use serde_json::{Value, json};

/// Runs the tiny experiment with other settings, into a folder of that name.
fn run(scratch: &Scratch, name: &str, settings: &[&str]) {
    let mut command = scratch.experiment_into(name);
    command.set(settings).assert().success();
}

fn scores(comparison: &Value) -> &Vec<Value> {
    comparison["scores"].as_array().unwrap()
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
    run(&scratch, "run", &SURFACES);
    let compare = |line: &str| scratch.sps(&format!("compare @run @run {line}"));
    let all = compare("--json").json();
    let one = &all["comparisons"][0];
    for aspect in one["aspects"].as_array().unwrap() {
        assert_eq!(aspect["differing"], json!([]), "{aspect}");
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
            assert_eq!(score["interval"], json!([0.0, 0.0]), "{score}");
        }
    }
    let text = compare("").said();
    let parts = "The same in both: config, sources, data, machine; \
        Both are scored on the same surfaces; All 26 scores are the same.; Speed beside error";
    expect(&text, parts);
    let long = text.lines().find(|line| line.chars().count() > 100);
    assert_eq!(long, None);
    compare("--tolerance 0").assert().success();
}

/// Paired because the splits are those of one seed.
#[test]
fn other_settings_on_the_same_surfaces_are_paired() {
    let scratch = Scratch::new();
    // One rerun says nothing of chance: whatever moves counts.
    run(&scratch, "run", &["reruns=1"]);
    run(&scratch, "longer", &["reruns=1", "head.epochs=9"]);
    let compare = |line: &str| scratch.sps(&format!("compare @run @longer {line}"));
    let all = compare("--json").json();
    let one = &all["comparisons"][0];
    let epochs = json!({ "key": "head.epochs", "first": "3", "second": "9" });
    assert_eq!(one["aspects"][0]["differing"][0], epochs);
    let [then, now] = ["run", "longer"].map(|run| scratch.results_in(run));
    for score in scores(one) {
        assert_eq!(score["paired"], true);
        if score["score"] == "r2" && score["property"] == "fRS" {
            let id = score["method"].as_str().unwrap();
            let of = |results: &Value| method(results, id)["r2"]["fRS"].as_f64().unwrap();
            assert_eq!(score["first"], of(&then));
            assert_eq!(score["difference"], of(&now) - of(&then));
        }
    }

    let text = compare("--tolerance 0").message();
    expect(&text, "tolerance of 0 in R²; cross-modal: R² fRS; longer");
    assert!(!text.contains("ridge: R²"), "{text}");
    compare("--tolerance 1e9").assert().success();
}

#[test]
fn other_surfaces_are_not_paired() {
    let scratch = Scratch::new();
    run(&scratch, "run", &[]);
    run(&scratch, "other", &["seed=1"]);
    let said = scratch.sps("compare @run @other").said();
    expect(&said, "seed; different surfaces; unpaired");

    // The same names, other readings.
    scratch.change_readings(|_, reading| reading + 1.0);
    run(&scratch, "edited", &[]);
    let all = scratch.sps("compare @run @run @edited --json").json();
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
    run(&scratch, "run", &less);
    run(&scratch, "other", &["properties=[\"cDF\", \"fRS\"]"]);
    let compare = |line: &str| scratch.sps(&format!("compare @run @other {line}"));
    let said = compare("").said();
    expect(&said, "Only run 1 has: mean; properties; floors");
    // Means over other properties say nothing.
    assert!(!said.contains("Means over properties"), "{said}");
    compare("--tolerance 1e9").refused("mean: R²; not measured");
}

#[test]
fn what_cannot_be_compared_is_refused_by_name() {
    let scratch = Scratch::new();
    run(&scratch, "run", &[]);
    let compare = |other: &str| scratch.sps(&format!("compare @run {other}"));
    let refused = |other: &str, parts: &str| compare(other).refused(parts);
    refused("@nowhere", "nowhere; is not the folder of a run");
    copy(&scratch.path("run"), &scratch.path("begun"));
    fs::remove_file(scratch.path("begun/checksums")).unwrap();
    refused("@begun", "begun; no run has finished here");
    copy(&scratch.path("run"), &scratch.path("damaged"));
    scratch.edit("damaged/config.toml", "epochs = 3", "epochs = 4");
    refused("@damaged", "damaged/config.toml; checksum");

    scratch.edit("tiny.toml", "id = \"ridge\"", "id = \"linear\"");
    scratch.edit("tiny.toml", "id = \"cross-modal\"", "id = \"network\"");
    run(&scratch, "renamed", &[]);
    refused("@renamed", "no method in common; ridge; network");

    let [_, log] = compare("@run --tolerance=-1").ended(2);
    expect(&log, "--tolerance; -1");
    compare("").assert().failure();
}
