//! Experiments that look at several views.

mod support;

use std::fs;

use support::{Scratch, expect, message, method};

const METHODS: &str = "\
all | All | head | views = 'all'
i3d | I3D | head | encoder = { name = 'i3d', weights = 'untrained', frames = 3, resize = 16 }
i3d-trained | I3D, trained | head | encoder = { name = 'i3d', weights = 'untrained', frames = 3, resize = 16, \
    trainable = true, training = { epochs = 1, batch-size = 8 } }
pooling | Pooling | head | views = 'all'; head.input = { kind = 'view-pooling' }
random | Random | head | views = 2; distinct = true; selector = { kind = 'random' }
nvs | NVS | head | views = 2; distinct = true; selector = { kind = 'nvs', evaluations = 200 }
vb-nvs | VB-NVS | head | views = 2; distinct = true; selector = { kind = 'vb-nvs', evaluations = 200, \
    search = { rounds = 2, shortlist = 5 } }
greedy | Greedy | head | views = 2; distinct = true; selector = { kind = 'greedy' }
exhaustive | Exhaustive | head | views = 2; distinct = true; selector = { kind = 'exhaustive' }
trn | TRN | head | relations = { scales = [1, 2], per-scale = 2, test-draws = 2 }
equidistant-ridge | Ridge of two | ridge | views = 2
";

#[test]
fn a_method_decodes_the_views_that_it_looks_at_and_no_other() {
    let scratch = Scratch::with_methods(METHODS);
    scratch.experiment().assert().success();
    let results = scratch.results();
    let views = results["dataset"]["views"].as_f64().unwrap();
    for (id, frames) in [
        ("ridge", 1.0),
        ("cross-modal", 1.0),
        ("all", views),
        ("i3d", 3.0),
        ("i3d-trained", 3.0),
        ("pooling", views),
        ("random", 2.0),
        ("nvs", 2.0),
        ("vb-nvs", 2.0),
        ("greedy", 2.0),
        ("exhaustive", 2.0),
        ("equidistant-ridge", 2.0),
    ] {
        let method = method(&results, id);
        assert_eq!(method["frames_decoded_per_surface"], frames, "{id}");
        assert_eq!(method["frames_encoded_per_surface"], frames, "{id}");
        assert!(method["r2"]["fRS"].is_f64(), "{method}");
    }
    let report = fs::read_to_string(scratch.path("run/report.md")).unwrap();
    assert!(report.contains("## The selection of views"), "{report}");
    assert!(report.contains("figures/selected-views.svg"), "{report}");
}

#[test]
fn no_selector_is_better_than_the_exhaustive_one() {
    let scratch = Scratch::with_methods(METHODS);
    scratch.experiment().assert().success();
    let results = scratch.results();
    for property in ["fRS", "cDF"] {
        for rerun in 0..2 {
            let of = |id: &str| &method(&results, id)["selections"][property][rerun];
            let optimum = of("exhaustive")["loss"].as_f64().unwrap();
            for id in ["random", "nvs", "vb-nvs", "greedy"] {
                assert!(of(id)["loss"].as_f64().unwrap() >= optimum, "{id}");
                assert_eq!(of(id)["optimum_loss"].as_f64(), Some(optimum));
            }
            assert_eq!(of("greedy")["regret"], 0.0);
        }
    }
    assert!(
        method(&results, "ridge")["selections"]
            .as_object()
            .unwrap()
            .is_empty()
    );
}

#[test]
fn methods_at_nadir_say_the_same_beside_others() {
    let alone = Scratch::with_methods("");
    alone.experiment().assert().success();
    let beside = Scratch::with_methods(METHODS);
    beside.experiment().assert().success();
    let (alone, beside) = (alone.results(), beside.results());
    for id in ["ridge", "cross-modal"] {
        let (one, other) = (method(&alone, id), method(&beside, id));
        assert_eq!(one["r2"], other["r2"]);
        assert_eq!(one["selected_views"], other["selected_views"]);
    }
}

#[test]
fn the_number_of_threads_changes_no_pick() {
    let scratch = Scratch::with_methods(METHODS);
    let run = |threads: &str| {
        let mut command = scratch.experiment();
        command.arg("--fresh").env("RAYON_NUM_THREADS", threads);
        command.assert().success();
        scratch.results()
    };
    assert_eq!(run("1"), run("2"));
}

#[test]
fn selections_that_were_made_are_not_made_again() {
    let scratch = Scratch::with_methods(METHODS);
    scratch.experiment().assert().success();
    let (path, results) = (scratch.path("run/selections.jsonl"), scratch.results());
    let whole = fs::read(&path).unwrap();
    // As a kill in the middle of the search leaves it: half of the last line.
    let lines: Vec<&[u8]> = whole.split_inclusive(|byte| *byte == b'\n').collect();
    let kept = lines[..lines.len() - 3].concat();
    fs::write(&path, &whole[..kept.len() + 20]).unwrap();
    scratch.experiment().assert().success();
    assert_eq!(scratch.results(), results);
    assert!(fs::read(&path).unwrap().starts_with(&kept));
    // Other settings are another selection.
    let lines = fs::read_to_string(&path).unwrap().lines().count();
    scratch.edit(
        "tiny.toml",
        "'nvs', evaluations = 200",
        "'nvs', evaluations = 100",
    );
    scratch.experiment().assert().success();
    let after = fs::read_to_string(&path).unwrap().lines().count();
    assert_eq!(after, lines + 4);
}

#[test]
fn fixed_views_alone_are_embedded_alone() {
    let scratch = Scratch::with_methods(METHODS.lines().last().unwrap());
    let run = scratch.experiment().assert().success();
    let log = String::from_utf8_lossy(&run.get_output().stderr).into_owned();
    let surfaces = scratch.results()["dataset"]["surfaces"].as_u64().unwrap();
    // The view straight down and two others, or it and one other.
    let views = [2, 3].map(|views| format!("{} embeddings", views * surfaces));
    assert!(views.iter().any(|line| log.contains(line)), "{log}");
}

#[test]
fn more_views_than_there_are_are_refused_by_the_name_of_the_method() {
    let scratch = Scratch::new();
    let mut command = scratch.experiment();
    let text = message(command.args(["--set", "methods.ridge.views=9"]).assert());
    expect(&text, &["method `ridge`", "9 views", "at most 5"]);
}

/// Angles of 0, 15, 30, 45 and 60 degrees: the middle view is not the one straight down.
#[test]
fn straight_down_is_where_the_angle_is_nearest_to_0() {
    let scratch = Scratch::with_methods(
        "\
one | One | ridge | selector = { kind = 'nadir' }
two | Two | head | views = 2; selector = { kind = 'nadir' }
neighbours | Neighbours | ridge | views = 3; distinct = true; selector = { kind = 'nadir' }
",
    );
    let angles = ["from = -45.0, to = 45.0", "from = 0.0, to = 60.0"];
    scratch.edit("data/dataset.toml", angles[0], angles[1]);
    scratch.experiment().assert().success();
    let results = scratch.results();
    for (id, views) in [
        ("ridge", &[0][..]),
        ("one", &[0]),
        ("two", &[0, 0]),
        ("neighbours", &[0, 1, 2]),
    ] {
        let selected = &method(&results, id)["selected_views"]["fRS"];
        assert_eq!(selected, &serde_json::json!([views, views]), "{id}");
    }
}
