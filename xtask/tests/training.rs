//! Training encoders from the command line.

mod support;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use candle_core::Tensor;
use serde_json::Value;
use sps_models::weights::Weights;
use support::{Scratch, kill, results_without_timings, root, xtask};

const PRETRAIN: &str = "
views-per-surface = 2
[simulated]
surfaces = 20
seed = 99
size = 32
[training]
epochs = 4
batch-size = 8
validation = 0.2
";

/// `pretrain` in a folder of its own, with tables added to the config.
fn pretrain(folder: &Path, tables: &str) -> Command {
    fs::create_dir_all(folder).unwrap();
    fs::write(folder.join("small.toml"), format!("{PRETRAIN}{tables}")).unwrap();
    let mut command = Command::new(xtask().get_program());
    command
        .args(["pretrain", "small.toml", "--out", "weights.safetensors"])
        .current_dir(folder)
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    command
}

/// The one folder of a training.
fn record(folder: &Path) -> Option<PathBuf> {
    let mut entries = fs::read_dir(folder.join("runs/small")).ok()?;
    Some(entries.next()?.ok()?.path())
}

#[test]
fn pretraining_that_was_killed_ends_with_the_same_weights() {
    let scratch = tempfile::tempdir().unwrap();
    let (through, killed) = (scratch.path().join("a"), scratch.path().join("b"));
    assert!(pretrain(&through, "").status().unwrap().success());
    let expected = fs::read(through.join("weights.safetensors")).unwrap();

    let child = pretrain(&killed, "").spawn().unwrap();
    let begun = || record(&killed).is_some_and(|folder| folder.join("state.safetensors").exists());
    kill(child, begun);
    assert!(pretrain(&killed, "").status().unwrap().success());
    assert!(fs::read(killed.join("weights.safetensors")).unwrap() == expected);

    let (_, header) = safetensors::SafeTensors::read_metadata(&expected).unwrap();
    let note = &header.metadata().as_ref().unwrap()["sps-pretraining"];
    assert!(
        note.contains("seed = 99") && note.contains("classes right"),
        "{note}"
    );
    let events = fs::read_dir(record(&through).unwrap()).unwrap();
    let names = events.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    assert!(
        names
            .into_iter()
            .any(|name| name.starts_with("events.out.tfevents."))
    );
}

#[test]
fn an_encoder_starts_from_weights_that_fit_it() {
    let scratch = tempfile::tempdir().unwrap();
    let fixture = |name: &str| root().join("crates/sps-models/weights").join(name);
    let start = |name: &str| format!("start = {:?}\n", fixture(name).display().to_string());
    let run = |folder: &str, settings: &str| {
        let folder = scratch.path().join(folder);
        let mut command = pretrain(&folder, "[training.augmentation]\nflip = false\n");
        let config = fs::read_to_string(folder.join("small.toml")).unwrap();
        fs::write(folder.join("small.toml"), format!("{settings}{config}")).unwrap();
        let output = command.stderr(Stdio::piped()).output().unwrap();
        (output, folder)
    };
    let body = "encoder = \"efficientnet-lite-body\"\n";
    let weights = |settings: &str, folder: &str| {
        let (output, folder) = run(folder, settings);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{said}");
        (fs::read(folder.join("weights.safetensors")).unwrap(), said)
    };
    let (from_seed, _) = weights(body, "seeded");
    let started = format!("{body}{}", start("efficientnet-lite-body.safetensors"));
    let (from_file, said) = weights(&started, "started");
    assert!(from_seed != from_file);
    assert!(said.contains("240 of 240 tensors"), "{said}");
    let (mixed, _) = weights(&format!("{started}trained-share = 0.5\n"), "mixed");
    let read = |bytes: &[u8]| Weights::from_bytes("weights", bytes).unwrap();
    let [first, trained, mixed] = [
        &fs::read(fixture("efficientnet-lite-body.safetensors")).unwrap(),
        &from_file,
        &mixed,
    ]
    .map(|bytes| read(bytes));
    for (name, found) in mixed.iter() {
        let values = |tensor: &Tensor| tensor.flatten_all().unwrap().to_vec1::<f32>().unwrap();
        let ends = [&first, &trained].map(|weights| values(weights.get(name).unwrap()));
        for ((a, b), found) in ends[0].iter().zip(&ends[1]).zip(values(found)) {
            let expected = 0.5 * (a + b);
            let rounding = 2e-3 * (a.abs() + b.abs()) + 1e-7;
            assert!(
                (found - expected).abs() <= rounding,
                "{name}: {found}, expected {expected}"
            );
        }
    }

    for (settings, part) in [
        (format!("{started}trained-share = 0.0\n"), "trained-share"),
        (format!("{body}trained-share = 0.5\n"), "it needs `start`"),
    ] {
        let (output, _) = run("refused", &settings);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && said.contains(part), "{said}");
    }
    for (weights, part) in [
        (
            "../../../fixtures/golden/squeezenet1_0.safetensors",
            "no tensor of which efficientnet-lite-body has",
        ),
        ("none.safetensors", "none.safetensors"),
    ] {
        let (output, _) = run("refused", &format!("{body}{}", start(weights)));
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && said.contains(part), "{said}");
    }
}

/// The built-in encoder as a teacher, of patterns too.
fn taught(weight: f64, size: usize, images: usize) -> String {
    let weights = root().join("crates/sps-models/weights/efficientnet-lite-body.safetensors");
    format!(
        "[patterns]\nclasses = 5\nimages = {images}\n[teacher]\nencoder = \"efficientnet-lite-body\"\n\
         weights = {:?}\nsize = {size}\nweight = {weight:?}\n",
        weights.display().to_string()
    )
}

#[test]
fn an_encoder_learns_patterns_and_what_a_teacher_sees() {
    let scratch = tempfile::tempdir().unwrap();
    let weights = |folder: &str, tables: &str, threads: &str| {
        let folder = scratch.path().join(folder);
        let mut command = pretrain(&folder, tables);
        command.env("RAYON_NUM_THREADS", threads);
        assert!(command.status().unwrap().success());
        let runs = fs::read_dir(folder.join("runs/small")).unwrap();
        let kept = runs.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let kept = kept.filter(|name| name.starts_with("teacher-")).count();
        (fs::read(folder.join("weights.safetensors")).unwrap(), kept)
    };
    let (first, kept) = weights("a", &taught(1.0, 48, 6), "1");
    assert_eq!(kept, 1);
    assert!(first == weights("b", &taught(1.0, 48, 6), "3").0);
    // Its embeddings are found again by a training that weighs them otherwise.
    let (other, kept) = weights("a", &taught(3.0, 48, 6), "3");
    assert_eq!(kept, 1);
    assert!(first != other);
    // Damaged, they are made again.
    let entries = fs::read_dir(scratch.path().join("a/runs/small")).unwrap();
    let mut paths = entries.map(|entry| entry.unwrap().path());
    let kept = paths.find(|path| path.extension().is_some_and(|e| e == "safetensors"));
    let kept = kept.unwrap();
    let mut bytes = fs::read(&kept).unwrap();
    *bytes.last_mut().unwrap() ^= 0x80;
    fs::write(&kept, bytes).unwrap();
    let [again, whole] = ["a", "b"].map(|folder| weights(folder, &taught(2.0, 48, 6), "3"));
    assert!(again == whole);
    let (alone, kept) = weights("a", "[patterns]\nclasses = 5\nimages = 6\n", "3");
    assert_eq!(kept, 1);
    assert!(first != alone);
}

#[test]
fn a_teacher_and_patterns_that_cannot_be_meant_are_refused_by_key() {
    let scratch = tempfile::tempdir().unwrap();
    for (tables, key) in [
        (taught(0.0, 48, 6), "teacher.weight"),
        (taught(1.0, 0, 6), "teacher.size"),
        (taught(1.0, 48, 0), "patterns.images"),
        (
            taught(1.0, 48, 6).replace("efficientnet-lite-body\"", "vgg\""),
            "teacher.encoder",
        ),
        (
            taught(1.0, 48, 6).replace("body.safe", "gone.safe"),
            "efficientnet-lite-gone",
        ),
    ] {
        let mut command = pretrain(scratch.path(), &tables);
        let output = command.stderr(Stdio::piped()).output().unwrap();
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{message}");
        assert!(
            message.contains(key) && !message.contains("panicked"),
            "{key}: {message}"
        );
    }
}

/// An experiment in which the encoder of each of two reruns is trained, through heads with all their
/// losses.
fn fine_tune(scratch: &Scratch, more: &[&str]) -> (Value, String) {
    let cache = format!("cache.folder={}", scratch.path("cache").display());
    let mut command = xtask();
    command.args(["experiment", "configs/end-to-end.toml", "--fresh"]);
    command.args(["--only", "frozen", "--only", "heads"]);
    let settings = [
        "reruns=2",
        "properties=[\"fRS\", \"mTX\"]",
        "data.simulated.surfaces=20",
        "data.simulated.test-surfaces=10",
        "data.simulated.size=32",
        "encoder.training.epochs=2",
        "head.epochs=2",
        &cache,
    ];
    for setting in settings.iter().chain(more) {
        command.args(["--set", setting]);
    }
    command.arg("--out").arg(scratch.path("run"));
    let done = command.assert().success();
    let log = String::from_utf8_lossy(&done.get_output().stderr).into_owned();
    (results_without_timings(&scratch.path("run")), log)
}

fn entries(folder: &Path) -> usize {
    fs::read_dir(folder).unwrap().count()
}

#[test]
fn an_encoder_is_trained_once_for_each_rerun() {
    let scratch = Scratch::new();
    let (results, log) = fine_tune(&scratch, &[]);
    assert!(!log.contains("trained before"), "{log}");
    assert_eq!(entries(&scratch.path("cache/encoders")), 2);
    for entry in fs::read_dir(scratch.path("cache/encoders")).unwrap() {
        let epochs = fs::read(entry.unwrap().path().join("epochs.json")).unwrap();
        let epochs: Value = serde_json::from_slice(&epochs).unwrap();
        for loss in "values classes embedding generator discriminator".split(' ') {
            let value = epochs[1]["training"][loss].as_f64().unwrap();
            assert!(value.is_finite() && value != 0.0, "{loss}: {value}");
        }
    }
    let (again, log) = fine_tune(&scratch, &[]);
    assert_eq!(log.matches("trained before").count(), 2, "{log}");
    assert_eq!(again, results);
}

/// Embeddings are kept by what computes them.
#[test]
fn a_trained_encoder_computes_in_the_precision_that_is_asked_for() {
    let scratch = Scratch::new();
    fine_tune(&scratch, &[]);
    assert_eq!(entries(&scratch.path("cache/embeddings")), 3);
    fine_tune(&scratch, &["encoder.precision=bf16"]);
    assert_eq!(entries(&scratch.path("cache/embeddings")), 6);
    // Scaled for what each rerun trains on: two frozen, what training starts from, two trained.
    fine_tune(&scratch, &["encoder.precision=int8"]);
    assert_eq!(entries(&scratch.path("cache/embeddings")), 10);
}

#[test]
fn a_learning_rate_that_cannot_be_meant_is_refused() {
    let run = xtask()
        .args(["experiment", "configs/end-to-end.toml", "--list"])
        .args(["--set", "encoder.training.adam.learning-rate=-1"])
        .assert()
        .failure();
    let message = String::from_utf8_lossy(&run.get_output().stderr).into_owned();
    assert!(
        message.contains("learning-rate") && message.contains("above 0"),
        "{message}"
    );
}
