//! Models that are kept, and what they say of photographs.

mod support;

use std::fs;
use std::path::PathBuf;

use candle_core::Device;
use image::{Rgb, RgbImage};
use serde_json::{Value, json};
use sps_dataset::{DatasetFolder, ReadSettings, Source, TactileSettings, Unit, Units};
use sps_estimator::{Embedder, Estimator, Network, photographs_in};
use sps_models::encoders::{Depths, Encoder, EncoderKind};
use sps_regress::ridge::{Ridge, RidgeConfig};
use sps_regress::{FittedRegressor, Plan, Readings, Rerun, TrainingData, Views};
use support::{Scratch, calibrates, expect, fit, fitted_in, message, root, sps};

/// The frames of the tiny dataset.
const SIDE: u32 = 32;

/// A scratch folder with a model in `model`, its config with `more` set.
fn fitted(more: &[&str]) -> Scratch {
    fitted_in(Scratch::new(), more)
}

/// A scratch folder whose dataset is simulated.
fn simulated(options: &str) -> Scratch {
    let scratch = Scratch::new();
    let data = scratch.path("data");
    fs::remove_dir_all(&data).unwrap();
    let mut simulate = sps();
    simulate.arg("simulate").args(options.split(' '));
    simulate.arg("--out").arg(&data).assert().success();
    scratch
}

/// What a command that succeeds prints.
fn said(command: &mut assert_cmd::Command) -> String {
    let output = command.assert().success().get_output().clone();
    String::from_utf8(output.stdout).unwrap()
}

fn predict(scratch: &Scratch, options: &[&str], images: &[PathBuf]) -> assert_cmd::Command {
    let mut command = sps();
    command.args(["predict", "--json"]);
    command
        .arg(scratch.path("model"))
        .args(options)
        .args(images);
    command
}

/// The first estimate, and the log.
fn estimate(mut command: assert_cmd::Command) -> (Value, String) {
    let output = command.assert().success().get_output().clone();
    let answer: Value = serde_json::from_slice(&output.stdout).unwrap();
    let log = String::from_utf8_lossy(&output.stderr).into_owned();
    (answer["estimates"][0].clone(), log)
}

#[test]
fn a_model_answers_for_a_photograph() {
    let scratch = fitted(&[]);
    let images = ["oak-01/002.jpg", "tile-01/002.exr"];
    let images = images.map(|name| scratch.path("data/frames").join(name));
    let of = |images: &[PathBuf]| estimate(predict(&scratch, &[], images)).0;
    let one = of(&images[..1]);
    let at = |key: &str| one[key].as_f64().unwrap();
    assert!(at("low") < at("value") && at("value") < at("high"), "{one}");
    let value = |estimate: &Value| estimate["value"].as_f64().unwrap();
    let other = of(&images[1..]);
    let mean = estimate(predict(&scratch, &["--group-by", "all"], &images)).0;
    assert!((value(&mean) - f64::midpoint(value(&one), value(&other))).abs() < 1e-9);
}

/// Three surfaces calibrate at 50 %: 4 * 0.75 is 3, for two photographs, and 4 * 5 / 6 is above, for three.
#[test]
fn the_mean_of_more_photographs_than_were_calibrated_for_has_no_interval() {
    let scratch = fitted(&[]);
    let images = ["000.jpg", "001.jpg", "002.jpg"];
    let images = images.map(|name| scratch.path("data/frames/oak-01").join(name));
    let line = |count: usize| -> Value {
        let text = said(&mut predict(
            &scratch,
            &["--group-by", "all"],
            &images[..count],
        ));
        serde_json::from_str(&text).unwrap()
    };
    let (two, three) = (line(2), line(3));
    assert_eq!(
        (&two["level"], &two["no_interval"]),
        (&json!(0.5), &json!({}))
    );
    assert!(two["estimates"][0]["low"].is_f64(), "{two}");
    assert_eq!(three["estimates"][0]["high"], Value::Null);
    let reason = three["no_interval"]["fRS"].as_str().unwrap();
    expect(reason, &["found 3 photographs", "at most 2", "83.3 %"]);

    let mut command = sps();
    command.args(["predict", "--group-by", "all"]);
    command.arg(scratch.path("model")).args(&images);
    let table = said(&mut command);
    expect(
        &table,
        &[
            "50 % interval",
            "none",
            "fRS: no interval, found 3 photographs",
        ],
    );
    let csv = said(command.arg("--csv"));
    let cells: Vec<&str> = csv.lines().nth(1).unwrap().split(',').collect();
    assert_eq!((cells[1], &cells[3..5]), ("fRS", &["", ""][..]), "{csv}");
}

/// A photograph of the same surface with more pixels is brought to those of the model's frames.
#[test]
fn a_large_photograph_comes_to_the_scale_of_the_model() {
    let scratch = fitted(&[]);
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
        let (estimate, _) = estimate(predict(&scratch, options, images));
        estimate["value"].as_f64().unwrap()
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
    let scratch = fitted(&[]);
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
    let (alone, _) = estimate(predict(&scratch, &[], &[alone]));
    let output = predict(&scratch, &[], std::slice::from_ref(&folder))
        .assert()
        .code(1);
    let output = output.get_output();
    let lines = String::from_utf8_lossy(&output.stdout).into_owned();
    let lines: Vec<Value> = lines
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    assert_eq!(lines.len(), 38);
    assert!(lines.iter().all(|line| line["estimates"][0] == alone));
    assert!(lines[0]["surface"].as_str().unwrap().ends_with("00.jpg"));
    let log = String::from_utf8_lossy(&output.stderr);
    expect(
        &log,
        &["07.jpg", "27.jpg", "2 of 40 surfaces have no estimate"],
    );

    let mut table = sps();
    table
        .args(["predict", "--csv"])
        .arg(scratch.path("model"))
        .arg(&folder);
    let table = String::from_utf8(table.assert().code(1).get_output().stdout.clone()).unwrap();
    let mut lines = table.lines();
    assert_eq!(
        lines.next(),
        Some("surface,property,value,low,high,familiar")
    );
    assert_eq!(lines.count(), 2 * 38);
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
    let scratch = fitted_in(
        scratch,
        &[
            "methods=[{ id = \"ridge\", label = \"Ridge\", kind = \"ridge\", views = 3, selector = { kind = \"equidistant\" } }]",
            "properties=[\"fRS\"]",
        ],
    );
    let dataset = DatasetFolder::open(&scratch.path("data"), &ReadSettings::default()).unwrap();
    let encoder = Encoder::seeded(EncoderKind::EfficientNetLiteBody, 0).unwrap();
    let encoder = encoder.with_depths(&Depths::All).unwrap();
    let embedder = Embedder::new(Network::Images(encoder), None).unwrap();
    let views = [0, 2, 4];
    let count = dataset.surfaces().len();
    let frames =
        (0..count).flat_map(|surface| views.map(|view| dataset.frame(surface, view).unwrap()));
    let values = embedder.embed(&frames.collect::<Vec<_>>()).unwrap();
    let embeddings = embedder.table(&values, count, 3).unwrap();
    let touched = dataset
        .tactile()
        .averages(&TactileSettings::default(), count);
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
    let ridges = Ridge::new(RidgeConfig::default())
        .unwrap()
        .train(&data, &plan)
        .unwrap();
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
        let of_folder = estimate(predict(&scratch, &[], &[folder(&surface.id)])).0;
        let of = |key: &str| of_folder[key].as_f64().unwrap();
        let expected = expected[at].clamp(of("low"), of("high"));
        assert_eq!(of("value"), expected, "{}", surface.id);
        // Of a folder they are taken by name, named one by one as they come.
        let mut named = photographs_in(&folder(&surface.id)).unwrap();
        assert_eq!(estimate(predict(&scratch, &[], &named)).0, of_folder);
        named.reverse();
        assert_ne!(estimate(predict(&scratch, &[], &named)).0, of_folder);
    }
    let first = &dataset.surfaces()[0].id;
    let one = dataset.frame_path(0, 2).unwrap();
    let refused = predict(&scratch, &[], &[one]).assert().code(1);
    let log = String::from_utf8_lossy(&refused.get_output().stderr).into_owned();
    let angles = "found 1, expected 3, at -45, 0 and 45 degrees";
    expect(&log, &[first, angles]);
    let mut map = sps();
    map.arg("map").arg(scratch.path("model")).arg("fRS");
    map.arg(dataset.frame_path(0, 2).unwrap());
    expect(
        &message(map.assert()),
        &["a map is of one", "without `views`"],
    );
}

/// Views that a selector chose for each property: a photograph of each view that any looks at.
#[test]
fn a_model_takes_the_views_that_its_selector_chose() {
    let selected = |more: &str| {
        let method = format!(
            "methods=[{{ id = \"r\", label = \"R\", views = 2, distinct = true, {more} }}]"
        );
        fitted(&[&method, "selection.folds=1"])
    };
    let by_refits = "kind = \"kernel-ridge\", selector = { kind = \"greedy\" }, refit = {}";
    let frozen = "kind = \"head\", head = { model = { kind = \"regression\" }, epochs = 2 }, \
        selector = { kind = \"exhaustive\" }";
    for more in [by_refits, frozen] {
        let scratch = selected(more);
        let text = fs::read_to_string(scratch.path("model/estimator.json")).unwrap();
        let model: Value = serde_json::from_str(&text).unwrap();
        let angles = model["about"]["angles"].as_array().unwrap();
        assert!((2..=4).contains(&angles.len()), "{angles:?}");
        let shown = scratch.path("shown");
        fs::create_dir(&shown).unwrap();
        for (at, angle) in angles.iter().enumerate() {
            let view = ((angle.as_f64().unwrap() + 45.0) / 22.5).round();
            let frame = scratch.path(&format!("data/frames/oak-01/00{view}.jpg"));
            fs::copy(frame, shown.join(format!("{at}.jpg"))).unwrap();
        }
        let (found, _) = estimate(predict(&scratch, &[], &[shown]));
        assert!(found["value"].as_f64().unwrap().is_finite());
    }
}

/// What it was fitted on was computed in another precision than f32.
#[test]
fn a_model_keeps_the_precision_of_its_encoder() {
    for precision in ["bf16", "int8"] {
        let scratch = fitted(&[&format!("encoder.precision={precision}")]);
        let image = [scratch.path("data/frames/oak-01/002.jpg")];
        let (found, _) = estimate(predict(&scratch, &[], &image));
        scratch.edit("model/estimator.json", &format!("{precision:?}"), "\"f32\"");
        let (in_f32, _) = estimate(predict(&scratch, &[], &image));
        assert_ne!(found["value"], in_f32["value"]);
    }
}

#[test]
fn a_model_that_resizes_is_not_resized() {
    let scratch = fitted(&["encoder.resize=16"]);
    let image = scratch.path("data/frames/oak-01/002.jpg");
    let refused = predict(&scratch, &["--resize", "24"], &[image]).assert();
    expect(&message(refused), &["--resize", "16 pixels"]);
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
    let printed = said(fit(&scratch, &more).arg("--force"));
    let of_splits = "no p-value of \"like what was fitted on\": the encoder learned";
    let of_model = "the model has no p-value of \"like what it was fitted on\"";
    expect(&printed, &[of_splits, of_model, reason]);

    let image = [scratch.path("data/frames/oak-01/002.jpg")];
    let line: Value = serde_json::from_str(&said(&mut predict(&scratch, &[], &image))).unwrap();
    assert_eq!(
        (&line["familiar"], &line["unfamiliar"]),
        (&Value::Null, &json!(false))
    );
    expect(line["no_familiar"].as_str().unwrap(), &[reason]);
    let ask = |verb: &str, options: &[&str]| {
        let mut command = sps();
        command.arg(verb).arg(scratch.path("model"));
        said(command.args(options).arg(&image[0]))
    };
    expect(
        &ask("predict", &[]),
        &[
            "no p-value of \"like what the model was fitted on\"",
            reason,
        ],
    );
    let csv = ask("predict", &["--csv"]);
    assert!(csv.lines().nth(1).unwrap().ends_with(','), "{csv}");
    let maps = scratch.path("maps").display().to_string();
    let drawn = ask("map", &["fRS", "--out", &maps]);
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
        let readings = scratch.path("data/tactile.csv");
        let text = fs::read_to_string(&readings).unwrap();
        fs::write(&readings, read(&text)).unwrap();
        let scratch = fitted_in(scratch, &[TRAINED, "train.calibration=0.34"]);
        fs::read(scratch.path("model/encoder.safetensors")).unwrap()
    };
    let before = weights(None);
    assert!(weights(Some(part.validation[0])) == before);
    assert!(weights(Some(part.train[0])) != before);
}

#[test]
fn a_map_is_a_picture_and_numbers() {
    let scratch = fitted(&[]);
    let photograph = scratch.path("wide.png");
    let pixel = |x: u32, y: u32| Rgb([(x * 4 % 256) as u8, (y * 7 % 256) as u8, 90]);
    RgbImage::from_fn(3 * SIDE, SIDE, pixel)
        .save(&photograph)
        .unwrap();
    let map = |options: &[&str], images: &[PathBuf]| {
        let mut command = sps();
        command.arg("map").arg(scratch.path("model")).arg("fRS");
        command
            .arg("--out")
            .arg(scratch.path("maps"))
            .args(options)
            .args(images);
        command
    };
    for options in [&[][..], &["--alone"]] {
        let output = map(options, std::slice::from_ref(&photograph))
            .assert()
            .success();
        let said = String::from_utf8_lossy(&output.get_output().stdout).into_owned();
        expect(
            &said,
            &[
                "wide-fRS.png",
                "1 x 17 places",
                "colours from ",
                "intervals +/- ",
            ],
        );
        let numbers = fs::read(scratch.path("maps/wide-fRS.npy")).unwrap();
        assert_eq!(numbers.len(), 128 + 17 * 4 * 8);
        let picture = image::open(scratch.path("maps/wide-fRS.png")).unwrap();
        assert!(picture.width() > 3 * SIDE);
    }
    let two =
        ["oak-01/002.jpg", "oak-02/002.jpg"].map(|name| scratch.path("data/frames").join(name));
    let refused = map(&[], &two).assert();
    expect(&message(refused), &["would have the same map", "002-fRS"]);

    // As large as a frame: one place. A map of another photograph is not written over.
    let output = map(&[], &two[..1]).assert().success();
    let log = String::from_utf8_lossy(&output.get_output().stderr).into_owned();
    expect(
        &log,
        &["oak-01/002.jpg: one place", "32 x 32 pixels", "--resize"],
    );
    let drawn = fs::read(scratch.path("maps/002-fRS.png")).unwrap();
    let refused = map(&[], &two[1..]).assert();
    expect(
        &message(refused),
        &["002-fRS.png is there already, the map of", "oak-01/002.jpg"],
    );
    assert_eq!(fs::read(scratch.path("maps/002-fRS.png")).unwrap(), drawn);
    map(&[], &two[..1]).assert().success();
    fs::copy(&photograph, scratch.path("maps/002-fRS.png")).unwrap();
    let refused = map(&[], &two[..1]).assert();
    expect(&message(refused), &["is no map that names its photograph"]);
    let mut misspelt = sps();
    misspelt.arg("map").arg(scratch.path("model"));
    misspelt.arg("frs").arg(&photograph);
    let refused = message(misspelt.assert());
    expect(
        &refused,
        &["unknown property `frs`", "did you mean `fRS`?", "`cDF`"],
    );
}

/// What `fit` says of the tiny dataset, its readings a hundredth of what they were, and what `predict`
/// and `inspect` show of them.
#[test]
fn people_read_as_many_digits_as_the_readings_have() {
    let scratch = Scratch::new();
    let readings = scratch.path("data/tactile.csv");
    let text = fs::read_to_string(&readings).unwrap();
    let hundredth = |(at, cell): (usize, &str)| match cell.parse::<f64>() {
        Ok(value) if at > 2 => (value / 100.0).to_string(),
        _ => cell.to_owned(),
    };
    let lines = text.lines().map(|line| {
        let cells = line.split(',').enumerate().map(hundredth);
        cells.collect::<Vec<_>>().join(",") + "\n"
    });
    fs::write(&readings, lines.collect::<String>()).unwrap();
    let scratch = fitted_in(scratch, &["train.method=ridge"]);
    let decimals = |line: &str| {
        let numbers = line
            .split_whitespace()
            .filter(|word| word.parse::<f64>().is_ok());
        let numbers = numbers.filter_map(|number| number.split_once('.'));
        numbers
            .map(|(_, decimals)| decimals.len())
            .collect::<Vec<_>>()
    };
    let of = |text: &str, property: &str| {
        let mut lines = text.lines();
        let line = lines.find(|line| line.trim_start().starts_with(property));
        line.unwrap_or_else(|| panic!("no {property} in {text}"))
            .to_owned()
    };

    let mut predict = sps();
    predict.args(["predict"]).arg(scratch.path("model"));
    let table = said(predict.arg(scratch.path("data/frames/oak-01/002.jpg")));
    // Their standard deviations are 0.117 and 0.318.
    assert_eq!(decimals(&of(&table, "fRS")), [3; 3], "{table}");
    assert_eq!(decimals(&of(&table, "cDF")), [3; 3], "{table}");
    assert!(table.starts_with("property"), "{table}");

    let mut inspect = sps();
    inspect.arg("inspect").arg(scratch.path("data"));
    let table = said(inspect.arg("--out").arg(scratch.path("figures")));
    // Their quartiles lie 0.131 and 0.062 apart.
    assert_eq!(decimals(&of(&table, "fRS"))[..5], [3; 5], "{table}");
    assert_eq!(decimals(&of(&table, "cDF"))[..5], [4; 5], "{table}");
}

#[test]
fn fit_says_what_it_fits_and_what_its_numbers_mean() {
    let scratch = Scratch::new();
    calibrates(&scratch);
    let train = |more: &[&str]| {
        let mut train = sps();
        train
            .args(["fit", "--config"])
            .arg(scratch.path("tiny.toml"))
            .args(more);
        train.arg("--out").arg(scratch.path("model")).assert()
    };
    let said = |assert: assert_cmd::assert::Assert| {
        String::from_utf8(assert.success().get_output().stdout.clone()).unwrap()
    };
    let first = said(train(&[]));
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
    let other = ["--set", "train.method=ridge"];
    let refused = message(train(&other));
    expect(&refused, &["model holds a model; `--force` replaces it"]);
    let second = said(train(&[&other[..], &["--force"]].concat()));
    expect(
        &second,
        &["Fits method `ridge`, as `train.method` says", "cross-modal"],
    );
}

#[test]
fn what_no_photographs_can_be_taken_for_is_not_kept() {
    let refused = |method: &str, named: &[&str]| {
        let scratch = Scratch::new();
        let mut train = sps();
        train
            .args(["fit", "--config"])
            .arg(scratch.path("tiny.toml"));
        train.arg("--set").arg(format!("methods=[{method}]"));
        let refused = train.arg("--out").arg(scratch.path("model")).assert();
        expect(&message(refused), named);
    };
    let twice = "{ id = \"r\", label = \"R\", kind = \"ridge\", views = 5, selector = { kind = \"random\" } }";
    refused(twice, &["may look at a view twice", "`distinct = true`"]);
    let hindsight = "{ id = \"r\", label = \"R\", kind = \"ridge\", views = 2, \
        selector = { kind = \"greedy\" }, refit = { judged-on = \"held-out\" } }";
    refused(hindsight, &["by the surfaces held out"]);
    let sequence = "{ id = \"r\", label = \"R\", kind = \"ridge\", \
        encoder = { name = \"i3d\", weights = \"untrained\", frames = 3 } }";
    refused(sequence, &["looks at a sequence by i3d"]);
}

/// Lines of standard input are answered as photographs that are named, and broken ones by an error in
/// their place.
#[test]
fn lines_of_standard_input_are_answered_one_by_one() {
    let scratch = fitted(&[]);
    let images = ["oak-01/002.jpg", "tile-01/002.exr"];
    let images = images.map(|name| scratch.path("data/frames").join(name));
    let named = said(&mut predict(&scratch, &[], &images));
    let both = said(&mut predict(&scratch, &["--group-by", "all"], &images));
    let lines = [
        json!(images[0]).to_string(),
        json!([images[1]]).to_string(),
        json!([scratch.path("none.png")]).to_string(),
        "{}".to_owned(),
        json!(images).to_string(),
    ];
    let mut asked = predict(&scratch, &[], &[PathBuf::from("-")]);
    let output = asked.write_stdin(lines.join("\n")).assert().code(1);
    let output = output.get_output().clone();
    let answers = String::from_utf8(output.stdout).unwrap();
    let answers: Vec<&str> = answers.lines().collect();
    let named: Vec<&str> = named.lines().collect();
    assert_eq!(answers[..2], named);
    expect(answers[2], &["\"line\":3", "none.png"]);
    expect(answers[3], &["\"line\":4", "found `{}`, expected the path"]);
    assert_eq!(answers[4..], [both.trim_end()]);
    expect(
        &String::from_utf8_lossy(&output.stderr),
        &["2 lines have no estimate"],
    );
}

#[test]
fn joint_intervals_are_wider_and_of_one_photograph() {
    let scratch = fitted(&["methods=[{ id = \"ridge\", label = \"Ridge\", kind = \"ridge\" }]"]);
    let images = ["000.jpg", "001.jpg"];
    let images = images.map(|name| scratch.path("data/frames/oak-01").join(name));
    let ask = |options: &[&str], images: &[PathBuf]| -> Value {
        serde_json::from_str(&said(&mut predict(&scratch, options, images))).unwrap()
    };
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
