//! Experiments that look at several views.

use std::sync::LazyLock;

use crate::support::{Ends, Scratch, expect, method};
use serde_json::{Value, json};

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

/// The results and the report of all of them, for tests that only read.
static RAN: LazyLock<(Value, String)> = LazyLock::new(|| {
    let scratch = Scratch::with_methods(METHODS);
    (scratch.ran(), scratch.read("run/report.md"))
});

#[test]
fn a_method_decodes_the_views_that_it_looks_at_and_no_other() {
    let (results, report) = &*RAN;
    let views = results["dataset"]["views"].as_f64().unwrap();
    for (ids, frames) in [
        ("ridge cross-modal", 1.0),
        ("random nvs vb-nvs greedy exhaustive equidistant-ridge", 2.0),
        ("i3d i3d-trained", 3.0),
        ("all pooling", views),
    ] {
        for method in ids.split(' ').map(|id| method(results, id)) {
            assert_eq!(method["frames_decoded_per_surface"], frames, "{method}");
            assert_eq!(method["frames_encoded_per_surface"], frames, "{method}");
            assert!(method["r2"]["fRS"].is_f64(), "{method}");
        }
    }
    let parts = "## The selection of views; figures/selected-views.svg";
    expect(report, parts);
}

#[test]
fn no_selector_is_better_than_the_exhaustive_one() {
    let (results, _) = &*RAN;
    for property in ["fRS", "cDF"] {
        for rerun in 0..2 {
            let of = |id: &str| &method(results, id)["selections"][property][rerun];
            let optimum = of("exhaustive")["loss"].as_f64().unwrap();
            for id in ["random", "nvs", "vb-nvs", "greedy"] {
                assert!(of(id)["loss"].as_f64().unwrap() >= optimum, "{id}");
                assert_eq!(of(id)["optimum_loss"].as_f64(), Some(optimum));
            }
            assert_eq!(of("greedy")["regret"], 0.0);
        }
    }
    assert_eq!(method(results, "ridge")["selections"], json!({}));
}

#[test]
fn methods_at_nadir_say_the_same_beside_others() {
    let alone = Scratch::new().ran();
    for id in ["ridge", "cross-modal"] {
        let (one, other) = (method(&alone, id), method(&RAN.0, id));
        assert_eq!(one["r2"], other["r2"]);
        assert_eq!(one["selected_views"], other["selected_views"]);
    }
}

#[test]
fn the_number_of_threads_changes_no_bit_and_no_pick() {
    let scratch = Scratch::with_methods(METHODS);
    let run = |threads: &str| {
        let cache = format!("cache.folder={}", scratch.path(threads).display());
        let mut command = scratch.experiment();
        command.arg("--fresh").env("RAYON_NUM_THREADS", threads);
        command.set(&[&cache]).assert().success();
        scratch.results()
    };
    assert_eq!(run("1"), run("2"));
}

#[test]
fn selections_that_were_made_are_not_made_again() {
    let methods: Vec<&str> = METHODS
        .lines()
        .filter(|line| line.contains("selector"))
        .collect();
    let scratch = Scratch::with_methods(&methods.join("\n"));
    let results = scratch.ran();
    let journal = "run/selections.jsonl";
    let whole = scratch.read(journal);
    // As a kill in the middle of the search leaves it: part of a line.
    let lines: Vec<&str> = whole.split_inclusive('\n').collect();
    let kept = lines[..lines.len() - 3].concat();
    scratch.write(journal, &whole[..kept.len() + 20]);
    assert_eq!(scratch.ran(), results);
    let mended = scratch.read(journal);
    assert!(mended.starts_with(&kept));
    // Other settings are another selection.
    let evaluations = ["'nvs', evaluations = 200", "'nvs', evaluations = 100"];
    scratch.edit("tiny.toml", evaluations[0], evaluations[1]);
    scratch.experiment().assert().success();
    let after = scratch.read(journal).lines().count();
    assert_eq!(after, mended.lines().count() + 4);
}

#[test]
fn fixed_views_alone_are_embedded_alone() {
    let scratch = Scratch::with_methods(METHODS.lines().last().unwrap());
    let log = scratch.experiment().logged();
    let surfaces = scratch.results()["dataset"]["surfaces"].as_u64().unwrap();
    // The view straight down and two others, or it and one other.
    let views = [2, 3].map(|views| format!("{} embeddings", views * surfaces));
    assert!(views.iter().any(|line| log.contains(line)), "{log}");
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
    let results = scratch.ran();
    let selected = |id: &str| &method(&results, id)["selected_views"]["fRS"];
    assert_eq!(selected("ridge"), &json!([[0], [0]]));
    assert_eq!(selected("one"), &json!([[0], [0]]));
    assert_eq!(selected("two"), &json!([[0, 0], [0, 0]]));
    assert_eq!(selected("neighbours"), &json!([[0, 1, 2], [0, 1, 2]]));
}
