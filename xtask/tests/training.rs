//! Training encoders from the command line.

mod support;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde_json::Value;
use support::{Scratch, results_without_timings, xtask};

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

/// `pretrain` in a folder of its own.
fn pretrain(folder: &Path) -> Command {
    fs::create_dir_all(folder).unwrap();
    fs::write(folder.join("small.toml"), PRETRAIN).unwrap();
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
    assert!(pretrain(&through).status().unwrap().success());
    let expected = fs::read(through.join("weights.safetensors")).unwrap();

    let mut child = pretrain(&killed).spawn().unwrap();
    let begun = || record(&killed).is_some_and(|folder| folder.join("state.safetensors").exists());
    while !begun() && child.try_wait().unwrap().is_none() {
        std::thread::yield_now();
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(pretrain(&killed).status().unwrap().success());
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

/// An experiment in which the encoder of each of two reruns is trained.
fn fine_tune(scratch: &Scratch, more: &[&str]) -> (Value, String) {
    let cache = format!("cache.folder={}", scratch.path("cache").display());
    let mut command = xtask();
    command.args(["experiment", "configs/fine-tuning.toml", "--fresh"]);
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
    let encoder = results["dataset"]["encoder"].as_str().unwrap();
    assert!(encoder.contains("then trained"), "{encoder}");
    let (again, log) = fine_tune(&scratch, &[]);
    assert_eq!(log.matches("trained before").count(), 2, "{log}");
    assert_eq!(again, results);
}

/// Embeddings are kept by what computes them.
#[test]
fn a_trained_encoder_computes_in_the_precision_that_is_asked_for() {
    let scratch = Scratch::new();
    fine_tune(&scratch, &[]);
    assert_eq!(entries(&scratch.path("cache/embeddings")), 2);
    fine_tune(&scratch, &["encoder.precision=bf16"]);
    assert_eq!(entries(&scratch.path("cache/embeddings")), 4);
}

#[test]
fn a_learning_rate_that_cannot_be_meant_is_refused() {
    let run = xtask()
        .args(["experiment", "configs/fine-tuning.toml", "--list"])
        .args(["--set", "encoder.training.adam.learning-rate=-1"])
        .assert()
        .failure();
    let message = String::from_utf8_lossy(&run.get_output().stderr).into_owned();
    assert!(
        message.contains("learning-rate") && message.contains("above 0"),
        "{message}"
    );
}
