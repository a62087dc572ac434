//! Models that are kept, and what they say of photographs.

use std::fs;
use std::sync::LazyLock;

use crate::support::{
    Ends, Scratch, calibrates, expect, fit, fitted, fitted_in, line, root, simulated,
};
use crate::tables::tables;
use assert_cmd::Command;
use candle_core::Device;
use image::{Rgb, RgbImage};
use serde_json::{Value, json};
use sps_dataset::{DatasetFolder, ReadSettings, Source, Unit, Units};
use sps_estimator::Estimator;
use sps_models::encoders::{Encoder, EncoderKind};
use sps_regress::ridge::{Ridge, RidgeConfig};
use sps_regress::{FittedRegressor, Plan, Rerun, TrainingData, Views};

/// The frames of the tiny dataset.
const SIDE: u32 = 32;

/// A model of one view, for tests that leave it as it is.
static ONE_VIEW: LazyLock<Scratch> = LazyLock::new(|| fitted_in(Scratch::lasting(), &[]));

/// Two photographs.
const OAK: &str = "@data/frames/oak-01/002.jpg";
const TILE: &str = "@data/frames/tile-01/002.exr";

/// `predict` with the words of a line, as [`Scratch::sps`] has it.
fn predict(scratch: &Scratch, line: &str) -> Command {
    scratch.sps(&format!("predict --json @model {line}"))
}

/// The first estimate.
fn estimate(scratch: &Scratch, line: &str) -> Value {
    predict(scratch, line).json()["estimates"][0].take()
}

/// Its value.
fn value(scratch: &Scratch, line: &str) -> f64 {
    estimate(scratch, line)["value"].as_f64().unwrap()
}

#[test]
fn a_model_answers_for_a_photograph() {
    let scratch = &*ONE_VIEW;
    let one = estimate(scratch, OAK);
    let at = |key: &str| one[key].as_f64().unwrap();
    assert!(at("low") < at("value") && at("value") < at("high"), "{one}");
    let other = value(scratch, TILE);
    let mean = value(scratch, &format!("--group-by all {OAK} {TILE}"));
    assert!((mean - f64::midpoint(at("value"), other)).abs() < 1e-9);
}

/// Three surfaces calibrate at 50 %: 4 * 0.75 is 3, for two photographs, and 4 * 5 / 6 is above, for three.
#[test]
fn the_mean_of_more_photographs_than_were_calibrated_for_has_no_interval() {
    let scratch = &*ONE_VIEW;
    let images = ["000", "001", "002"].map(|name| format!("@data/frames/oak-01/{name}.jpg"));
    let of = |count: usize| format!("--group-by all {}", images[..count].join(" "));
    let line = |count: usize| predict(scratch, &of(count)).json();
    let (two, three) = (line(2), line(3));
    let said = [&two["level"], &two["no_interval"]];
    assert_eq!(said, [&json!(0.5), &json!({})]);
    assert!(two["estimates"][0]["low"].is_f64(), "{two}");
    assert_eq!(three["estimates"][0]["high"], Value::Null);
    let reason = three["no_interval"]["fRS"].as_str().unwrap();
    expect(reason, "found 3 photographs; at most 2; 83.3 %");

    let mut command = scratch.sps(&format!("predict @model {}", of(3)));
    let table = "50 % interval; none; fRS: no interval, found 3 photographs";
    expect(&command.said(), table);
    let csv = command.arg("--csv").said();
    let cells: Vec<&str> = csv.lines().nth(1).unwrap().split(',').collect();
    assert_eq!((cells[1], &cells[3..5]), ("fRS", &["", ""][..]), "{csv}");
}

/// A photograph of the same surface with more pixels is brought to those of the model's frames.
#[test]
fn a_large_photograph_comes_to_the_scale_of_the_model() {
    let scratch = &*ONE_VIEW;
    for (name, side) in [("small", SIDE), ("large", 30 * SIDE)] {
        // Smooth, so that both show the same but for the rounding to 8 bits.
        let ramp = |at: u32| ((2 * at + 1) * 125 / side) as u8;
        let image = RgbImage::from_fn(side, side, |x, y| Rgb([ramp(x), ramp(y), 90]));
        image.save(scratch.path(&format!("{name}.png"))).unwrap();
    }
    let value = |line: &str| value(scratch, line);
    let (expected, found) = (value("@small.png"), value("@large.png"));
    assert!((found - expected).abs() < 1.0, "{found}, not {expected}");
    assert_eq!(value("--resize 32 @large.png"), found);
    assert_eq!(value("--keep-size @small.png"), expected);
    assert_ne!(value("--keep-size @large.png"), found);
}

/// Files that cannot be read are named; the others are estimated as they are alone.
#[test]
fn broken_photographs_do_not_stop_the_others() {
    let scratch = &*ONE_VIEW;
    fs::create_dir(scratch.path("photographs")).unwrap();
    let whole = scratch.bytes("data/frames/oak-01/002.jpg");
    for number in 0..40 {
        let broken = number % 20 == 7;
        let bytes = if broken { &whole[..30] } else { &whole[..] };
        scratch.write(&format!("photographs/{number:02}.jpg"), bytes);
    }
    scratch.write("photographs/notes.txt", "no image");
    let alone = estimate(scratch, OAK);
    let [lines, log] = predict(scratch, "@photographs").ended(1);
    let lines = lines.lines().map(serde_json::from_str::<Value>);
    let lines: Vec<Value> = lines.map(Result::unwrap).collect();
    assert_eq!(lines.len(), 38);
    assert!(lines.iter().all(|line| line["estimates"][0] == alone));
    assert!(lines[0]["surface"].as_str().unwrap().ends_with("00.jpg"));
    expect(&log, "07.jpg; 27.jpg; 2 of 40 surfaces have no estimate");

    let [table, _] = scratch.sps("predict --csv @model @photographs").ended(1);
    let (header, lines) = table.split_once('\n').unwrap();
    assert_eq!(header, "surface,property,value,low,high,familiar");
    assert_eq!(lines.lines().count(), 2 * 38);
}

/// A model of three views takes three photographs of a surface, in another process than it was fitted
/// in, and says what a fit to the same surfaces says: here of a regression by its own crate.
#[test]
fn a_model_of_several_views_says_what_an_experiment_does() {
    three_views_say_what_a_ridge_does(Scratch::new());
}

#[test]
fn so_does_one_of_simulated_surfaces() {
    three_views_say_what_a_ridge_does(simulated("--surfaces 20 --views 5 --size 48 --seed 7"));
}

fn three_views_say_what_a_ridge_does(scratch: Scratch) {
    let method = "methods=[{ id = \"ridge\", label = \"Ridge\", kind = \"ridge\", views = 3, \
        selector = { kind = \"equidistant\" } }]";
    let scratch = fitted_in(scratch, &[method, "properties=[\"fRS\"]"]);
    let dataset = DatasetFolder::open(&scratch.path("data"), &ReadSettings::default()).unwrap();
    let encoder = Encoder::seeded(EncoderKind::SqueezeNet1_1, 0).unwrap();
    let views = [0, 2, 4];
    let (embeddings, readings) = tables(&dataset, encoder, &views);
    let units = Units::by(dataset.surfaces(), Unit::Surface);
    // Values come from a fit to all surfaces, those among them that calibrate.
    let rerun = Rerun::new(0, 0..dataset.surfaces().len());
    let plan = Plan::each(0, &["fRS".into()], vec![rerun]);
    let plan = plan.with_views(&Views::Fixed(vec![0, 1, 2]));
    let data = TrainingData::new(&embeddings, &readings).with_units(units.of_surface());
    let ridge = Ridge::new(RidgeConfig::default()).unwrap();
    let ridges = ridge.train(&data, &plan).unwrap();
    let expected = ridges.predict(&embeddings).unwrap().remove(0).values;

    for (at, surface) in dataset.surfaces().iter().enumerate() {
        let folder = format!("three/{}", surface.id);
        fs::create_dir_all(scratch.path(&folder)).unwrap();
        let mut named = Vec::new();
        for view in views {
            let frame = dataset.frame_path(at, view).unwrap();
            let name = format!("{folder}/{}", frame.file_name().unwrap().display());
            fs::copy(&frame, scratch.path(&name)).unwrap();
            named.push(format!("@{name}"));
        }
        let of_folder = estimate(&scratch, &format!("@{folder}"));
        let of = |key: &str| of_folder[key].as_f64().unwrap();
        let expected = expected[at].clamp(of("low"), of("high"));
        assert_eq!(of("value"), expected, "{}", surface.id);
        // Of a folder they are taken by name, named one by one as they come.
        assert_eq!(estimate(&scratch, &named.join(" ")), of_folder);
        named.reverse();
        assert_ne!(estimate(&scratch, &named.join(" ")), of_folder);
    }
    let one = dataset.frame_path(0, 2).unwrap();
    let mut map = scratch.sps("map @model fRS");
    map.arg(&one).refused("a map is of one; without `views`");
    let [_, log] = predict(&scratch, "").arg(&one).ended(1);
    expect(&log, "found 1, expected 3, at -45, 0 and 45 degrees");
    expect(&log, &dataset.surfaces()[0].id);
}

/// Views that a selector chose for each property: a photograph of each view that any looks at.
#[test]
fn a_model_takes_the_views_that_its_selector_chose() {
    let same = "id = \"r\", label = \"R\", views = 2, distinct = true";
    let by_refits = "kind = \"kernel-ridge\", selector = { kind = \"greedy\" }, refit = {}";
    let frozen = "kind = \"head\", head = { model = { kind = \"regression\" }, epochs = 2 }, \
        selector = { kind = \"exhaustive\" }";
    for more in [by_refits, frozen] {
        let method = format!("methods=[{{ {same}, {more} }}]");
        let scratch = fitted(&[&method, "selection.folds=1"]);
        let model = scratch.json("model/estimator.json");
        let angles = model["about"]["angles"].as_array().unwrap();
        assert!((2..=4).contains(&angles.len()), "{angles:?}");
        fs::create_dir(scratch.path("shown")).unwrap();
        for (at, angle) in angles.iter().enumerate() {
            let view = ((angle.as_f64().unwrap() + 45.0) / 22.5).round();
            let frame = scratch.bytes(&format!("data/frames/oak-01/00{view}.jpg"));
            scratch.write(&format!("shown/{at}.jpg"), frame);
        }
        assert!(value(&scratch, "@shown").is_finite());
    }
}

/// What it was fitted on was computed in another precision than f32.
#[test]
fn a_model_keeps_the_precision_of_its_encoder() {
    for precision in ["bf16", "int8"] {
        let scratch = fitted(&[&format!("encoder.precision={precision}")]);
        let found = value(&scratch, OAK);
        scratch.edit("model/estimator.json", &format!("{precision:?}"), "\"f32\"");
        assert_ne!(found, value(&scratch, OAK));
    }
}

#[test]
fn a_model_that_resizes_is_not_resized() {
    let scratch = fitted(&["encoder.resize=16"]);
    let mut resizing = predict(&scratch, &format!("--resize 24 {OAK}"));
    resizing.refused("--resize; 16 pixels");
}

/// A method whose encoder learns from the surfaces fitted to.
const TRAINED: &str = "methods=[{ id = \"ridge\", label = \"Ridge\", kind = \"ridge\", \
    encoder = { trainable = true, training = { epochs = 1, batch-size = 4 } } }]";

/// Two surfaces are left that the encoder has not seen.
#[test]
fn a_trained_encoder_that_has_seen_too_much_has_no_p_value() {
    let more = [TRAINED, "train.calibration=0.34"];
    let scratch = fitted(&more);
    let reason = "found 2 surfaces that it has not seen, expected at least 19";
    let printed = fit(&scratch, &more).arg("--force").said();
    let of_splits = "no p-value of \"like what was fitted on\": the encoder learned";
    let of_model = "the model has no p-value of \"like what it was fitted on\"";
    expect(&printed, &format!("{of_splits}; {of_model}; {reason}"));

    let line = predict(&scratch, OAK).json();
    let familiar = [&line["familiar"], &line["unfamiliar"]];
    assert_eq!(familiar, [&Value::Null, &json!(false)]);
    expect(line["no_familiar"].as_str().unwrap(), reason);
    let ask = |line: &str| scratch.sps(&format!("{line} {OAK}")).said();
    let none = "no p-value of \"like what the model was fitted on\"";
    expect(&ask("predict @model"), &format!("{none}; {reason}"));
    let csv = ask("predict @model --csv");
    assert!(csv.lines().nth(1).unwrap().ends_with(','), "{csv}");
    let drawn = ask("map @model fRS --out @maps");
    let bare = "nothing is hatched, for there is no p-value";
    expect(&drawn, &format!("{bare}; {reason}"));
    let numbers = scratch.bytes("maps/002-fRS.npy");
    assert!(f64::from_le_bytes(*numbers.last_chunk().unwrap()).is_nan());
}

/// Twenty surfaces calibrate, and photographs are held against them as the trained encoder sees them.
#[test]
fn a_photograph_is_held_against_what_a_trained_encoder_has_not_seen() {
    let scratch = simulated("--surfaces 40 --views 1 --size 32 --seed 7");
    let data = scratch.path("data");
    let scratch = fitted_in(scratch, &[TRAINED, "properties=[\"fRS\"]"]);
    let model = Estimator::load(&scratch.path("model")).unwrap();
    assert_eq!(model.fitted().no_familiar(), None);

    let dataset = DatasetFolder::open(&data, &ReadSettings::default()).unwrap();
    let units = Units::by(dataset.surfaces(), Unit::Surface);
    let all: Vec<usize> = (0..40).collect();
    let part = units.keep_aside(&all, 0.5, 0, "random split", 0).unwrap();
    let frames = part.validation.iter().map(|at| dataset.frame(*at, 0));
    let frames: Vec<_> = frames.map(Result::unwrap).collect();
    let values = model.embedder().embed(&frames).unwrap();
    let width = model.embedder().width();
    // Each block of its own.
    let blocks = model.embedder().network().blocks();
    let mut of_unit_length = Vec::new();
    for row in values.chunks(width) {
        let mut rest = row;
        for block in &blocks {
            let (part, behind) = rest.split_at(block.width);
            let squares = part.iter().map(|&x| f64::from(x).powi(2)).sum::<f64>();
            let scaled = part.iter().map(|&x| (f64::from(x) / squares.sqrt()) as f32);
            of_unit_length.extend(scaled);
            rest = behind;
        }
    }
    let kept = scratch.path("model/familiar.safetensors");
    let kept = candle_core::safetensors::load(kept, &Device::Cpu);
    let kept = &kept.unwrap()["units"];
    assert_eq!(kept.dims(), [20, 1, width]);
    let kept: Vec<f32> = kept.flatten_all().unwrap().to_vec1().unwrap();
    assert_eq!(kept, of_unit_length);
}

/// Nothing that learns has seen the readings that calibrate intervals, an encoder as little as a regression.
#[test]
fn an_encoder_that_is_trained_does_not_see_what_calibrates() {
    let dataset = root().join("fixtures/tiny-dataset");
    let dataset = DatasetFolder::open(&dataset, &ReadSettings::default()).unwrap();
    let units = Units::by(dataset.surfaces(), Unit::Surface);
    let all: Vec<usize> = (0..6).collect();
    let part = units.keep_aside(&all, 0.34, 0, "random split", 0).unwrap();
    let weights = |changed: Option<usize>| {
        let changed = changed.map(|at| dataset.surfaces()[at].id.as_str());
        let scratch = Scratch::new();
        scratch.change_readings(|of, reading| if changed == Some(of) { 1.0 } else { reading });
        let scratch = fitted_in(scratch, &[TRAINED, "train.calibration=0.34"]);
        scratch.bytes("model/encoder.safetensors")
    };
    let before = weights(None);
    assert!(weights(Some(part.validation[0])) == before);
    assert!(weights(Some(part.train[0])) != before);
}

#[test]
fn a_map_is_a_picture_and_numbers() {
    let scratch = &*ONE_VIEW;
    let pixel = |x: u32, y: u32| Rgb([(x * 4 % 256) as u8, (y * 7 % 256) as u8, 90]);
    let wide = RgbImage::from_fn(3 * SIDE, SIDE, pixel);
    wide.save(scratch.path("wide.png")).unwrap();
    let map = |line: &str| scratch.sps(&format!("map @model fRS --out @maps {line}"));
    for line in ["@wide.png", "@wide.png --alone"] {
        let parts = "wide-fRS.png; 1 x 17 places; colours from ; intervals +/- ";
        expect(&map(line).said(), parts);
        let numbers = scratch.bytes("maps/wide-fRS.npy");
        assert_eq!(numbers.len(), 128 + 17 * 4 * 8);
        let picture = image::open(scratch.path("maps/wide-fRS.png")).unwrap();
        assert!(picture.width() > 3 * SIDE);
    }
    let other = "@data/frames/oak-02/002.jpg";
    map(&format!("{OAK} {other}")).refused("would have the same map; 002-fRS");

    // As large as a frame: one place. A map of another photograph is not written over.
    let place = "oak-01/002.jpg: one place; 32 x 32 pixels; --resize";
    expect(&map(OAK).logged(), place);
    let drawn = scratch.bytes("maps/002-fRS.png");
    map(other).refused("002-fRS.png is there already, the map of; oak-01/002.jpg");
    assert_eq!(scratch.bytes("maps/002-fRS.png"), drawn);
    map(OAK).assert().success();
    scratch.write("maps/002-fRS.png", scratch.bytes("wide.png"));
    map(OAK).refused("is no map that names its photograph");
    let mut misspelt = scratch.sps("map @model frs @wide.png");
    misspelt.refused("unknown property `frs`; did you mean `fRS`?; `cDF`");
}

/// What `fit` says of the tiny dataset, its readings a hundredth of what they were, and what `predict`
/// and `inspect` show of them.
#[test]
fn people_read_as_many_digits_as_the_readings_have() {
    let scratch = Scratch::new();
    scratch.change_readings(|_, reading| reading / 100.0);
    let scratch = fitted_in(scratch, &["train.method=ridge"]);
    let decimals = |text: &str, property: &str| {
        let line = line(text, property);
        let numbers = line.split(' ').filter(|word| word.parse::<f64>().is_ok());
        let numbers = numbers.filter_map(|number| number.split_once('.'));
        let decimals = numbers.map(|(_, decimals)| decimals.len());
        decimals.collect::<Vec<_>>()
    };
    let table = scratch.sps(&format!("predict @model {OAK}")).said();
    // Their standard deviations are 0.117 and 0.318.
    assert_eq!(decimals(&table, "fRS"), [3; 3], "{table}");
    assert_eq!(decimals(&table, "cDF"), [3; 3], "{table}");
    assert!(table.starts_with("property"), "{table}");

    let table = scratch.sps("inspect @data --out @figures").said();
    // Their quartiles lie 0.131 and 0.062 apart.
    assert_eq!(decimals(&table, "fRS")[..5], [3; 5], "{table}");
    assert_eq!(decimals(&table, "cDF")[..5], [4; 5], "{table}");
}

#[test]
fn fit_says_what_it_fits_and_what_its_numbers_mean() {
    let scratch = Scratch::new();
    calibrates(&scratch);
    let line = "fit --config @tiny.toml --out @model";
    let first = scratch.sps(line).said();
    let chosen = "Fits method `cross-modal`, the last of the config's methods; `[train] method = \"ID\"` \
        chooses another: ridge";
    assert!(first.contains(chosen), "{first}");
    let table = "intervals of 50 %:; R²   MAE  interval half width  covered, %";
    let below = "furthest from what was measured; the 50 % that calibrate them";
    expect(&first, &format!("{table}; {below}"));
    let at = |property: &str| first.find(property).unwrap();
    assert!(at("\n  fRS") < at("\n  cDF"), "{first}");
    let mut other = scratch.sps(&format!("{line} --set train.method=ridge"));
    let there = other.message();
    let replaced = there.ends_with("model holds a model; `--force` replaces it");
    assert!(replaced, "{there}");
    let ridge = "Fits method `ridge`, as `train.method` says; cross-modal";
    expect(&other.arg("--force").said(), ridge);
}

#[test]
fn what_no_photographs_can_be_taken_for_is_not_kept() {
    let scratch = Scratch::new();
    let refused = |more: &str, named: &str| {
        let method = "id = \"r\", label = \"R\", kind = \"ridge\"";
        let method = format!("methods=[{{ {method}, {more} }}]");
        fit(&scratch, &[&method]).refused(named);
    };
    let twice = "views = 5, selector = { kind = \"random\" }";
    refused(twice, "may look at a view twice; `distinct = true`");
    let hindsight =
        "views = 2, selector = { kind = \"greedy\" }, refit = { judged-on = \"held-out\" }";
    refused(hindsight, "by the surfaces held out");
    let sequence = "encoder = { name = \"i3d\", weights = \"untrained\", frames = 3 }";
    refused(sequence, "looks at a sequence by i3d");
}

/// Lines of standard input are answered as photographs that are named, and broken ones by an error in their place.
#[test]
fn lines_of_standard_input_are_answered_one_by_one() {
    let scratch = &*ONE_VIEW;
    let images = [OAK, TILE].map(|name| scratch.path(&name[1..]));
    let both = format!("{OAK} {TILE}");
    let named = predict(scratch, &both).said();
    let both = predict(scratch, &format!("--group-by all {both}")).said();
    let lines = [
        json!(images[0]).to_string(),
        json!([images[1]]).to_string(),
        json!([scratch.path("none.png")]).to_string(),
        "{}".to_owned(),
        json!(images).to_string(),
    ];
    let mut asked = predict(scratch, "-");
    let [answers, log] = asked.write_stdin(lines.join("\n")).ended(1);
    let answers: Vec<&str> = answers.lines().collect();
    assert_eq!(answers[..2], named.lines().collect::<Vec<_>>());
    expect(answers[2], "\"line\":3; none.png");
    expect(answers[3], "\"line\":4; found `{}`, expected the path");
    assert_eq!(answers[4..], [both.trim_end()]);
    expect(&log, "2 lines have no estimate");
}

#[test]
fn joint_intervals_are_wider_and_of_one_photograph() {
    let scratch = fitted(&["methods=[{ id = \"ridge\", label = \"Ridge\", kind = \"ridge\" }]"]);
    let ask = |line: &str| predict(&scratch, line).json();
    let (alone, joint) = (ask(OAK), ask(&format!("--joint {OAK}")));
    let mut wider = 0;
    let estimates = |answer: &Value| answer["estimates"].as_array().unwrap().clone();
    assert_eq!(estimates(&alone).len(), 2);
    for (alone, joint) in estimates(&alone).iter().zip(estimates(&joint)) {
        let width = |of: &Value| of["high"].as_f64().unwrap() - of["low"].as_f64().unwrap();
        assert_eq!(alone["value"], joint["value"]);
        assert!(width(&joint) >= width(alone), "{joint}");
        wider += usize::from(width(&joint) > width(alone));
    }
    assert!(wider > 0, "{joint}");
    let several = ask(&format!("--joint --group-by all {OAK} {TILE}"));
    let reason = several["no_interval"]["fRS"].as_str().unwrap();
    expect(reason, "found 2 photographs; expected one");
}
