//! Experiments from config to report.

mod support;

use std::fs;

use serde_json::Value;
use support::{
    Scratch, expect, json, kill, message, method, process, results_without_timings, sps,
};

#[test]
fn an_experiment_ends_with_results_and_a_report() {
    let scratch = Scratch::new();
    let ended = scratch.experiment().assert().success();
    let results = scratch.results();
    assert_eq!(results["properties"], serde_json::json!(["fRS", "cDF"]));
    for method in results["methods"].as_array().unwrap() {
        assert!(method["r2"]["fRS"].is_f64(), "{method}");
        if ["mean", "label-mean"].contains(&method["kind"].as_str().unwrap()) {
            continue;
        }
        assert_eq!(method["frames_decoded_per_surface"], 1.0);
        assert_eq!(method["frames_encoded_per_surface"], 1.0);
        assert_eq!(
            method["selected_views"]["fRS"],
            serde_json::json!([[2], [2]])
        );
    }
    let report = fs::read_to_string(scratch.path("run/report.md")).unwrap();
    assert!(report.contains("| Ridge |"));
    let html = fs::read_to_string(scratch.path("run/report.html")).unwrap();
    assert!(html.contains("<svg") && !html.contains("src=\"http"));

    let said = String::from_utf8_lossy(&ended.get_output().stdout).into_owned();
    let lines: Vec<&str> = said.lines().collect();
    assert_eq!(lines[0], "tiny: means over properties");
    let path = scratch.path("run/report.html").display().to_string();
    assert_eq!(*lines.last().unwrap(), path);
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
    let printed = json(scratch.experiment().arg("--json").assert());
    let written = fs::read_to_string(scratch.path("run/results.json")).unwrap();
    assert_eq!(printed, serde_json::from_str::<Value>(&written).unwrap());
    let (results, trials) = (
        scratch.results(),
        fs::read(scratch.path("run/trials.jsonl")).unwrap(),
    );
    let again = scratch.experiment().assert().success();
    let log = String::from_utf8_lossy(&again.get_output().stderr).into_owned();
    assert!(log.contains("0 of them encoded now"), "{log}");
    assert_eq!(scratch.results(), results);
    assert_eq!(fs::read(scratch.path("run/trials.jsonl")).unwrap(), trials);
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let scratch = Scratch::new();
    let run = |threads: &str| {
        let mut command = scratch.experiment();
        let cache = format!("cache.folder={}", scratch.path(threads).display());
        command
            .args(["--fresh", "--set", &cache])
            .env("RAYON_NUM_THREADS", threads);
        command.assert().success();
        scratch.results()
    };
    assert_eq!(run("1"), run("2"));
}

#[test]
fn a_killed_run_ends_as_one_that_was_not() {
    let scratch = Scratch::new();
    scratch.edit("tiny.toml", "epochs = 3", "epochs = 40");
    let journal = scratch.path("run/trials.jsonl");
    let child = process()
        .arg("experiment")
        .arg(scratch.path("tiny.toml"))
        .arg("--out")
        .arg(scratch.path("run"))
        .spawn();
    // Once the first trials are on disk.
    let begun = || fs::metadata(&journal).is_ok_and(|file| file.len() > 0);
    kill(child.unwrap(), begun);
    let begun = fs::read_to_string(&journal).unwrap();
    scratch.experiment().assert().success();
    assert!(fs::read_to_string(&journal).unwrap().starts_with(&begun));
    let finished = scratch.results();
    scratch.experiment().arg("--fresh").assert().success();
    assert_eq!(finished, scratch.results());
}

#[test]
fn a_run_for_one_property_gives_it_the_same_numbers() {
    let scratch = Scratch::new();
    scratch.experiment().assert().success();
    let both = scratch.results();
    scratch
        .experiment()
        .args(["--set", "properties=[\"cDF\"]"])
        .assert()
        .success();
    let one = scratch.results();
    for method in 0..2 {
        let of = |results: &serde_json::Value| results["methods"][method]["r2"]["cDF"].clone();
        assert_eq!(of(&both), of(&one));
    }
    assert!(one["methods"][0]["r2"]["fRS"].is_null());
}

#[test]
fn damaged_trials_and_embeddings_are_computed_again() {
    let scratch = Scratch::new();
    scratch.experiment().assert().success();
    let expected = scratch.results();
    let flip = |path: &std::path::Path| {
        let mut bytes = fs::read(path).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        fs::write(path, bytes).unwrap();
    };
    flip(&scratch.path("run/trials.jsonl"));
    let encoder = fs::read_dir(scratch.path("cache/embeddings"))
        .unwrap()
        .next()
        .unwrap();
    let segment = fs::read_dir(encoder.unwrap().path())
        .unwrap()
        .next()
        .unwrap();
    flip(&segment.unwrap().path());
    let again = scratch.experiment().assert().success();
    let log = String::from_utf8_lossy(&again.get_output().stderr).into_owned();
    assert!(log.contains("lines are damaged"), "{log}");
    assert!(log.contains("checksum"), "{log}");
    assert_eq!(scratch.results(), expected);
}

#[test]
fn embeddings_are_written_in_the_order_given() {
    let scratch = Scratch::new();
    let embed = |images: &[&str], threads: &str| {
        let out = scratch.path("out.safetensors");
        let mut command = sps();
        let encoder = "embed --encoder efficientnet-lite-body --weights untrained";
        command.args(encoder.split(' '));
        command.args(["--threads", threads, "--out"]).arg(&out);
        for image in images {
            command.arg(scratch.path(image));
        }
        command.assert().success();
        let bytes = fs::read(out).unwrap();
        let file = safetensors::SafeTensors::deserialize(&bytes).unwrap();
        let tensor = file.tensor("embeddings").unwrap();
        let width = tensor.shape()[1] * 4;
        tensor
            .data()
            .chunks(width)
            .map(<[u8]>::to_vec)
            .collect::<Vec<_>>()
    };
    let (a, b) = ("data/frames/oak-01/000.jpg", "data/frames/denim-01/000.png");
    let forwards = embed(&[a, b], "1");
    let backwards = embed(&[b, a, b], "2");
    assert_eq!(forwards, [backwards[1].clone(), backwards[0].clone()]);
}

/// Each depth is a tensor of its own, and a part of the whole.
#[test]
fn depths_are_written_one_by_one() {
    let scratch = Scratch::new();
    let embed = |depths: &str| {
        let out = scratch.path("out.safetensors");
        let mut command = sps();
        command.args(["embed", "--encoder", "resnet18", "--weights", "untrained"]);
        command
            .args(["--json", "--depths", depths, "--out"])
            .arg(&out);
        command.arg(scratch.path("data/frames/oak-01/000.jpg"));
        (command.assert(), out)
    };
    let read = |depths: &str| {
        let (ended, out) = embed(depths);
        let said = json(ended);
        let bytes = fs::read(&out).unwrap();
        let file = safetensors::SafeTensors::deserialize(&bytes).unwrap();
        let rows = file.tensor("embeddings").unwrap();
        assert_eq!(said["embeddings"], *out.to_string_lossy());
        assert_eq!(
            [&said["rows"], &said["width"]],
            [rows.shape()[0], rows.shape()[1]]
        );
        let blocks = said["blocks"].as_array().unwrap();
        for block in blocks {
            // A depth that is alone has no tensor of its own.
            let own = file.tensor(block["name"].as_str().unwrap());
            let own = own.unwrap_or_else(|_| file.tensor("embeddings").unwrap());
            assert_eq!(block["width"], own.shape()[1]);
        }
        assert!(said["encode_seconds_per_image"].as_f64().unwrap() > 0.0);
        let tensors = file.tensors().into_iter();
        let mut tensors: Vec<_> = tensors
            .map(|(name, tensor)| (name, tensor.shape().to_vec(), tensor.data().to_vec()))
            .collect();
        tensors.sort();
        tensors
    };
    let all = read("all");
    let shapes: Vec<_> = all
        .iter()
        .map(|(name, shape, _)| (&name[..], shape[1]))
        .collect();
    let expected = [
        ("embeddings", 960),
        ("stage-1", 64),
        ("stage-2", 128),
        ("stage-3", 256),
        ("stage-4", 512),
    ];
    assert_eq!(shapes, expected);
    let parts = all[1..].iter().flat_map(|(_, _, bytes)| bytes);
    assert!(all[0].2.iter().eq(parts));
    let two = read("stage-2,stage-4");
    assert_eq!((&two[1], &two[2]), (&all[2], &all[4]));
    assert_eq!(
        read("last"),
        [("embeddings".to_owned(), vec![1, 512], all[4].2.clone())]
    );
    let said = message(embed("stage-9").0);
    expect(
        &said,
        &["stage-9", "resnet18's stage-1, stage-2, stage-3, stage-4"],
    );
}

/// Methods may look at other depths of one encoder; an unknown one is named with its line.
#[test]
fn methods_look_at_the_depths_that_they_name() {
    let scratch = Scratch::new();
    let text = fs::read_to_string(scratch.path("tiny.toml")).unwrap();
    let method = |id: &str, depths: &str| {
        format!(
            "[[methods]]\nid = {id:?}\nlabel = {id:?}\nkind = \"kernel-ridge\"\nencoder.depths = {depths}\n"
        )
    };
    let methods = [
        method("last", "\"last\""),
        method("all", "\"all\""),
        method("two", "[\"stage-1\", \"stage-3\"]"),
    ];
    fs::write(
        scratch.path("tiny.toml"),
        format!("{text}{}", methods.concat()),
    )
    .unwrap();
    scratch.experiment().assert().success();
    let results = scratch.results();
    let scores =
        ["last", "all", "two"].map(|id| support::method(&results, id)["mae"]["fRS"].clone());
    assert!(
        scores[0] != scores[1] && scores[1] != scores[2],
        "{scores:?}"
    );
    let said = ["all", "two"].map(|id| support::method(&results, id)["encoder"].to_string());
    assert!(said[0].contains("at all depths"), "{}", said[0]);
    assert!(said[1].contains("at stage-1 and stage-3"), "{}", said[1]);

    scratch.edit("tiny.toml", "\"stage-3\"", "\"stage-9\"");
    let said = message(scratch.experiment().assert());
    expect(
        &said,
        &[
            "tiny.toml, line",
            "depths`: is \"stage-9\", expected",
            "stage-7",
        ],
    );
}

#[test]
fn results_say_where_they_come_from() {
    let scratch = Scratch::new();
    scratch.experiment().assert().success();
    let read = || -> serde_json::Value {
        let text = fs::read_to_string(scratch.path("run/results.json")).unwrap();
        serde_json::from_str(&text).unwrap()
    };
    let results = read();
    assert_eq!(results["schema"], 4);
    let config = fs::read(scratch.path("run/config.toml")).unwrap();
    let hash = blake3::hash(&config).to_string();
    assert_eq!(results["config_hash"], hash);
    assert_eq!(results["precision"], serde_json::json!(["f32"]));
    assert_eq!(results["methods"][0]["precision"], "f32");
    assert_eq!(
        (&results["seed"], &results["data_seed"]),
        (&0.into(), &serde_json::Value::Null)
    );
    for key in ["source_hash", "data_hash", "cpu"] {
        assert!(!results[key].as_str().unwrap().is_empty(), "{key}");
    }
    assert!(results["threads"].as_u64().unwrap() > 0);

    // Another config, the same data; then another reading.
    let again = |scratch: &Scratch| {
        let mut command = scratch.experiment();
        command
            .args(["--set", "report.level=0.5"])
            .assert()
            .success();
        read()
    };
    let other = again(&scratch);
    assert_ne!(other["config_hash"], results["config_hash"]);
    assert_eq!(other["data_hash"], results["data_hash"]);
    let table = fs::read_to_string(scratch.path("data/tactile.csv")).unwrap();
    let digit = table.rfind(|c: char| c.is_ascii_digit()).unwrap();
    let new = if &table[digit..=digit] == "1" {
        "2"
    } else {
        "1"
    };
    let table = format!("{}{new}{}", &table[..digit], &table[digit + 1..]);
    fs::write(scratch.path("data/tactile.csv"), table).unwrap();
    assert_ne!(again(&scratch)["data_hash"], results["data_hash"]);
}

#[test]
fn a_method_that_diverges_has_a_reason_and_the_others_go_on() {
    let scratch = Scratch::new();
    scratch.edit(
        "tiny.toml",
        "head.model = { kind = \"cross-modal\" }",
        "head.model = { kind = \"cross-modal\" }\nhead.adam.learning-rate = 1e30",
    );
    scratch.experiment().assert().success();
    let results = scratch.results();
    let of = |id: &str| {
        let mut methods = results["methods"].as_array().unwrap().iter();
        methods.find(|method| method["id"] == id).unwrap()
    };
    assert!(of("ridge")["r2"]["fRS"].is_f64());
    let row = of("cross-modal");
    assert!(row["r2"]["fRS"].is_null(), "{row}");
    assert_eq!(row["held_out_surfaces"], 0);
    let notes = row["notes"].as_array().unwrap().iter();
    let reasons = notes.filter(|note| note.as_str().unwrap().contains("left out: "));
    assert_eq!(reasons.count(), 4, "two properties in two reruns: {row}");
    let report = fs::read_to_string(scratch.path("run/report.md")).unwrap();
    assert!(report.contains("fRS, rerun 0, left out"), "{report}");

    // They are finished: nothing is trained again, and nothing changes.
    let trials = fs::read(scratch.path("run/trials.jsonl")).unwrap();
    scratch.experiment().assert().success();
    assert_eq!(scratch.results(), results);
    assert_eq!(fs::read(scratch.path("run/trials.jsonl")).unwrap(), trials);
}

/// Beside the same one that stands on all it was given; a stack says it as well.
#[test]
fn a_row_says_that_it_stands_on_fewer_surfaces() {
    let scratch = Scratch::with_methods(
        "kernel | Kernel | kernel-ridge\n\
         stacked | Stacked | stacked | members = ['ridge', 'kernel-ridge']; folds = 2",
    );
    let said = |at_most: &str| {
        let setting = format!("kernel-ridge.at-most={at_most}");
        let mut command = scratch.experiment();
        command.args(["--set", &setting]).assert().success();
        let results = scratch.results();
        let said = |id: &str| {
            let notes = method(&results, id)["notes"].to_string();
            notes.contains(&format!("stands on {at_most} of the "))
        };
        ["ridge", "kernel", "stacked"].map(said)
    };
    assert_eq!(said("3"), [false, true, true]);
    assert_eq!(said("1000"), [false; 3]);
}

#[test]
fn a_list_shows_settings_and_opens_no_data() {
    let scratch = Scratch::new();
    fs::remove_dir_all(scratch.path("data")).unwrap();
    let output = scratch.experiment().arg("--list").assert().success();
    let text = String::from_utf8_lossy(&output.get_output().stdout).into_owned();
    let head = text.split("\ncross-modal\t").nth(1).unwrap();
    let head = head.split("\n    kind = \"mean\"").next().unwrap();
    for line in [
        "    kind = \"head\"\n",
        "    encoder = \"efficientnet-lite-body with untrained, random weights, at all depths\"\n",
        "    views = 1 # the one straight down\n",
        "    head.epochs = 3\n",
        "    head.batch-size = 16\n",
    ] {
        assert!(head.contains(line), "`{line}` is not in: {head}");
    }
    assert!(!scratch.path("run").exists());
    let input = |views: &str| {
        let mut command = scratch.experiment();
        let listed = command.args(["--list", "--set", views]).assert().success();
        let text = String::from_utf8_lossy(&listed.get_output().stdout).into_owned();
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
    let experiment = |more: &[&str]| {
        let mut command = sps();
        command.current_dir(scratch.path("."));
        command.args(["experiment", "tiny.toml"]).args(more);
        command.assert()
    };
    experiment(&["--set", "reruns=1"]).success();
    let results = || fs::read(scratch.path("runs/tiny/results.json")).unwrap();
    let before = results();
    let refused = message(experiment(&[]));
    expect(&refused, &["config.toml", "`reruns` is 1, here 2", "--out"]);
    assert_eq!(results(), before);
    experiment(&["--out", "runs/tiny"]).success();
    assert_ne!(results(), before);
}

/// Rows of a file are found by surface and view, in whatever order they are, and no other is needed.
#[test]
fn embeddings_from_a_file_score_as_the_encoder_does() {
    let scratch = Scratch::new();
    scratch.edit("tiny.toml", "[encoder]\nweights = \"untrained\"\n", "");
    scratch.experiment().assert().success();
    let seeing = scratch.results();
    let mut embed = sps();
    let out = scratch.path("file.safetensors");
    embed
        .args(["embed", "--encoder", "efficientnet-lite-body", "--out"])
        .arg(&out);
    for image in ["tile-01/002.exr", "sponge-01/002.exr", "oak-02/002.png"] {
        embed.arg(scratch.path("data/frames").join(image));
    }
    for image in ["oak-01/002.jpg", "denim-02/002.jpg", "denim-01/002.png"] {
        embed.arg(scratch.path("data/frames").join(image));
    }
    embed.assert().success();
    let mut blind = scratch.experiment_into("blind");
    blind
        .arg("--set")
        .arg(format!("encoder.embeddings={}", out.display()));
    blind.assert().success();
    let blind = results_without_timings(&scratch.path("blind"));
    for id in ["ridge", "cross-modal"] {
        let (blind, seeing) = (method(&blind, id), method(&seeing, id));
        assert_eq!(blind["r2"], seeing["r2"], "{id}");
        assert_eq!(blind["encoder"], "embeddings from file.safetensors");
        assert_eq!(blind["frames_decoded_per_surface"], 0.0);
    }
}
