//! Models that are kept, and what they say of photographs.

use std::fs;
use std::path::PathBuf;
use std::sync::LazyLock;

use crate::support::{Ends, Scratch, calibrates, expect, fit, fitted_in, root};
use assert_cmd::Command;
use candle_core::Device;
use image::{Rgb, RgbImage};
use serde_json::{Value, json};
use sps_dataset::{DatasetFolder, ReadSettings, Source, TactileSettings, Unit, Units};
use sps_estimator::{Embedder, Estimator, Network, photographs_in};
use sps_models::encoders::{Depths, Encoder, EncoderKind};
use sps_regress::ridge::{Ridge, RidgeConfig};
use sps_regress::{FittedRegressor, Plan, Readings, Rerun, TrainingData, Views};

/// The frames of the tiny dataset.
const SIDE: u32 = 32;

/// A scratch folder with a model in `model`, its config with `more` set.
fn fitted(more: &[&str]) -> Scratch {
    fitted_in(Scratch::new(), more)
}

/// A model of one view, for tests that leave it as it is.
static ONE_VIEW: LazyLock<Scratch> = LazyLock::new(|| fitted(&[]));

/// A scratch folder whose dataset is simulated.
fn simulated(options: &str) -> Scratch {
    let scratch = Scratch::new();
    fs::remove_dir_all(scratch.path("data")).unwrap();
    let line = format!("simulate {options} --out @data");
    scratch.sps(&line).assert().success();
    scratch
}

fn predict(scratch: &Scratch, options: &[&str], images: &[PathBuf]) -> Command {
    let mut command = scratch.sps("predict --json @model");
    command.args(options).args(images);
    command
}

/// The first estimate.
fn estimate(mut command: Command) -> Value {
    command.json()["estimates"][0].take()
}

#[test]
fn a_model_answers_for_a_photograph() {
    let scratch = &*ONE_VIEW;
    let images = ["oak-01/002.jpg", "tile-01/002.exr"];
    let images = images.map(|name| scratch.path("data/frames").join(name));
    let of = |images: &[PathBuf]| estimate(predict(scratch, &[], images));
    let one = of(&images[..1]);
    let at = |key: &str| one[key].as_f64().unwrap();
    assert!(at("low") < at("value") && at("value") < at("high"), "{one}");
    let value = |estimate: &Value| estimate["value"].as_f64().unwrap();
    let other = of(&images[1..]);
    let mean = estimate(predict(scratch, &["--group-by", "all"], &images));
    assert!((value(&mean) - f64::midpoint(value(&one), value(&other))).abs() < 1e-9);
}

/// Three surfaces calibrate at 50 %: 4 * 0.75 is 3, for two photographs, and 4 * 5 / 6 is above, for three.
#[test]
fn the_mean_of_more_photographs_than_were_calibrated_for_has_no_interval() {
    let scratch = &*ONE_VIEW;
    let images = ["000.jpg", "001.jpg", "002.jpg"];
    let images = images.map(|name| scratch.path("data/frames/oak-01").join(name));
    let all = ["--group-by", "all"];
    let line = |count: usize| predict(scratch, &all, &images[..count]).json();
    let (two, three) = (line(2), line(3));
    assert_eq!(
        [&two["level"], &two["no_interval"]],
        [&json!(0.5), &json!({})]
    );
    assert!(two["estimates"][0]["low"].is_f64(), "{two}");
    assert_eq!(three["estimates"][0]["high"], Value::Null);
    let reason = three["no_interval"]["fRS"].as_str().unwrap();
    expect(reason, &["found 3 photographs", "at most 2", "83.3 %"]);

    let mut command = scratch.sps("predict --group-by all @model");
    command.args(&images);
    let reason = "fRS: no interval, found 3 photographs";
    expect(&command.said(), &["50 % interval", "none", reason]);
    let csv = command.arg("--csv").said();
    let cells: Vec<&str> = csv.lines().nth(1).unwrap().split(',').collect();
    assert_eq!((cells[1], &cells[3..5]), ("fRS", &["", ""][..]), "{csv}");
}

/// A photograph of the same surface with more pixels is brought to those of the model's frames.
#[test]
fn a_large_photograph_comes_to_the_scale_of_the_model() {
    let scratch = &*ONE_VIEW;
    let photograph = |name: &str, side: u32| {
        let path = scratch.path(name);
        // Smooth, so that both show the same but for the rounding to 8 bits.
        let ramp = |at: u32| ((2 * at + 1) * 125 / side) as u8;
        let pixel = |x, y| Rgb([ramp(x), ramp(y), 90]);
        RgbImage::from_fn(side, side, pixel).save(&path).unwrap();
        [path]
    };
    let small = photograph("small.png", SIDE);
    let large = photograph("large.png", 30 * SIDE);
    let value = |options: &[&str], images: &[PathBuf]| {
        estimate(predict(scratch, options, images))["value"]
            .as_f64()
            .unwrap()
    };
    let expected = value(&[], &small);
    let found = value(&[], &large);
    assert!((found - expected).abs() < 1.0, "{found}, not {expected}");
    assert_eq!(value(&["--resize", "32"], &large), value(&[], &large));
    assert_eq!(value(&["--keep-size"], &small), expected);
    assert_ne!(value(&["--keep-size"], &large), value(&[], &large));
}

/// Files that cannot be read are named; the others are estimated as they are alone.
#[test]
fn broken_photographs_do_not_stop_the_others() {
    let scratch = &*ONE_VIEW;
    let folder = scratch.path("photographs");
    fs::create_dir(&folder).unwrap();
    let whole = fs::read(scratch.path("data/frames/oak-01/002.jpg")).unwrap();
    for number in 0..40 {
        let broken = number % 20 == 7;
        let bytes = if broken { &whole[..30] } else { &whole[..] };
        fs::write(folder.join(format!("{number:02}.jpg")), bytes).unwrap();
    }
    fs::write(folder.join("notes.txt"), "no image").unwrap();
    let alone = scratch.path("data/frames/oak-01/002.jpg");
    let alone = estimate(predict(scratch, &[], &[alone]));
    let [lines, log] = predict(scratch, &[], &[folder]).failed();
    let lines = lines
        .lines()
        .map(|line| serde_json::from_str(line).unwrap());
    let lines: Vec<Value> = lines.collect();
    assert_eq!(lines.len(), 38);
    assert!(lines.iter().all(|line| line["estimates"][0] == alone));
    assert!(lines[0]["surface"].as_str().unwrap().ends_with("00.jpg"));
    expect(
        &log,
        &["07.jpg", "27.jpg", "2 of 40 surfaces have no estimate"],
    );

    let [table, _] = scratch.sps("predict --csv @model @photographs").failed();
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
    let encoder = Encoder::seeded(EncoderKind::EfficientNetLiteBody, 0).unwrap();
    let encoder = encoder.with_depths(&Depths::All).unwrap();
    let embedder = Embedder::new(Network::Images(encoder), None).unwrap();
    let views = [0, 2, 4];
    let count = dataset.surfaces().len();
    let of_surface = |surface| views.map(|view| dataset.frame(surface, view).unwrap());
    let frames: Vec<_> = (0..count).flat_map(of_surface).collect();
    let values = embedder.embed(&frames).unwrap();
    let embeddings = embedder.table(&values, count, 3).unwrap();
    let settings = TactileSettings::default();
    let touched = dataset.tactile().averages(&settings, count);
    let rows: Vec<_> = (0..count).map(|s| vec![touched.value(s, "fRS")]).collect();
    let readings = Readings::new(vec!["fRS".into()], &rows).unwrap();
    let units = Units::by(dataset.surfaces(), Unit::Surface);
    // Values come from a fit to all surfaces, those among them that calibrate.
    let rerun = Rerun {
        number: 0,
        training: (0..count).collect(),
        validation: Vec::new(),
    };
    let mut plan = Plan::each(0, readings.properties(), vec![rerun]);
    plan.trials[0].views = Views::Fixed(vec![0, 1, 2]);
    let data = TrainingData::new(&embeddings, &readings).with_units(units.of_surface());
    let ridge = Ridge::new(RidgeConfig::default()).unwrap();
    let ridges = ridge.train(&data, &plan).unwrap();
    let expected = ridges.predict(&embeddings).unwrap().remove(0).values;

    let folder = |surface: &str| scratch.path("three").join(surface);
    for (at, surface) in dataset.surfaces().iter().enumerate() {
        fs::create_dir_all(folder(&surface.id)).unwrap();
        for entry in fs::read_dir(scratch.path("data/frames").join(&surface.id)).unwrap() {
            let path = entry.unwrap().path();
            let stem = path.file_stem().unwrap().to_str().unwrap().to_owned();
            if views.contains(&stem.parse().unwrap()) {
                fs::copy(&path, folder(&surface.id).join(path.file_name().unwrap())).unwrap();
            }
        }
        let of_folder = estimate(predict(&scratch, &[], &[folder(&surface.id)]));
        let of = |key: &str| of_folder[key].as_f64().unwrap();
        let expected = expected[at].clamp(of("low"), of("high"));
        assert_eq!(of("value"), expected, "{}", surface.id);
        // Of a folder they are taken by name, named one by one as they come.
        let mut named = photographs_in(&folder(&surface.id)).unwrap();
        assert_eq!(estimate(predict(&scratch, &[], &named)), of_folder);
        named.reverse();
        assert_ne!(estimate(predict(&scratch, &[], &named)), of_folder);
    }
    let first = &dataset.surfaces()[0].id;
    let one = dataset.frame_path(0, 2).unwrap();
    let mut map = scratch.sps("map @model fRS");
    map.arg(&one)
        .refused(&["a map is of one", "without `views`"]);
    let [_, log] = predict(&scratch, &[], &[one]).failed();
    expect(
        &log,
        &[first, "found 1, expected 3, at -45, 0 and 45 degrees"],
    );
}

/// Views that a selector chose for each property: a photograph of each view that any looks at.
#[test]
fn a_model_takes_the_views_that_its_selector_chose() {
    let selected = |more: &str| {
        let same = "id = \"r\", label = \"R\", views = 2, distinct = true";
        fitted(&[
            &format!("methods=[{{ {same}, {more} }}]"),
            "selection.folds=1",
        ])
    };
    let by_refits = "kind = \"kernel-ridge\", selector = { kind = \"greedy\" }, refit = {}";
    let frozen = "kind = \"head\", head = { model = { kind = \"regression\" }, epochs = 2 }, \
        selector = { kind = \"exhaustive\" }";
    for more in [by_refits, frozen] {
        let scratch = selected(more);
        let model: Value = serde_json::from_str(&scratch.read("model/estimator.json")).unwrap();
        let angles = model["about"]["angles"].as_array().unwrap();
        assert!((2..=4).contains(&angles.len()), "{angles:?}");
        let shown = scratch.path("shown");
        fs::create_dir(&shown).unwrap();
        for (at, angle) in angles.iter().enumerate() {
            let view = ((angle.as_f64().unwrap() + 45.0) / 22.5).round();
            let frame = scratch.path(&format!("data/frames/oak-01/00{view}.jpg"));
            fs::copy(frame, shown.join(format!("{at}.jpg"))).unwrap();
        }
        let found = estimate(predict(&scratch, &[], &[shown]));
        assert!(found["value"].as_f64().unwrap().is_finite());
    }
}

/// What it was fitted on was computed in another precision than f32.
#[test]
fn a_model_keeps_the_precision_of_its_encoder() {
    for precision in ["bf16", "int8"] {
        let scratch = fitted(&[&format!("encoder.precision={precision}")]);
        let image = [scratch.path("data/frames/oak-01/002.jpg")];
        let found = estimate(predict(&scratch, &[], &image));
        scratch.edit("model/estimator.json", &format!("{precision:?}"), "\"f32\"");
        let in_f32 = estimate(predict(&scratch, &[], &image));
        assert_ne!(found["value"], in_f32["value"]);
    }
}

#[test]
fn a_model_that_resizes_is_not_resized() {
    let scratch = fitted(&["encoder.resize=16"]);
    let image = scratch.path("data/frames/oak-01/002.jpg");
    let mut resizing = predict(&scratch, &["--resize", "24"], &[image]);
    resizing.refused(&["--resize", "16 pixels"]);
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
    expect(&printed, &[of_splits, of_model, reason]);

    let image = [scratch.path("data/frames/oak-01/002.jpg")];
    let line = predict(&scratch, &[], &image).json();
    assert_eq!(
        [&line["familiar"], &line["unfamiliar"]],
        [&Value::Null, &json!(false)]
    );
    expect(line["no_familiar"].as_str().unwrap(), &[reason]);
    let ask = |line: &str| scratch.sps(line).arg(&image[0]).said();
    let none = "no p-value of \"like what the model was fitted on\"";
    expect(&ask("predict @model"), &[none, reason]);
    let csv = ask("predict @model --csv");
    assert!(csv.lines().nth(1).unwrap().ends_with(','), "{csv}");
    let drawn = ask("map @model fRS --out @maps");
    expect(
        &drawn,
        &["nothing is hatched, for there is no p-value", reason],
    );
    let numbers = fs::read(scratch.path("maps/002-fRS.npy")).unwrap();
    let last = numbers.last_chunk().unwrap();
    assert!(f64::from_le_bytes(*last).is_nan());
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
    let frames = part
        .validation
        .iter()
        .map(|&at| dataset.frame(at, 0).unwrap());
    let values = model.embedder().embed(&frames.collect::<Vec<_>>()).unwrap();
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
    let kept =
        candle_core::safetensors::load(scratch.path("model/familiar.safetensors"), &Device::Cpu);
    let kept = &kept.unwrap()["units"];
    assert_eq!(kept.dims(), [20, 1, width]);
    let kept: Vec<f32> = kept.flatten_all().unwrap().to_vec1().unwrap();
    assert_eq!(kept, of_unit_length);
}

/// Nothing that learns has seen the readings that calibrate intervals, an encoder as little as a
/// regression.
#[test]
fn an_encoder_that_is_trained_does_not_see_what_calibrates() {
    let dataset = root().join("fixtures/tiny-dataset");
    let dataset = DatasetFolder::open(&dataset, &ReadSettings::default()).unwrap();
    let units = Units::by(dataset.surfaces(), Unit::Surface);
    let all: Vec<usize> = (0..6).collect();
    let part = units.keep_aside(&all, 0.34, 0, "random split", 0).unwrap();
    let weights = |changed: Option<usize>| {
        let read = |text: &str| {
            let surface = changed.map(|surface| dataset.surfaces()[surface].id.clone());
            let lines = text.lines().enumerate().map(|(number, line)| {
                let cells: Vec<&str> = line.split(',').collect();
                if number > 0 && surface.as_deref() == Some(cells[0]) {
                    let cells = cells.iter().enumerate();
                    let cells = cells.map(|(at, cell)| if at < 3 { cell } else { "1" });
                    cells.collect::<Vec<_>>().join(",")
                } else {
                    line.to_owned()
                }
            });
            lines.collect::<Vec<_>>().join("\n") + "\n"
        };
        let scratch = Scratch::new();
        let readings = read(&scratch.read("data/tactile.csv"));
        fs::write(scratch.path("data/tactile.csv"), readings).unwrap();
        let scratch = fitted_in(scratch, &[TRAINED, "train.calibration=0.34"]);
        fs::read(scratch.path("model/encoder.safetensors")).unwrap()
    };
    let before = weights(None);
    assert!(weights(Some(part.validation[0])) == before);
    assert!(weights(Some(part.train[0])) != before);
}

#[test]
fn a_map_is_a_picture_and_numbers() {
    let scratch = &*ONE_VIEW;
    let photograph = scratch.path("wide.png");
    let pixel = |x: u32, y: u32| Rgb([(x * 4 % 256) as u8, (y * 7 % 256) as u8, 90]);
    let wide = RgbImage::from_fn(3 * SIDE, SIDE, pixel);
    wide.save(&photograph).unwrap();
    let map = |options: &[&str], images: &[PathBuf]| {
        let mut command = scratch.sps("map @model fRS --out @maps");
        command.args(options).args(images);
        command
    };
    for options in [&[][..], &["--alone"]] {
        let said = map(options, std::slice::from_ref(&photograph)).said();
        expect(&said, &["wide-fRS.png", "1 x 17 places"]);
        expect(&said, &["colours from ", "intervals +/- "]);
        let numbers = fs::read(scratch.path("maps/wide-fRS.npy")).unwrap();
        assert_eq!(numbers.len(), 128 + 17 * 4 * 8);
        let picture = image::open(scratch.path("maps/wide-fRS.png")).unwrap();
        assert!(picture.width() > 3 * SIDE);
    }
    let two = ["oak-01", "oak-02"].map(|oak| scratch.path(&format!("data/frames/{oak}/002.jpg")));
    map(&[], &two).refused(&["would have the same map", "002-fRS"]);

    // As large as a frame: one place. A map of another photograph is not written over.
    let log = map(&[], &two[..1]).logged();
    expect(
        &log,
        &["oak-01/002.jpg: one place", "32 x 32 pixels", "--resize"],
    );
    let path = scratch.path("maps/002-fRS.png");
    let drawn = fs::read(&path).unwrap();
    let there = "002-fRS.png is there already, the map of";
    map(&[], &two[1..]).refused(&[there, "oak-01/002.jpg"]);
    assert_eq!(fs::read(&path).unwrap(), drawn);
    map(&[], &two[..1]).assert().success();
    fs::copy(&photograph, &path).unwrap();
    map(&[], &two[..1]).refused(&["is no map that names its photograph"]);
    let mut misspelt = scratch.sps("map @model frs @wide.png");
    misspelt.refused(&["unknown property `frs`", "did you mean `fRS`?", "`cDF`"]);
}

/// What `fit` says of the tiny dataset, its readings a hundredth of what they were, and what `predict`
/// and `inspect` show of them.
#[test]
fn people_read_as_many_digits_as_the_readings_have() {
    let scratch = Scratch::new();
    let text = scratch.read("data/tactile.csv");
    let hundredth = |(at, cell): (usize, &str)| match cell.parse::<f64>() {
        Ok(value) if at > 2 => (value / 100.0).to_string(),
        _ => cell.to_owned(),
    };
    let lines = text.lines().map(|line| {
        let cells = line.split(',').enumerate().map(hundredth);
        cells.collect::<Vec<_>>().join(",") + "\n"
    });
    fs::write(scratch.path("data/tactile.csv"), lines.collect::<String>()).unwrap();
    let scratch = fitted_in(scratch, &["train.method=ridge"]);
    let decimals = |line: &str| {
        let words = line.split_whitespace();
        let numbers = words.filter(|word| word.parse::<f64>().is_ok());
        let numbers = numbers.filter_map(|number| number.split_once('.'));
        let decimals = numbers.map(|(_, decimals)| decimals.len());
        decimals.collect::<Vec<_>>()
    };
    let of = |text: &str, property: &str| {
        let mut lines = text.lines();
        let line = lines.find(|line| line.trim_start().starts_with(property));
        line.unwrap_or_else(|| panic!("no {property} in {text}"))
            .to_owned()
    };

    let table = scratch
        .sps("predict @model @data/frames/oak-01/002.jpg")
        .said();
    // Their standard deviations are 0.117 and 0.318.
    assert_eq!(decimals(&of(&table, "fRS")), [3; 3], "{table}");
    assert_eq!(decimals(&of(&table, "cDF")), [3; 3], "{table}");
    assert!(table.starts_with("property"), "{table}");

    let table = scratch.sps("inspect @data --out @figures").said();
    // Their quartiles lie 0.131 and 0.062 apart.
    assert_eq!(decimals(&of(&table, "fRS"))[..5], [3; 5], "{table}");
    assert_eq!(decimals(&of(&table, "cDF"))[..5], [4; 5], "{table}");
}

#[test]
fn fit_says_what_it_fits_and_what_its_numbers_mean() {
    let scratch = Scratch::new();
    calibrates(&scratch);
    let line = "fit --config @tiny.toml --out @model";
    let first = scratch.sps(line).said();
    expect(
        &first,
        &[
            "Fits method `cross-modal`, the last of the config's methods; `[train] method = \"ID\"` \
            chooses another: ridge",
            "intervals of 50 %:",
            "R²   MAE  interval half width  covered, %",
            "furthest from what was measured",
            "the 50 % that calibrate them",
        ],
    );
    let at = |property: &str| first.find(property).unwrap();
    assert!(at("\n  fRS") < at("\n  cDF"), "{first}");
    let mut other = scratch.sps(&format!("{line} --set train.method=ridge"));
    other.refused(&["model holds a model; `--force` replaces it"]);
    let second = other.arg("--force").said();
    expect(
        &second,
        &["Fits method `ridge`, as `train.method` says", "cross-modal"],
    );
}

#[test]
fn what_no_photographs_can_be_taken_for_is_not_kept() {
    let scratch = Scratch::new();
    let refused = |more: &str, named: &[&str]| {
        let method = "id = \"r\", label = \"R\", kind = \"ridge\"";
        let mut train = scratch.sps("fit --config @tiny.toml --out @model");
        train
            .args(["--set", &format!("methods=[{{ {method}, {more} }}]")])
            .refused(named);
    };
    let twice = "views = 5, selector = { kind = \"random\" }";
    refused(twice, &["may look at a view twice", "`distinct = true`"]);
    let hindsight =
        "views = 2, selector = { kind = \"greedy\" }, refit = { judged-on = \"held-out\" }";
    refused(hindsight, &["by the surfaces held out"]);
    let sequence = "encoder = { name = \"i3d\", weights = \"untrained\", frames = 3 }";
    refused(sequence, &["looks at a sequence by i3d"]);
}

/// Lines of standard input are answered as photographs that are named, and broken ones by an error in
/// their place.
#[test]
fn lines_of_standard_input_are_answered_one_by_one() {
    let scratch = &*ONE_VIEW;
    let images = ["oak-01/002.jpg", "tile-01/002.exr"];
    let images = images.map(|name| scratch.path("data/frames").join(name));
    let named = predict(scratch, &[], &images).said();
    let both = predict(scratch, &["--group-by", "all"], &images).said();
    let lines = [
        json!(images[0]).to_string(),
        json!([images[1]]).to_string(),
        json!([scratch.path("none.png")]).to_string(),
        "{}".to_owned(),
        json!(images).to_string(),
    ];
    let mut asked = predict(scratch, &[], &[PathBuf::from("-")]);
    let [answers, log] = asked.write_stdin(lines.join("\n")).failed();
    let answers: Vec<&str> = answers.lines().collect();
    let named: Vec<&str> = named.lines().collect();
    assert_eq!(answers[..2], named);
    expect(answers[2], &["\"line\":3", "none.png"]);
    expect(answers[3], &["\"line\":4", "found `{}`, expected the path"]);
    assert_eq!(answers[4..], [both.trim_end()]);
    expect(&log, &["2 lines have no estimate"]);
}

#[test]
fn joint_intervals_are_wider_and_of_one_photograph() {
    let scratch = fitted(&["methods=[{ id = \"ridge\", label = \"Ridge\", kind = \"ridge\" }]"]);
    let images = ["000.jpg", "001.jpg"];
    let images = images.map(|name| scratch.path("data/frames/oak-01").join(name));
    let ask = |options: &[&str], images: &[PathBuf]| predict(&scratch, options, images).json();
    let (alone, joint) = (ask(&[], &images[..1]), ask(&["--joint"], &images[..1]));
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
    let several = ask(&["--joint", "--group-by", "all"], &images);
    let reason = several["no_interval"]["fRS"].as_str().unwrap();
    expect(reason, &["found 2 photographs", "expected one"]);
}
