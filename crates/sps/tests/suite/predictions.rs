//! Another system's estimates, from a file to the results.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;

use crate::support::{Ends, Scratch, expect, method, rows};
use serde_json::Value;

/// A method whose estimates are those of the file, beside ridge regression, whose may be copied there.
const METHODS: &str = "\
ours | Ours | ridge
gpt | GPT | predictions | file = 'FILE'
";

fn scratch() -> Scratch {
    let scratch = Scratch::with_methods(METHODS);
    let file = scratch.path("estimates.csv").display().to_string();
    scratch.edit("tiny.toml", "FILE", &file);
    // So that both are compared with another.
    scratch.edit("tiny.toml", "kind = \"ridge\"", "kind = \"nearest\"");
    scratch.edit("tiny.toml", "id = \"ridge\"", "id = \"nearest\"");
    scratch
}

/// What one method estimates of held-out surfaces, as `predictions.csv` has it: surface, property, number
/// of the split, and the estimate in its own digits.
fn estimates(scratch: &Scratch, run: &str, id: &str) -> Vec<[String; 4]> {
    let all = rows::<BTreeMap<String, String>>(&scratch.read(&format!("{run}/predictions.csv")));
    let own = all.iter().filter(|row| row["method"] == id);
    let keys = ["surface", "property", "rerun", "estimate"];
    own.map(|row| keys.map(|key| row[key].clone())).collect()
}

/// Runs all but `gpt`, and writes what `ours` estimates as the file of `gpt`, columns in another order.
fn copy_ours(scratch: &Scratch, folds: usize) {
    scratch.run_into("before --only [!g]*");
    let mut text = "value,rerun,property,surface\n".to_owned();
    for [surface, property, split, value] in estimates(scratch, "before", "ours") {
        let rerun = split.parse::<usize>().unwrap() / folds;
        let _ = writeln!(text, "{value},{rerun},{property},{surface}");
    }
    scratch.write("estimates.csv", text);
}

/// Everything that two methods have but their names and what they cost.
fn ensure_same(results: &Value) {
    let [ours, gpt] = ["ours", "gpt"].map(|id| method(results, id).as_object().unwrap());
    assert!(ours.keys().eq(gpt.keys()), "{ours:?} {gpt:?}");
    let others = "id label kind encoder precision \
        frames_decoded_per_surface frames_encoded_per_surface multiply_adds_per_surface selected_views";
    for (key, value) in ours {
        if !others.split(' ').any(|other| other == key) {
            assert_eq!(value, &gpt[key], "{key}");
        }
    }
    assert!(gpt["r2_mean"].is_f64());
    assert_eq!(gpt["frames_decoded_per_surface"], 0.0);
    assert_eq!(gpt["encoder"], "");
}

#[test]
fn copied_estimates_are_scored_as_those_they_were_copied_from() {
    let scratch = scratch();
    copy_ours(&scratch, 1);
    let results = scratch.ran();
    ensure_same(&results);
    let ours = estimates(&scratch, "run", "ours");
    assert_eq!(estimates(&scratch, "run", "gpt"), ours);
    let report = scratch.read("run/report.md");
    expect(&report, "| GPT |");
    assert!(!report.contains("Intervals that came with"), "{report}");

    // In shards, with whatever was done before.
    for part in ["--shard 1/2", "--shard 2/2", "--merge"] {
        scratch.run_into(&format!("parts {part}"));
    }
    let merged = scratch.results_in("parts");
    assert_eq!(merged["methods"], results["methods"]);
}

/// Leaving one of six surfaces out, both reruns train on the same: what draws nothing is fitted once,
/// a network twice, and a file may have other estimates for each rerun.
#[test]
fn reruns_on_the_same_surfaces_are_fitted_once_but_may_be_estimated_otherwise() {
    let scratch = scratch();
    let random = "[split.random]\nvalidation = 0.34";
    scratch.edit("tiny.toml", random, "[split.leave-one-out]");
    copy_ours(&scratch, 6);
    let text = scratch.read("estimates.csv");
    let raised = text.lines().map(|line| match line.split_once(",1,") {
        Some((value, rest)) => format!("{},1,{rest}\n", value.parse::<f64>().unwrap() + 1.0),
        None => format!("{line}\n"),
    });
    scratch.write("estimates.csv", raised.collect::<String>());
    let results = scratch.ran();

    let [ours, gpt] = ["ours", "gpt"].map(|id| estimates(&scratch, "run", id));
    assert_eq!(ours.len(), gpt.len());
    for (ours, gpt) in ours.iter().zip(&gpt) {
        assert_eq!(ours[..3], gpt[..3]);
        let [own, given] = [ours, gpt].map(|row| row[3].parse::<f64>().unwrap());
        let first_rerun = ours[2].parse::<usize>().unwrap() < 6;
        let expected = own + if first_rerun { 0.0 } else { 1.0 };
        assert!((given - expected).abs() < 1e-9, "{given} {expected}");
    }
    let trials = scratch.read("run/trials.jsonl");
    let fitted = |id: &str| trials.matches(&format!("\"method\":\"{id}\"")).count();
    // Six folds of two properties, in one rerun or two.
    assert_eq!(["ours", "cross-modal", "gpt"].map(fitted), [12, 24, 24]);
    assert_eq!(method(&results, "ours")["r2_std"]["fRS"], 0.0);
    assert!(method(&results, "ours")["r2_interval"]["fRS"].is_array());
}

/// The folds of a rerun share its number.
#[test]
fn a_rerun_is_that_of_the_experiment_and_not_of_its_folds() {
    let scratch = scratch();
    let random = "[split.random]\nvalidation = 0.34";
    scratch.edit("tiny.toml", random, "[split.k-fold]\nfolds = 3");
    copy_ours(&scratch, 3);
    scratch.run_into("run --only ours --only gpt --only nearest");
    let results = scratch.results();
    ensure_same(&results);
    let gpt = method(&results, "gpt");
    assert!(gpt["r2_mean_interval"].is_array() && gpt["r2_mean_gain"]["interval"].is_array());
}

#[test]
fn simulated_surfaces_are_estimated_by_their_names() {
    let scratch = scratch();
    let split = "[split.random]\nvalidation = 0.34\nby = \"surface\"\n";
    scratch.edit("tiny.toml", split, "");
    scratch.simulates("surfaces = 8, test-surfaces = 12, size = 32, views = 3");
    copy_ours(&scratch, 1);
    ensure_same(&scratch.ran());
}

#[test]
fn an_edited_file_is_scored_anew_and_a_moved_one_is_not() {
    let scratch = scratch();
    copy_ours(&scratch, 1);
    let first = scratch.ran();
    let trials = || scratch.read("run/trials.jsonl");
    let before = trials();

    fs::rename(scratch.path("estimates.csv"), scratch.path("moved.csv")).unwrap();
    scratch.edit("tiny.toml", "estimates.csv", "moved.csv");
    scratch.experiment().assert().success();
    assert_eq!(trials(), before);

    let text = scratch.read("moved.csv");
    let (header, lines) = text.split_once('\n').unwrap();
    scratch.write("moved.csv", format!("{header}\n1{lines}"));
    let second = scratch.ran();
    // The two properties and two reruns of this method, and no other.
    let added = trials().strip_prefix(&before).unwrap().to_owned();
    assert_eq!(added.lines().count(), 4, "{added}");
    assert_eq!(added.matches("\"method\":\"gpt\"").count(), 4);
    assert_eq!(method(&second, "ours"), method(&first, "ours"));
    assert_ne!(method(&second, "gpt")["r2"], method(&first, "gpt")["r2"]);
}

/// Intervals of the widths 4 and 2: every other ends just below its reading, the rest hold it.
#[test]
fn intervals_are_judged_by_what_they_hold() {
    let scratch = scratch();
    copy_ours(&scratch, 1);
    scratch.experiment().assert().success();
    let text = scratch.read("run/predictions.csv");
    let mut lines = "surface,property,rerun,value,low,high\n".to_owned();
    let mut shares: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    let ours = text.lines().filter_map(|line| line.strip_prefix("ours,"));
    for (at, line) in ours.enumerate() {
        let cells: Vec<&str> = line.split(',').collect();
        let [property, rerun, surface, truth, value] = cells[..5] else {
            panic!("{line}");
        };
        let width = WIDTHS[usize::from(property == "cDF")];
        let above = if at % 2 == 0 { -1e-9 } else { width / 2.0 };
        let high = truth.parse::<f64>().unwrap() + above;
        let low = high - width;
        let _ = writeln!(lines, "{surface},{property},{rerun},{value},{low},{high}");
        shares.entry(property).or_default().push((at % 2) as f64);
    }
    scratch.write("estimates.csv", lines);
    let results = scratch.ran();
    let found = &method(&results, "gpt")["intervals"];
    let near = |value: &Value, expected: f64| {
        let value = value.as_f64().unwrap();
        assert!((value - expected).abs() < 1e-6, "{value} and {expected}");
    };
    let (mut held, mut widths) = (0.0, 0.0);
    for (property, width) in ["fRS", "cDF"].into_iter().zip(WIDTHS) {
        let all = &shares[property];
        let share = all.iter().sum::<f64>() / all.len() as f64;
        let std = results["described"][property]["std"].as_f64().unwrap();
        near(&found["coverage"][property], share);
        near(&found["mean_width"][property], width);
        near(&found["mean_width_over_std"][property], width / std);
        held += share / 2.0;
        widths += width / std / 2.0;
    }
    near(&found["coverage_mean"], held);
    near(&found["mean_width_over_std_mean"], widths);
    assert!(method(&results, "ours")["intervals"].is_null());
    expect(&scratch.read("run/report.md"), "Intervals that came with");
}

/// Of the intervals of either property.
const WIDTHS: [f64; 2] = [4.0, 2.0];

/// The message about a file of this content.
fn refusal(text: &str) -> String {
    let scratch = scratch();
    scratch.write("estimates.csv", text);
    let refused = scratch.experiment().message();
    assert!(!scratch.path("run").exists() && !scratch.path("cache").exists());
    refused
}

#[test]
fn a_broken_file_is_named_line_by_line_before_anything_is_done() {
    let refused = refusal(
        "surface,property,value,low,high,rerun\n\
         oak-01,fRS,rough,1,2,0\n\
         oak-01,fRX,1,1,2,0\n\
         \n\
         oka-01,fRS,1,1,2,0\n\
         oak-02,fRS,NaN,1,2,0\n\
         oak-02,fST,inf,1,2,0\n\
         oak-01,fRS,1,1,2,0\n\
         oak-01,fRS,1,3,2,1\n\
         oak-02,fRS,1,1,,1\n\
         tile-01,fRS,1,1,2,2\n\
         tile-01,fRS,1,1,2\n",
    );
    expect(&refused, "method `gpt`, `file`: ");
    expect(&refused, " problems");
    for problem in [
        "estimates.csv, line 2: found `rough` for `value`, expected a number",
        "line 3: unknown property `fRX`, did you mean `fRS`?",
        "line 5: unknown surface `oka-01`, did you mean `oak-01`?",
        "line 6: found `NaN` for `value`",
        "line 7: found `inf` for `value`",
        "line 8: estimates again what line 2 does",
        "line 9: found 3 for `low`, expected at most `high`, 2",
        "line 10: found `` for `high`",
        "line 11: found `2` for `rerun`, expected one of the experiment's 2, counted from 0",
        "line 12: found 5 cells, expected 6",
        "no row of `cDF`, which the experiment estimates",
    ] {
        expect(&refused, problem);
    }
}

#[test]
fn columns_are_named_where_they_are_missing_or_unknown() {
    let problems = "4 problems; line 1: unknown column `valeu`, did you mean `value`?; \
        line 1: there are two columns `rerun`; line 1: there is no column `value`; \
        line 1: a column `low` without a column `high`";
    let refused = refusal("surface,property,valeu,low,rerun,rerun\n");
    expect(&refused, problems);
    expect(&refusal(""), "there is no column `surface`");
}

#[test]
fn held_out_surfaces_without_an_estimate_are_named() {
    let refused = refusal("surface,property,value\noak-01,fRS,1\noak-01,cDF,1\n");
    let missing = "2 problems; estimates.csv: no estimate of `fRS` for ; surfaces held out: ";
    expect(&refused, missing);
    // Of many problems the first are shown.
    let lines = "oak-01,fRS,x\n".repeat(30);
    let refused = refusal(&format!("surface,property,value\n{lines}"));
    // 30 numbers, 29 lines again, one property missing and the other's surfaces.
    expect(&refused, "61 problems; line 11: ; and 41 more");
    assert_eq!(refused.lines().count(), 22, "{refused}");
}

#[test]
fn a_file_is_of_this_kind_of_method_alone_and_nothing_is_fitted_to_it() {
    let scratch = scratch();
    let refused = |line: &str, parts: &str| scratch.sps(line).refused(parts);
    let kind = "`methods.2.file`; kind `predictions`; `ours` is `ridge`";
    refused("experiment @tiny.toml --set methods.ours.file=a.csv", kind);
    let views = "views; `predictions` looks at no view";
    refused("experiment @tiny.toml --set methods.gpt.views=3", views);
    scratch.is_refused("method `gpt`, `file`; cannot read; estimates.csv");
    let fitted = "method `gpt` has its estimates from a file; nothing to fit";
    refused("fit --config @tiny.toml --out @model", fitted);
    let file = scratch.path("estimates.csv").display().to_string();
    scratch.edit("tiny.toml", &format!("file = '{file}'\n"), "");
    scratch.is_refused("`methods.3.file`; method `gpt` needs a CSV");
}
