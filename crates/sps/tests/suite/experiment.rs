//! Experiments from config to report.

use std::fs;

use crate::support::{Ends, Scratch, expect, method};
use safetensors::SafeTensors;
use serde_json::{Value, json};

#[test]
fn an_experiment_ends_with_results_and_a_report() {
    let scratch = Scratch::new();
    let said = scratch.experiment().said();
    let results = scratch.results();
    assert_eq!(results["properties"], json!(["fRS", "cDF"]));
    for method in results["methods"].as_array().unwrap() {
        assert!(method["r2"]["fRS"].is_f64(), "{method}");
        if method["kind"] != "mean" && method["kind"] != "label-mean" {
            assert_eq!(method["frames_decoded_per_surface"], 1.0);
            assert_eq!(method["frames_encoded_per_surface"], 1.0);
            assert_eq!(method["selected_views"]["fRS"], json!([[2], [2]]));
        }
    }
    expect(&scratch.read("run/report.md"), "| Ridge |");
    let html = scratch.read("run/report.html");
    assert!(html.contains("<svg") && !html.contains("src=\"http"));

    let lines: Vec<&str> = said.lines().collect();
    assert_eq!(lines[0], "tiny: means over properties");
    let page = scratch.path("run/report.html").display().to_string();
    assert_eq!(*lines.last().unwrap(), page);
    let marked = |mark: &str| lines.iter().filter(|line| line.ends_with(mark)).count();
    assert_eq!(marked("fastest"), 1, "{said}");
    assert!(said.contains("best"), "{said}");

    // The network's losses, of three epochs and the first rerun.
    for property in ["fRS", "cDF"] {
        let folder = scratch.path("run/tensorboard/cross-modal").join(property);
        let events: Vec<_> = fs::read_dir(folder).unwrap().collect();
        assert_eq!(events.len(), 1);
        let file = fs::read(events[0].as_ref().unwrap().path()).unwrap();
        let times = |tag: &[u8]| file.windows(tag.len()).filter(|part| part == &tag).count();
        assert_eq!(times(b"training/estimation"), 3);
        assert_eq!(times(b"training/embedding"), 3);
        assert_eq!(times(b"training/generator"), 0);
    }
    assert!(!scratch.path("run/tensorboard/ridge").exists());
}

#[test]
fn a_second_run_computes_nothing_and_says_the_same() {
    let scratch = Scratch::new();
    let printed = scratch.experiment().arg("--json").json();
    assert_eq!(printed, scratch.json("run/results.json"));
    let (results, trials) = (scratch.results(), scratch.read("run/trials.jsonl"));
    let log = scratch.experiment().logged();
    assert!(log.contains("0 of them encoded now"), "{log}");
    assert_eq!(scratch.results(), results);
    assert_eq!(scratch.read("run/trials.jsonl"), trials);
}

#[test]
fn a_run_for_one_property_gives_it_the_same_numbers() {
    let scratch = Scratch::new();
    let both = scratch.ran();
    let one = scratch.ran_with(&["properties=[\"cDF\"]"]);
    for method in 0..2 {
        let of = |results: &Value| results["methods"][method]["r2"]["cDF"].clone();
        assert_eq!(of(&both), of(&one));
    }
    assert!(one["methods"][0]["r2"]["fRS"].is_null());
}

#[test]
fn embeddings_are_written_in_the_order_given() {
    let scratch = Scratch::new();
    let embed = |images: &str, threads: usize| {
        let line = "embed --encoder efficientnet-lite-body --weights untrained --out @out";
        let line = format!("{line} --threads {threads} {images}");
        scratch.sps(&line).assert().success();
        let bytes = scratch.bytes("out");
        let file = SafeTensors::deserialize(&bytes).unwrap();
        let tensor = file.tensor("embeddings").unwrap();
        let rows = tensor.data().chunks(tensor.shape()[1] * 4);
        rows.map(<[u8]>::to_vec).collect::<Vec<_>>()
    };
    let [a, b] = ["oak-01/000.jpg", "denim-01/000.png"].map(|name| format!("@data/frames/{name}"));
    let forwards = embed(&format!("{a} {b}"), 1);
    let backwards = embed(&format!("{b} {a} {b}"), 2);
    assert_eq!(forwards, [backwards[1].clone(), backwards[0].clone()]);
}

/// Each depth is a tensor of its own, and a part of the whole.
#[test]
fn depths_are_written_one_by_one() {
    let scratch = Scratch::new();
    let embed = |depths: &str| {
        let line = "embed --encoder resnet18 --weights untrained --json --out @out.safetensors \
            @data/frames/oak-01/000.jpg --depths";
        scratch.sps(&format!("{line} {depths}"))
    };
    let read = |depths: &str| {
        let said = embed(depths).json();
        let bytes = scratch.bytes("out.safetensors");
        let file = SafeTensors::deserialize(&bytes).unwrap();
        let rows = file.tensor("embeddings").unwrap();
        assert_eq!(said["embeddings"], json!(scratch.path("out.safetensors")));
        assert_eq!([&said["rows"], &said["width"]], rows.shape());
        for block in said["blocks"].as_array().unwrap() {
            // A depth that is alone has no tensor of its own.
            let own = file.tensor(block["name"].as_str().unwrap());
            let own = own.unwrap_or_else(|_| file.tensor("embeddings").unwrap());
            assert_eq!(block["width"], own.shape()[1]);
        }
        assert!(said["encode_seconds_per_image"].as_f64().unwrap() > 0.0);
        let tensors = file.tensors().into_iter();
        let tensors =
            tensors.map(|(name, of)| (format!("{name} {:?}", of.shape()), of.data().to_vec()));
        let mut tensors: Vec<_> = tensors.collect();
        tensors.sort();
        tensors
    };
    let all = read("all");
    let shapes: Vec<&str> = all.iter().map(|(shape, _)| &**shape).collect();
    let expected = "embeddings [1, 960]; stage-1 [1, 64]; stage-2 [1, 128]; stage-3 [1, 256]; \
        stage-4 [1, 512]";
    assert_eq!(shapes.join("; "), expected);
    let parts = all[1..].iter().flat_map(|(_, bytes)| bytes);
    assert!(all[0].1.iter().eq(parts));
    let two = read("stage-2,stage-4");
    assert_eq!((&two[1], &two[2]), (&all[2], &all[4]));
    let last = ("embeddings [1, 512]".to_owned(), all[4].1.clone());
    assert_eq!(read("last"), [last]);
    embed("stage-9").refused("stage-9; resnet18's stage-1, stage-2, stage-3, stage-4");
}

/// Methods may look at other depths of one encoder; an unknown one is named with its line.
#[test]
fn methods_look_at_the_depths_that_they_name() {
    let scratch = Scratch::with_methods(
        "last | last | kernel-ridge | encoder.depths = 'last'\n\
         all | all | kernel-ridge | encoder.depths = 'all'\n\
         two | two | kernel-ridge | encoder.depths = ['block-1', 'block-3']",
    );
    let results = scratch.ran();
    let [last, all, two] = ["last", "all", "two"].map(|id| method(&results, id));
    let error = |of: &Value| of["mae"]["fRS"].clone();
    assert!(error(last) != error(all) && error(all) != error(two));
    expect(all["encoder"].as_str().unwrap(), "at all depths");
    expect(two["encoder"].as_str().unwrap(), "at block-1 and block-3");

    scratch.edit("tiny.toml", "'block-3'", "'block-9'");
    scratch.is_refused("tiny.toml, line; depths`: is \"block-9\", expected; block-8");
}

#[test]
fn results_say_where_they_come_from() {
    let scratch = Scratch::after_a_run();
    let results = scratch.json("run/results.json");
    assert_eq!(results["schema"], 4);
    let hash = blake3::hash(&scratch.bytes("run/config.toml")).to_string();
    assert_eq!(results["config_hash"], hash);
    assert_eq!(results["precision"], json!(["f32"]));
    assert_eq!(results["methods"][0]["precision"], "f32");
    let seeds = [&results["seed"], &results["data_seed"]];
    assert_eq!(seeds, [&json!(0), &Value::Null]);
    for key in ["source_hash", "data_hash", "cpu"] {
        assert!(!results[key].as_str().unwrap().is_empty(), "{key}");
    }
    assert!(results["threads"].as_u64().unwrap() > 0);

    // Another config, the same data; then another reading, of the last row and a property that is not estimated.
    let again = || {
        scratch.ran_with(&["report.level=0.5"]);
        scratch.json("run/results.json")
    };
    let other = again();
    assert_ne!(other["config_hash"], results["config_hash"]);
    assert_eq!(other["data_hash"], results["data_hash"]);
    scratch.edit("data/tactile.csv", ",0.37,0.11,", ",0.37,0.12,");
    assert_ne!(again()["data_hash"], results["data_hash"]);
}

#[test]
fn a_method_that_diverges_has_a_reason_and_the_others_go_on() {
    let scratch = Scratch::new();
    let model = "head.model = { kind = \"cross-modal\" }";
    let diverging = format!("{model}\nhead.adam.learning-rate = 1e30");
    scratch.edit("tiny.toml", model, &diverging);
    let results = scratch.ran();
    assert!(method(&results, "ridge")["r2"]["fRS"].is_f64());
    let row = method(&results, "cross-modal");
    assert!(row["r2"]["fRS"].is_null(), "{row}");
    assert_eq!(row["held_out_surfaces"], 0);
    let notes = row["notes"].as_array().unwrap().iter();
    let reasons = notes.filter(|note| note.as_str().unwrap().contains("left out: "));
    assert_eq!(reasons.count(), 4, "two properties in two reruns: {row}");
    expect(&scratch.read("run/report.md"), "fRS, rerun 0, left out");

    // They are finished: nothing is trained again, and nothing changes.
    let trials = scratch.read("run/trials.jsonl");
    assert_eq!(scratch.ran(), results);
    assert_eq!(scratch.read("run/trials.jsonl"), trials);
}

/// Beside the same one that stands on all it was given; a stack says it as well.
#[test]
fn a_row_says_that_it_stands_on_fewer_surfaces() {
    let scratch = Scratch::with_methods(
        "kernel | Kernel | kernel-ridge\n\
         stacked | Stacked | stacked | members = ['ridge', 'kernel-ridge']; folds = 2",
    );
    let said = |at_most: &str| {
        let results = scratch.ran_with(&[&format!("kernel-ridge.at-most={at_most}")]);
        ["ridge", "kernel", "stacked"].map(|id| {
            let notes = method(&results, id)["notes"].to_string();
            notes.contains(&format!("stands on {at_most} of the "))
        })
    };
    assert_eq!(said("3"), [false, true, true]);
    assert_eq!(said("1000"), [false; 3]);
}

#[test]
fn a_list_shows_settings_and_opens_no_data() {
    let scratch = Scratch::new();
    fs::remove_dir_all(scratch.path("data")).unwrap();
    let text = scratch.experiment().arg("--list").said();
    let head = text.split("\ncross-modal\t").nth(1).unwrap();
    let head = head.split("\n    kind = \"mean\"").next().unwrap();
    for line in [
        "    kind = \"head\"\n",
        "    encoder = \"squeezenet1-1 with untrained, random weights\"\n",
        "    views = 1 # the one straight down\n",
        "    head.epochs = 3\n",
        "    head.batch-size = 16\n",
    ] {
        expect(head, line);
    }
    assert!(!scratch.path("run").exists());
    let input = |views: &str| {
        let text = scratch.experiment().arg("--list").set(&[views]).said();
        let line = text.lines().find(|line| line.contains("head.input"));
        line.unwrap().trim().to_owned()
    };
    for (views, expected) in [
        ("1", "{ kind = \"single\" }"),
        ("3", "{ kind = \"late-fusion\", views = 3 }"),
        ("all", "{ kind = \"late-fusion\" } # of all views"),
    ] {
        let found = input(&format!("methods.cross-modal.views={views}"));
        assert_eq!(found, format!("head.input = {expected}"));
    }
}

#[test]
fn other_settings_do_not_replace_a_report_unasked() {
    let scratch = Scratch::new();
    let experiment = |more: &str| scratch.inside(&format!("experiment tiny.toml {more}"));
    experiment("--set reruns=1").assert().success();

    let results = || scratch.read("runs/tiny/results.json");
    let before = results();
    experiment("").refused("config.toml; `reruns` is 1, here 2; --out");
    assert_eq!(results(), before);
    experiment("--out runs/tiny").assert().success();
    assert_ne!(results(), before);
}

/// Rows of a file are found by surface and view, in whatever order they are, and no other is needed.
#[test]
fn embeddings_from_a_file_score_as_the_encoder_does() {
    let scratch = Scratch::new();
    let own = "[encoder]\nname = \"squeezenet1-1\"\ndepths = \"last\"\nweights = \"untrained\"\n";
    scratch.edit("tiny.toml", own, "");
    let seeing = scratch.ran();
    let mut embed = scratch.sps("embed --encoder efficientnet-lite-body --out @file.safetensors");
    let images = "tile-01/002.exr sponge-01/002.exr oak-02/002.png oak-01/002.jpg denim-02/002.jpg denim-01/002.png";
    let frames = scratch.path("data/frames");
    embed.args(images.split(' ').map(|image| frames.join(image)));
    embed.assert().success();
    let line = "experiment @tiny.toml --out @blind --set encoder.embeddings=@file.safetensors";
    scratch.sps(line).assert().success();
    let blind = scratch.results_in("blind");
    for id in ["ridge", "cross-modal"] {
        let (blind, seeing) = (method(&blind, id), method(&seeing, id));
        assert_eq!(blind["r2"], seeing["r2"], "{id}");
        assert_eq!(blind["encoder"], "embeddings from file.safetensors");
        assert_eq!(blind["frames_decoded_per_surface"], 0.0);
    }
}
