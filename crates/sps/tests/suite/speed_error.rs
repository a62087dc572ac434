//! Experiments whose methods differ in what they cost.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::LazyLock;

use crate::support::{Scratch, expect, method, rows};
use serde_json::Value;

/// Three encoders, and two ways to look at no more views than needed: one that is never sure
/// enough, and one that always is.
const SETTINGS: &str = r#"
[report.speed]
front = true
within-seconds = 3600.0
[[sweep]]
id = "small-{views}-{kind}"
label = "Small, {views}, {kind}"
encoder = { resize = 24 }
grid = { kind = ["ridge", "head"], views = [1, 2, "all"] }
[[sweep]]
id = "squeeze-{views}-{kind}"
label = "SqueezeNet, {views}, {kind}"
encoder = { name = "squeezenet1-0", resize = 24 }
grid = { kind = ["ridge"], views = [1] }
[[sweep]]
id = "{adaptive}"
label = "Adaptive, {adaptive}"
kind = "ridge"
encoder = { resize = 24 }
views = 3
selector = { kind = "equidistant" }
grid = { adaptive = [
    { as = "narrow", width = 1e-6, level = 0.5, calibration = 0.4 },
    { as = "wide", width = 1e6, level = 0.5, calibration = 0.4 },
] }
"#;

/// Of enough surfaces to calibrate on.
fn scratch(settings: &str) -> Scratch {
    let scratch = Scratch::with(settings);
    scratch.simulates("surfaces = 40, test-surfaces = 0, size = 32, views = 5");
    scratch
}

/// What one run of all settings left, for the tests that only read.
struct Ran {
    results: Value,
    figure: String,
    report: String,
    html: String,
    predictions: String,
}

static RAN: LazyLock<Ran> = LazyLock::new(|| {
    let scratch = scratch(SETTINGS);
    scratch.experiment().assert().success();
    Ran {
        results: scratch.json("run/results.json"),
        figure: scratch.read("run/figures/speed-error.svg"),
        report: scratch.read("run/report.md"),
        html: scratch.read("run/report.html"),
        predictions: scratch.read("run/predictions.csv"),
    }
});

#[test]
fn settings_are_drawn_and_the_questions_answered() {
    let results = &RAN.results;
    let seconds = |method: &Value| method["predict_seconds_per_surface"].as_f64().unwrap();
    let r2 = |method: &Value| method["r2_mean"].as_f64().unwrap();
    let methods = results["methods"].as_array().unwrap();
    assert_eq!(methods.len(), 2 + 2 + 6 + 1);

    // Against the definitions.
    let beaten = |one: &Value| {
        methods.iter().any(|m| {
            (seconds(m) <= seconds(one) && r2(m) > r2(one))
                || (seconds(m) < seconds(one) && r2(m) >= r2(one))
        })
    };
    let front = methods.iter().filter(|m| !beaten(m));
    let front = front.map(|m| m["id"].as_str());
    let speed = &results["speed"];
    let found = speed["front"].as_array().unwrap().iter().map(Value::as_str);
    assert_eq!(found.collect::<BTreeSet<_>>(), front.collect());
    let best = methods.iter().map(r2).reduce(f64::max).unwrap();
    let answer = |key: &str| method(results, speed[key].as_str().unwrap());
    assert_eq!(r2(answer("best_within_seconds")), best);
    let fastest = answer("fastest_within_error");
    assert!(1.0 - r2(fastest) <= 1.02 * (1.0 - best));

    for one in methods {
        let label = one["label"].as_str().unwrap();
        expect(&RAN.figure, &format!("<title>{label}: "));
    }
    expect(&RAN.report, "## Two questions; ## Every setting; | ● ");
    let titles = "Speed against error; Width of intervals against error";
    expect(&RAN.html, titles);
    expect(&RAN.html, "Coverage of intervals; data:image/png;base64,");
}

#[test]
fn costs_come_in_parts() {
    let results = &RAN.results;
    let of = |id: &str, key: &str| method(results, id)[key].as_f64().unwrap();
    for id in ["small-1-ridge", "squeeze-1-ridge", "small-all-head", "wide"] {
        let part = |part: &str| of(id, &format!("{part}_seconds_per_surface"));
        assert!(part("decode") > 0.0 && part("encode") > 0.0 && part("head") > 0.0);
        assert!(of(id, "peak_memory_bytes") > 0.0);
    }
    let views = results["dataset"]["views"].as_f64().unwrap();
    assert_eq!(of("small-all-ridge", "frames_encoded_per_surface"), views);
    // Two properties from embeddings of 784 numbers.
    let encoder = of("small-1-ridge", "multiply_adds_per_surface") - 2.0 * 784.0;
    let two = of("small-2-ridge", "multiply_adds_per_surface") - 2.0 * 2.0 * 784.0;
    assert_eq!(two, 2.0 * encoder);
    // 1.2 million parameters in single precision.
    assert!(of("small-1-ridge", "peak_memory_bytes") > 4.0 * 1.2e6);
}

#[test]
fn views_are_added_until_the_interval_is_narrow_enough() {
    let results = &RAN.results;
    let wide = method(results, "wide");
    assert_eq!(wide["adaptive"]["mean_views"], 1.0);
    assert_eq!(wide["adaptive"]["narrow"], 1.0);
    assert_eq!(wide["frames_decoded_per_surface"], 1.0);
    let narrow = method(results, "narrow");
    assert_eq!(narrow["adaptive"]["mean_views"], 3.0);
    assert_eq!(narrow["adaptive"]["narrow"], 0.0);
    assert_eq!(narrow["frames_encoded_per_surface"], 3.0);
    let share = serde_json::json!([0.0, 0.0, 1.0]);
    assert_eq!(narrow["adaptive"]["share_of_views"], share);
    // What single estimates took, and their intervals.
    for line in rows::<BTreeMap<String, String>>(&RAN.predictions) {
        let number = |key: &str| line[key].parse::<f64>().ok();
        match line["method"].as_str() {
            "narrow" => assert_eq!(line["views"], "3"),
            "wide" => assert_eq!(line["views"], "1"),
            _ => assert_eq!((line["views"].as_str(), number("low")), ("", None)),
        }
        assert!(number("low") <= number("high"), "{line:?}");
    }
    // The views are those of the selector, the middle one first.
    let views = serde_json::json!([2, 0, 4]);
    assert_eq!(narrow["selected_views"]["fRS"][0], views);
}

#[test]
fn a_method_says_the_same_beside_methods_with_other_encoders() {
    let (alone, beside) = (scratch("").ran(), &RAN.results);
    for id in ["ridge", "cross-modal"] {
        assert_eq!(method(&alone, id)["r2"], method(beside, id)["r2"]);
    }
    let first = method(beside, "small-1-ridge")["r2"].clone();
    assert_ne!(first, method(beside, "ridge")["r2"]);
}

#[test]
fn wrong_settings_are_refused_at_their_line() {
    let refused = |settings: &str, parts: &str| scratch(settings).is_refused(parts);
    let sweep = "[[sweep]]\nid = 's'\nlabel = 'S'\nkind = 'ridge'\ngrid = { views = [1] }\n";
    let vgg = "encoder = { name = \"vgg\" }";
    let key = format!("{vgg}; sweep.0.encoder.name; vgg");
    refused(&format!("{sweep}{vgg}"), &key);
    let slip = format!("{sweep}encoder = {{ nam = \"vgg\" }}");
    refused(&slip, "did you mean `name`?");
    refused(&sweep.replace("[1]", "[1, 1]"), "two methods; s-1");
    let adaptive = |more: &str, width: &str, parts: &str| {
        let method = "[[methods]]\nid = 'a'\nlabel = 'A'\nkind = 'ridge'";
        let adaptive = format!("adaptive = {{ width = {width} }}");
        refused(&format!("{method}\n{more}\n{adaptive}"), parts);
    };
    adaptive("", "1.0", "adaptive; needs a number of `views`");
    let several = "views = 3\nselector = { kind = 'equidistant' }";
    adaptive(several, "0.0", "adaptive.width; above 0");
    let trained = format!("{several}\nencoder = {{ trainable = true }}");
    adaptive(&trained, "1.0", "adaptive; not trained");
    let error = "[report.speed]\nwithin-error = -1.0";
    refused(error, "within-error; from 0 on");
}
